"""What drives one robot from its own observations."""
