"""Robots that ship with hpp_framework."""
