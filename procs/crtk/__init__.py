"""A running system by CRTK's names: which topics there are, and what they say. For bridges and tools."""
