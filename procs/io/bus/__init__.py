"""Ports of a bus: transports, discovery of the controllers, and the protocols that sample and command them."""
