"""Holder of a place in a segment: its entry about itself, in words for a client that finds no free place."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from trocar.shm.memory.segment import start_time

PROGRAM = 60
HOLDER = struct.Struct(f"<I{PROGRAM}s")  # pid, program


class Holder(NamedTuple):
    """The holder of a place, as it reported itself; pid 0: unknown."""

    pid: int
    program: str

    def reported(self, person: str = "", places: int = 1) -> str:
        """In words; `person`: the program of the person that it acts for."""
        more = [f"pid {self.pid}"] * bool(self.pid) + [f"{places} places"] * (places > 1)
        name = self.acting_for(person) if self.pid else "a program that does not say its name"
        return name + (f" ({', '.join(more)})" if more else "")

    def acting_for(self, person: str) -> str:
        """Its name, and the program of the person that it acts for, if that is another one."""
        name = self.program or "a program"
        return f"{name} for {person}" if person and not name.startswith(person) else name


NAMELESS = Holder(0, "")


def in_words(signed: Iterable[Holder]) -> str:
    """All holders, each once; crashed ones are counted without a name."""
    found = Counter(who if start_time(who.pid) else NAMELESS for who in signed)
    return ", ".join(who.reported(places=count) for who, count in found.items())
