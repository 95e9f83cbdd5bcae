"""Recordings: file format, writing and reading. docs/recordings.md."""
