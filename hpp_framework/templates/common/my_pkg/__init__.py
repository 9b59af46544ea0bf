"""A plugin of hpp_framework."""
