"""Agents on real robots, or on robots that behave like them; no backend is imported before it is named."""
