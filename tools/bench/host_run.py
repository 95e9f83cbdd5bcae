"""Arms of a system in a host: homed, moved by a policy of 50 Hz, restored; and the hash of all their output.

`python -m trocar.tools.bench.host_run boards` prints that hash, for comparison with that of another process.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.host.host import Host
from trocar.shm.commands import became
from trocar.shm.mailbox.client import Client
from trocar.shm.memory.closable import Closable
from trocar.shm.ring.ring import RingReader
from trocar.tools.bench.io_loop import write_system
from trocar.tools.output.errors import Problem

PSMS: Final = "psm"  # after the number of PSMs of a system that is written for the bench
KINEMATIC, BOARDS, FOUR_PSMS = "kinematic", "boards", f"4{PSMS}"
FILES: Final = {KINEMATIC: "kinematic.yaml", BOARDS: "demo.yaml"}
SETS: Final = ("clock=lockstep", "io.period_s=0.002", "arm.period_s=0.002", "emulation.period_s=0.002")
POLICY_S: Final = 0.02
LOOK_S: Final = 0.01  # no ring of a host is too short for that
FIRST_S, LIMIT_S, REST_S = 0.05, 120.0, 0.3
START: Final = (0.0, 0.0, 0.12, 0.0, 0.0, 0.0)
AMPLITUDE: Final = (0.1, 0.1, 0.01, 0.2, 0.2, 0.2)
STEPS_A_TURN: Final = 100
HASHED_S: Final = 2.0
DIGITS: Final = 16
OURS: Final = ("desired_origin", "desired_program")  # process and program that gave a goal
_numbers: Final = itertools.count()


def document(kind: str, sets: Sequence[str] = SETS) -> SystemConfig:
    """A system of ours in simulated time, by default with all loops and physics at 500 Hz; `4psm`: on one io, with
    eight boards.
    """
    name = f"bench-rl-{os.getpid()}-{next(_numbers)}"
    with tempfile.TemporaryDirectory() as folder:
        file = (PROJECT_CONFIGS / "systems" / FILES[kind] if kind in FILES
                else write_system(Path(folder), int(kind.removesuffix(PSMS))))
        loaded = load_system(file, name=name, sets=sets, boards=None if kind == KINEMATIC else "emulated")
    if loaded.system is None:
        raise Problem(f"{file.name} cannot be read: {'; '.join(str(error) for error in loaded.errors)}")
    return loaded.system


class HostRun(Closable):
    """A host with homed arms at START; a context manager."""

    def __init__(self, kind: str, sets: Sequence[str] = SETS) -> None:
        """Problem: an arm could not be homed."""
        self.host = host = Host(document(kind, sets))
        try:
            arms = [arm.name for arm in host.document.arms]
            self._clients: dict[str, Client] = {arm: host.client(arm) for arm in arms}
            self._states = [host.reader(arm) for arm in arms]
            self._rings = [*self._states, *(host.reader(arm, "setpoint") for arm in arms),
                           *(host.reader(name) for name in host.loops if name not in arms)]
            host.run(FIRST_S)
            for word in ("enable", "home"):
                self._all("state_command", (), word)
            self._all("move_jp", START, "")
            host.run(REST_S)
            for ring in self._rings:
                ring.rewind(0)  # hashed data begins here
            begin = time.thread_time_ns()
            self._snapshot = host.snapshot()
            self.snapshot_ms = (time.thread_time_ns() - begin) * 1e-6
        except BaseException:
            host.close()
            raise

    @property
    def arms(self) -> int:
        """Number of its arms."""
        return len(self._clients)

    def _all(self, command: str, values: tuple[float, ...], text: str) -> None:
        waiting = {(arm, client.send(command, values, text)) for arm, client in self._clients.items()}
        end_ns = self.host.now_ns + round(LIMIT_S * 1e9)
        while waiting:
            self.host.run(POLICY_S)
            for arm, client in self._clients.items():
                for reply in client.poll():
                    if reply.outcome == "done":
                        waiting.discard((arm, reply.id))
                    elif reply.outcome != "accepted":
                        raise Problem(f"{arm}: {command} {text} {became(reply.outcome)}: {reply.text}")
            if self.host.now_ns > end_ns:
                raise Problem(f"{command} {text} takes more than {LIMIT_S:g} s")

    def restore(self) -> None:
        """As it was when it had been made."""
        self.host.restore(self._snapshot)

    def play(self, seconds: float, digest: hashlib._Hash | None = None) -> None:
        """Goals at 50 Hz; the arms' records are read each time; `digest` gets all output."""
        for step in range(round(seconds / POLICY_S)):
            turn = math.sin(2.0 * math.pi * step / STEPS_A_TURN)
            goal = [middle + width * turn for middle, width in zip(START, AMPLITUDE, strict=True)]
            for client in self._clients.values():
                client.poll()
                client.send("servo_jp", goal)
            if digest is None:
                self.host.run(POLICY_S)
                for state in self._states:
                    state.newest()
            else:
                for _ in range(round(POLICY_S / LOOK_S)):
                    self.host.run(LOOK_S)
                    for ring in self._rings:
                        _add(ring, digest)
        self._look()

    def _look(self) -> None:
        """Problem: an arm has stopped."""
        for arm, state in zip(self._clients, self._states, strict=True):
            state.newest()
            if (shown := bytes(state.field("state")[()]).decode()) != "ENABLED":
                raise Problem(f"{arm} is in {shown}: {bytes(state.field('reason')[()]).decode()}")

    def hash(self) -> str:
        """Hash of the output in some seconds from the beginning."""
        self.restore()
        digest = hashlib.sha256()
        self.play(HASHED_S, digest)
        if any(ring.lost for ring in self._rings):
            raise Problem("records were overwritten before they were read")
        return digest.hexdigest()[:DIGITS]

    def close(self) -> None:
        """Close the host."""
        self.host.close()


def _add(ring: RingReader, digest: hashlib._Hash) -> None:
    while ring.next():
        for name in OURS:
            if name in (ring.dtype.names or ()):
                ring.field(name)[...] = 0
        digest.update(ring.record)


def main() -> None:
    """Print the hash of one kind of system."""
    with HostRun(sys.argv[1]) as run:
        print(run.hash())


if __name__ == "__main__":
    main()
