"""Planners to compare with, and scripted agents to meet."""
