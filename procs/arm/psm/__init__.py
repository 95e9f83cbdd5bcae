"""A PSM: what only it has."""
