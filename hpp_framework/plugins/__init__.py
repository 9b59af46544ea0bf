"""What can be chosen by name, where it comes from, and how it is built."""
