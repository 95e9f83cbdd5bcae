"""Parts of a PSM only."""
