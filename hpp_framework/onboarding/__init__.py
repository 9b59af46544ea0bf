"""Brings newcomers in: packages to start from, robots from URDF files, all that a team must learn of them."""
