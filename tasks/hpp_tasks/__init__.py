"""Tasks that ship with hpp_framework."""
