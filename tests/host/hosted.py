"""Hosts that tests make: a system of ours in this process, and what its records say."""

from __future__ import annotations

import hashlib
import itertools
import os
from collections.abc import Sequence

from trocar.procs.config import PROJECT_CONFIGS, Machine, load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.host.host import Host
from trocar.shm.ring.ring import RingReader

COUNTER = itertools.count()
QUICK = ("io.period_s=0.002", "arm.period_s=0.002")
AT_200_HZ = ("io.period_s=0.005", "arm.period_s=0.005")
COARSE = (*QUICK, "emulation.period_s=0.002")


def document(file: str, boards: str | None = None, sets: Sequence[str] = QUICK) -> SystemConfig:
    """A system of ours in simulated time, under a name of its own."""
    name = f"hosted{os.getpid()}x{next(COUNTER)}"
    loaded = load_system(PROJECT_CONFIGS / "systems" / file, name=name, sets=["clock=lockstep", *sets], boards=boards,
                         machine=Machine(lambda bus: f"127.250.0.{16 * (bus + 1)}"))
    assert loaded.system is not None, loaded.errors
    return loaded.system


class HashedArm:
    """A host with one arm that is watched: every record of its ring goes into a hash."""

    def __init__(self, host: Host, arm: str = "PSM1") -> None:
        self.host, self.arm = host, arm
        self.client, self._hash = host.client(arm), hashlib.sha256()
        self._readers: list[RingReader] = [host.reader(arm), host.reader(arm, "setpoint")]
        self._origin = self._readers[1].field("desired_origin")  # whose command it was: another one each time
        self.outcomes: dict[int, str] = {}

    def run(self, seconds: float) -> None:
        """In steps that no ring is too short for."""
        for _ in range(round(seconds / 0.01)):
            self.host.run(0.01)
            for reader in self._readers:
                while reader.next():
                    self._origin[...] = 0
                    self._hash.update(reader.record)
        for reply in self.client.poll():
            self.outcomes[reply.id] = reply.outcome

    def does(self, name: str, values: Sequence[float] = (), text: str = "", limit_s: float = 60.0) -> str:
        """Ask the arm for something, and let time pass until it is done; the outcome."""
        number, passed = self.client.send(name, values, text), 0.0
        while self.outcomes.get(number, "accepted") == "accepted" and passed < limit_s:
            self.run(0.05)
            passed += 0.05
        return self.outcomes.get(number, "")

    def homes(self) -> None:
        """Power, and home, as soon as io has been seen."""
        self.run(0.05)
        for word in ("enable", "home"):
            assert self.does("state_command", (), word) == "done", word

    @property
    def hash(self) -> str:
        """Of all that was published, bit by bit."""
        assert not any(reader.lost for reader in self._readers)
        return self._hash.hexdigest()
