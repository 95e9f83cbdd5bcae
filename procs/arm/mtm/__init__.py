"""Parts of a master only."""
