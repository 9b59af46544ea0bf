"""Worlds as data: obstacles, bounds and starts; where they come from, and what they are sliced into."""
