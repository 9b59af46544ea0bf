"""Thousands of worlds side by side, in Warp."""
