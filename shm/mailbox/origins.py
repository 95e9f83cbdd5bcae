"""Origin of commands: every command that can power, home or move carries the person's command from which it originates.

The command line, Python programs, bridges and the web console count as persons. System, consoles and teleoperations
pass on the origin of the commands they received; pedals, head sensors and restarted processes have no origin of their
own.
"""

from __future__ import annotations

import itertools
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from trocar.shm.memory import private

PROGRAM_BYTES: Final = 16
CONFINED: Final = "TROCAR_CONFINED_TO"
"""Environment variable: the only system for which programs may act that a process of it has started."""
COUNT = itertools.count(1)


@dataclass(frozen=True, slots=True)
class Origin:
    """One person's command: its number, unique among all programs of a run, its fault generation, the program.

    See shm/mailbox/generations.py for generations.
    """

    id: int
    generation: int
    program: str


NO_ORIGIN: Final = Origin(0, 0, "")


class SenderId(NamedTuple):
    """Sender of a command: its place in the mailbox and, for a bridge, the number of the bridge's client (0: none).

    Another program, or another client of the same bridge, is another sender, whatever the origin.
    """

    place: int
    peer: int = 0


class Acting:
    """On whose behalf a process acts; None: it is a person's own program, and each of its commands is a person's.

    Processes that the supervisor starts act for no person, or for the person whose command they carry out; see
    procs/node/runtime.py and procs/user/process.py.
    """

    origin: Origin | None = None
    system: str = ""
    """The system in which `origin` is valid; in others, commands are unauthorized. Empty: valid in every system."""
    process: str = ""
    """Name of the process in its system, if the supervisor has started it."""

    def __init__(self) -> None:
        """Programs that a process starts have no more authority than the process has by itself."""
        if CONFINED in os.environ:
            self.origin, self.system = NO_ORIGIN, os.environ[CONFINED]

    def begin(self, process: str) -> None:
        """A process of a system begins: it has this name, and it does not matter who has started the system."""
        self.origin, self.system, self.process = None, "", process

    def confine(self, system: str) -> None:
        """From now on act for no person until one asks, and only in this system; so do programs started from here."""
        self.origin, self.system = NO_ORIGIN, system
        os.environ[CONFINED] = system

    def in_system(self, system: str) -> Origin | None:
        """The origin of its commands in a system. Systems in our own memory, which have no boards, are ours to command.
        """
        if self.origin is None or self.system in ("", system):
            return self.origin
        return None if private.is_kept(system) else NO_ORIGIN


ACTING: Final = Acting()


def new_id() -> int:
    """A number unique among the commands of persons."""
    return os.getpid() << 32 | next(COUNT) & 0xFFFF_FFFF


def is_direct(origin: int, pid: int) -> bool:
    """Whether this origin's program sent the command itself; other programs pass it on."""
    return pid > 0 and origin >> 32 == pid


def program_name() -> str:
    """The name of this process in its system, else of what was started: "box", "trocar send", "plan.py", "python"."""
    if ACTING.process:
        return ACTING.process
    path = Path(sys.argv[0] if sys.argv else "")
    name = path.parent.name if path.name == "__main__.py" else path.name  # of python -m NAME
    if name == "trocar":
        verb = next((word for word in sys.argv[1:] if not word.startswith("-")), "")
        return f"trocar {verb}".strip()
    return name if name not in ("", "-c", "-m") else "python"
