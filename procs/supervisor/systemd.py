"""Notifications to systemd if it has started us (Type=notify): system ready, status, watchdog."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import MutableMapping


class Notifier:
    """Sends datagrams to the socket that the environment names, if any; never waits for systemd."""

    def __init__(self, environ: MutableMapping[str, str]) -> None:
        """Remove our variables from the environment, so that our processes do not notify in our place."""
        address, pid = environ.pop("NOTIFY_SOCKET", ""), environ.pop("WATCHDOG_PID", "")
        watchdog_us = environ.pop("WATCHDOG_USEC", "0")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if address else None
        asked = watchdog_us.isdecimal() and pid in ("", str(os.getpid()))
        self._every_ns = int(watchdog_us) * 1000 // 4 if asked else 0
        self._due_ns = 0

    def tell(self, *lines: str) -> None:
        """Send lines such as READY=1 or STATUS=all is well; lost if the socket's buffer is full."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto("\n".join(lines).encode(), self._address)

    def beat(self, now_ns: int) -> None:
        """Reset systemd's watchdog, four times in the time that the unit allows (WatchdogSec)."""
        if self._every_ns and now_ns >= self._due_ns:
            self._due_ns = now_ns + self._every_ns
            self.tell("WATCHDOG=1")

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
