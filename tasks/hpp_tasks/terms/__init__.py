"""Terms that ship with hpp_framework: what tasks are composed of."""
