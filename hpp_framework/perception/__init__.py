"""What an agent makes of its readings."""
