"""The command line ``hpp``: one file a command."""
