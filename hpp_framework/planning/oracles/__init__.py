"""Planners that know what no robot can, as upper bounds."""
