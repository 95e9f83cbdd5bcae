"""A master: what only it has."""
