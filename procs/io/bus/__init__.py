"""Ports: what carries datagrams to the controllers of a bus, who is on it, and how they are sampled and commanded."""
