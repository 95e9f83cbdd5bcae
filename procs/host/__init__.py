"""A whole system in one process, on a clock that is stepped: for simulation at scale."""
