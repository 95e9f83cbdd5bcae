"""One connection to the socket bridge of a system (docs/socket.md). Python only."""

from __future__ import annotations

import json
import socket
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from trocar.shm.time.clock import monotonic_ns
from trocar.tools.client.deadline import Deadline
from trocar.tools.client.values import FRESH_S
from trocar.tools.output.errors import Disconnected, Problem, closed

if TYPE_CHECKING:
    import ssl

PORT: Final = 7380
KEPT: Final = 1000
"""Maximum number of kept answers and events that are not collected."""


class BridgeConnection:
    """One connection to a bridge; for one thread."""

    def __init__(self, at: str, token: str | Path = "", tls: ssl.SSLContext | None = None,
                 timeout: float = 5.0) -> None:
        """`at`: HOST:PORT. `token`: the token itself, or the Path of a file with it. OSError: no bridge there."""
        host, _, port = at.rpartition(":") if at.rpartition(":")[2].isdecimal() else (at, "", str(PORT))
        words = token.read_text().strip() if isinstance(token, Path) else token
        bare = socket.create_connection((host.strip("[]"), int(port)), timeout)
        bare.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = tls.wrap_socket(bare, server_hostname=host) if tls is not None else bare
        self._rest, self._count, self.at = b"", 0, at
        self._heard: dict[int, list[dict[str, Any]]] = {}
        self._records: dict[str, deque[Mapping[str, Any]]] = {}
        try:
            self.hello = self.ask("hello", timeout, token=words, name="python")
        except BaseException:
            self.close()
            raise

    def say(self, op: str, **parts: Any) -> int:
        """A message; its number."""
        self._count += 1
        message = json.dumps({"op": op, "id": self._count, **parts}, allow_nan=False)
        try:
            self._socket.settimeout(FRESH_S)
            self._socket.sendall(message.encode() + b"\n")
        except OSError as error:
            raise self._gone(error) from None
        return self._count

    def hear(self, timeout: float) -> bool:
        """Receive messages, at least one; False if there is none in time."""
        end = monotonic_ns() + round(timeout * 1e9)
        while b"\n" not in self._rest:
            try:
                self._socket.settimeout(max((end - monotonic_ns()) * 1e-9, 1e-4))
                data = self._socket.recv(1 << 16)
            except TimeoutError:
                return False
            except OSError as error:
                raise self._gone(error) from None
            if not data:
                raise self._gone("it closed the connection")
            self._rest += data
        *lines, self._rest = self._rest.split(b"\n")
        for line in lines:
            self._keep(line)
        while len(self._heard) > KEPT:
            del self._heard[next(iter(self._heard))]
        return True

    def _keep(self, line: bytes) -> None:
        try:
            message = json.loads(line)
            op, number = message["op"], message.get("id")
        except (ValueError, TypeError, KeyError, AttributeError):
            raise self._gone(f"not a Trocar bridge: it answered {line[:40]!r}") from None
        if isinstance(number, int):
            self._heard.setdefault(number, []).append(message)
        elif op == "record":
            self._records.setdefault(str(message["topic"]), deque(maxlen=KEPT)).append(message)
        elif op == "error":
            raise Problem(f"{self.at}: {message['error']}")

    def records(self, topic: str) -> list[Mapping[str, Any]]:
        """Records of a subscription since the last call."""
        while self.hear(0.0):
            pass
        return list(self._records.pop(topic, ()))

    def heard(self, number: int) -> list[dict[str, Any]]:
        """Answers about one message that were not collected yet."""
        while self.hear(0.0):
            pass
        return self._heard.pop(number, [])

    def first(self, number: int, timeout: float, outcomes: tuple[str, ...] = ()) -> dict[str, Any] | None:
        """The next answer about a message, of these outcomes if any are given; None if there is none in time."""
        end = monotonic_ns() + round(timeout * 1e9)
        while True:
            known = self._heard.get(number, [])
            while known:
                message = known.pop(0)
                if message["op"] == "error" or not outcomes or message.get("outcome") in outcomes:
                    return message
            if (left := (end - monotonic_ns()) * 1e-9) <= 0.0 or not self.hear(left):
                return None

    def ask(self, op: str, timeout: float = 5.0, **parts: Any) -> dict[str, Any]:
        """A query and its answer; Problem with the reason, TimeoutError if there is none."""
        found = self.first(self.say(op, **parts), timeout)
        if found is None:
            raise TimeoutError(f"{self.at} did not answer within {timeout:g} s")
        if found["op"] == "error":
            raise Problem(str(found["error"]))
        return found

    @property
    def is_simulated(self) -> bool:
        """Whether the robot's time is simulated."""
        return bool(self.hello["clock"] != "wall")

    def stamp_ns(self, name: str) -> int:
        """The robot's time, as the newest record of an instance shows it."""
        return int(self.ask("read", topic=f"{name}/state")["stamp_ns"])

    def deadline(self, name: str, timeout: float) -> Deadline:
        """The end of a wait for an instance."""
        return Deadline(timeout, (lambda: self.stamp_ns(name)) if self.is_simulated else None)

    def _gone(self, why: object) -> Disconnected:
        return Disconnected(f"the bridge at {self.at} is gone: {why}")

    def close(self) -> None:
        """Leave."""
        self._socket.close()
        self._socket = closed(f"the connection to {self.at}")
