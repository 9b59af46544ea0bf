"""Helpers that know nothing of robots."""
