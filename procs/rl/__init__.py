"""The real stack as Gymnasium environments: in a host, or attached to a running system."""
