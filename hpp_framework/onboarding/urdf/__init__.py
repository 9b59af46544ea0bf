"""Robots from URDF files: what a file says is read off, what it does not say is asked for."""
