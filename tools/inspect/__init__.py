"""State of a running system, for people."""
