"""Search for rewards and networks of skills."""
