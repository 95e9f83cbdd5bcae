"""The processes of a system in the document, for programs that need no other part of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Annotated, Final

from trocar.procs.document.decoding import decode
from trocar.procs.document.keys import Key

ALWAYS: Final = "always"
ON_DEMAND: Final = "on-demand"
ELSEWHERE: Final = "elsewhere"
"""It is started elsewhere, or is part of another process."""


@dataclass(frozen=True, slots=True)
class Process:
    """One instance of a system; `after` names instances that must be up first."""

    name: str
    kind: str
    period_s: float
    after: tuple[str, ...] = ()
    on_exit: Annotated[str, Key(choices=("restart", "stay-down"), is_optional=True)] = "restart"
    priority: int = 0  # SCHED_FIFO priority asked for; 0: none
    cpus: tuple[int, ...] = ()  # processors it may run on; empty: any
    restart_limit: Annotated[int, Key(0, 1000, is_optional=True)] = 5
    backoff_s: Annotated[float, Key(0.0, 60.0, "s", is_optional=True)] = 0.2
    # None: those of its kind
    late_s: Annotated[float | None, Key(0.01, 60.0, "s of silence, then it is reported")] = None
    hung_s: Annotated[float | None, Key(0.1, 86400.0, "s of silence, then it is killed")] = None
    start: str = ALWAYS  # or ON_DEMAND: while it has clients; or ELSEWHERE
    linger_s: Annotated[float, Key(0.0, 3600.0, "s after the last subscriber left", is_optional=True)] = 5.0
    host: str = ""  # the process that it is part of; empty: it is a process itself
    listen: tuple[str, ...] = ()  # addresses 127.0.0.1:8080 or [::1]:8080 of its listening sockets

    @property
    def typed(self) -> str:
        """The name to type to start, stop or restart it, and for its log."""
        return self.host or self.name


def processes_of(data: bytes) -> tuple[Process, ...]:
    """The processes in a document from `to_json`; unlike `from_json` it reads nothing else in the document.

    ValueError when the bytes are not a document (their origin may be unknown).
    """
    try:
        return tuple(decode(Process, row) for row in json.loads(data)["processes"])
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f"the document is not readable: {type(error).__name__}: {error}") from None


CALIBRATION_MODE: Final = ("calibration mode: potentiometers are not compared with encoders, and motors of Si arms "
                           "stay off; use it for calibration only, and restart without it for anything else")


def remarks_of(data: bytes) -> tuple[bool, str]:
    """From such a document: whether it is in calibration mode, and why rings keep less than usual (empty: they do not).

    ValueError as above.
    """
    try:
        document = json.loads(data)
        return any(bool(io["calibration_mode"]) for io in document["ios"]), str(document["shortage"])
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        raise ValueError(f"the document is not readable: {type(error).__name__}: {error}") from None


def host_and_port(address: str) -> tuple[str, int]:
    """Host and port of an address in `listen`; ValueError when it is not valid."""
    host, _, port = address.rpartition(":")
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if (ip_address(bare).version == 6) is (bare == host) or not (port.isascii() and port.isdecimal()):
        raise ValueError(f"{address} is no address")
    if not 1 <= int(port) <= 65535:
        raise ValueError(f"{port} is no port")
    return bare, int(port)
