"""Skills that ship with hpp_framework."""
