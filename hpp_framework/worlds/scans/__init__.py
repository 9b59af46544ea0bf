"""The scans of the catalogue: how they are made. They are read from files, as any other scan is."""
