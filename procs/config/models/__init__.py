"""Models of each kind of configuration file."""
