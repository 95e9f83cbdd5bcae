"""Recordings: what their files are made of, writing and reading them. docs/recordings.md."""
