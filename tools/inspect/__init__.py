"""What a running system says, for people."""
