"""How often robots act."""

CONTROL_PERIOD = 0.2
"""Seconds between commands (paper, appendix C.1: 100 steps are 20 s)."""
