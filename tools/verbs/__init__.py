"""What a person can type, one module a verb; the table of them is tools/cli.py."""
