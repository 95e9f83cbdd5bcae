"""The network interfaces of this machine."""

from __future__ import annotations

import psutil


def lacks_interface(name: str) -> str:
    """That there is no interface of this name or address now, and which there are; empty: it is there."""
    found = psutil.net_if_addrs()
    if name in found or any(name == row.address for rows in found.values() for row in rows):
        return ""
    return f"there is no such network interface; there are {', '.join(sorted(found))} (ros.interface)"
