"""A whole system in one process, on a stepped clock: for simulation at scale."""
