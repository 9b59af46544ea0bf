"""Files and settings that users write."""
