"""A client of the socket bridge that may not power anything, and tries."""

from __future__ import annotations

import json
import socket
from typing import Any

from tests.soak.diary import Diary
from tests.soak.judge import Attempt
from tests.soak.system import System
from tests.system.test_socket_bridge import SocketClient
from trocar.shm.time.clock import monotonic_ns

PATIENCE_S = 3.0
Wanted = tuple[str, str, tuple[float, ...], str]
ATTEMPTS: tuple[Wanted, ...] = (
    ("PSM1", "state_command", (), "enable"), ("PSM1", "state_command", (), "home"),
    ("MTMR", "state_command", (), "enable"), ("console", "teleop_enable", (1.0,), ""),
    ("MTMR_PSM1", "state_command", (), "enable"), ("MTMR_PSM1", "state_command", (), "align_MTM"),
    ("system", "power_on", (), ""), ("system", "home", (), ""), ("IO1", "power_on", (), "PSM1"),
    ("IO1", "tracking_check", (0.0,), "PSM1"), ("IO1", "pot_check", (0.0,), "PSM1"),
    ("IO1", "pid_enable", (1.0,), "PSM1"), ("IO1", "brake_release", (), "PSM1"),
)


def powerless(system: System, diary: Diary, wanted: Wanted) -> str:
    """Try it; in words."""
    to, command, values, text = wanted
    words = " ".join(["without may_power:", to, command, *(f"{value:g}" for value in values), text]).strip()
    diary.note("event", words)
    begin_ns = monotonic_ns()
    outcome = ""
    try:
        client = SocketClient(system.port)
    except OSError as problem:
        return f"{words} ({problem})"
    try:
        client.socket.settimeout(PATIENCE_S)
        client.say(op="call", id=1, to=to, command=command, values=list(values), text=text)
        outcome = _outcome(json.loads(client.stream.readline()))
    except (OSError, ValueError) as problem:
        return f"{words} ({problem})"
    finally:
        client.socket.shutdown(socket.SHUT_RDWR)
        client.close()
    diary.attempts.append(Attempt(to, begin_ns, words, outcome))
    return f"{words}: {outcome}"


def _outcome(answer: dict[str, Any]) -> str:
    """Of the first answer."""
    return "refused" if "error" in answer else str(answer.get("outcome", ""))
