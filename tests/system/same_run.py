"""The same run twice: output of an arm in a lock-step system, commanded from outside, and its repetition in a host.

Commands arrive in any cycle; the audits show in which. In the host each is sent so that it arrives in that cycle, too,
and then every record of the arm must be the same, bit by bit.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import SystemConfig, from_json
from trocar.procs.host.host import Host
from trocar.shm.commands import became
from trocar.shm.mailbox.client import Client
from trocar.shm.memory.closable import Closable
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.output.errors import Problem

LOOK_S = 0.002
PATIENCE_S = 120.0
AUDITED = 50
ATTEMPTS = 5
WAITS = "accepted", ""
TAKEN = (b"accepted", b"done")
HISTORY, SLICE_NS = 4096, 100_000_000  # rings keep several slices


@dataclass(frozen=True, slots=True)
class AskedFor:
    """A command, and the owner's cycle in which it arrived."""

    stamp_ns: int
    instance: str
    command: str
    values: tuple[float, ...]
    text: str


class LockstepRun(Closable):
    """A running system in lock-step and one of its arms: it gets commands, and all its output is kept."""

    def __init__(self, system: str, arm: str, others: Sequence[str] = ()) -> None:
        """`others` are further instances that get commands."""
        self.document: SystemConfig = from_json(directory.document(system))
        self._arm, self._held = arm, contextlib.ExitStack()
        self._ring = self._held.enter_context(contextlib.closing(directory.reader(system, arm, "state")))
        names = (arm, *others)
        self._audits = {name: self._held.enter_context(contextlib.closing(directory.reader(system, name, "audit")))
                        for name in names}
        self._clients = {name: self._held.enter_context(contextlib.closing(Client(system, name))) for name in names}
        self._rows: list[bytes] = []
        self._replies: dict[tuple[str, int], tuple[str, str]] = {}

    def send(self, instance: str, command: str, values: Sequence[float] = (), text: str = "") -> int:
        """Send a command; returns its number."""
        return self._clients[instance].send(command, values, text)

    def ask(self, instance: str, command: str, values: Sequence[float] = (), text: str = "") -> None:
        """Send a command, and wait until it is done; Problem: it was not.

        A refused command is repeated a few times: a busy machine stalls us, while the system's time advances.
        """
        said = ""
        for _ in range(ATTEMPTS):
            key = instance, self.send(instance, command, values, text)
            self.wait(lambda key=key: self._replies.get(key, WAITS)[0] != "accepted",  # type: ignore[misc]
                      f"{instance} {command}")
            outcome, said = self._replies[key]
            if outcome == "done":
                return
            if outcome != "refused":
                break
        raise Problem(f"{instance}: {command} {text} {became(outcome)}: {said}")

    def wait(self, has_come: Callable[[], bool], what: str) -> None:
        """Keep the output until a condition holds; Problem: it never does."""
        end_ns = monotonic_ns() + round(PATIENCE_S * 1e9)
        while not has_come():
            if monotonic_ns() > end_ns:
                raise Problem(f"{what} takes more than {PATIENCE_S:g} s")
            pause(LOOK_S)
            self.look()

    def look(self) -> None:
        """Take the new records."""
        while self._ring.next():
            self._rows.append(bytes(self._ring.record))
        for name, client in self._clients.items():
            self._replies.update({(name, reply.id): (reply.outcome, reply.text) for reply in client.poll()})

    def state(self) -> str:
        """The arm's."""
        return bytes(self._ring.field("state")[()]).decode()

    @property
    def asked_for(self) -> list[AskedFor]:
        """All commands that were not refused, in order."""
        found: dict[tuple[str, int, int], AskedFor] = {}
        for name, audit in self._audits.items():
            for row in audit.last(AUDITED):
                key = name, int(row["place"]), int(row["id"])
                if row["outcome"] in TAKEN and key not in found:  # else it is a later outcome
                    found[key] = AskedFor(int(row["stamp_ns"]), name, row["command"].decode(),
                                          tuple(map(float, row["values"][: int(row["count"])])), row["text"].decode())
        return sorted(found.values(), key=lambda one: one.stamp_ns)

    @property
    def records(self) -> NDArray[Any]:
        """Records of the arm so far; Problem: some were lost."""
        if self._ring.lost:
            raise Problem(f"{self._ring.lost} records of {self._arm} were lost")
        return np.frombuffer(b"".join(self._rows), self._ring.dtype)

    def differences(self) -> list[str]:
        """Fields in which a host's records of this run differ; records missing in the host."""
        theirs = self.records
        document = dataclasses.replace(self.document, name=f"{self.document.name}h")
        ours = hosted(document, self._arm, self.asked_for, int(theirs["stamp_ns"][-1]))
        _, mine, others = np.intersect1d(ours["stamp_ns"], theirs["stamp_ns"], return_indices=True)
        missing = [f"{len(theirs) - len(others)} records"] * (len(others) < len(theirs))
        return missing + [name for name in theirs.dtype.names or ()
                          if ours[name][mine].tobytes() != theirs[name][others].tobytes()]

    def close(self) -> None:
        """Detach."""
        self._held.close()


def hosted(document: SystemConfig, arm: str, asked_for: Sequence[AskedFor], end_ns: int) -> NDArray[Any]:
    """All records of the arm in a host that gets the same commands in the same cycles."""
    rows: list[bytes] = []
    with Host(document, history=HISTORY) as host:
        ring = host.reader(arm)
        clients = {name: host.client(name) for name in {one.instance for one in asked_for}}

        def run_until(stamp_ns: int) -> None:
            while host.now_ns < stamp_ns:
                host.run_until(min(stamp_ns, host.now_ns + SLICE_NS))
                while ring.next():
                    rows.append(bytes(ring.record))

        for one in asked_for:
            run_until(one.stamp_ns - 1)
            clients[one.instance].send(one.command, one.values, one.text)
        run_until(end_ns)
        return np.frombuffer(b"".join(rows), ring.dtype)
