"""A running system under CRTK's names: its topics, their values, and commands. For bridges and tools."""
