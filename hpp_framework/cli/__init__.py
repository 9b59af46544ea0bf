"""The command line ``hpp``: one file per command."""
