"""A system of every kind of process whose records the test writes: whatever it likes into any field."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from tests.tools.robot import KEPT, short
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.supervisor import memory
from trocar.shm.memory.parts import remove_all
from trocar.shm.ring.ring import RingWriter
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.shm.time.control_page import ControlPage

SYSTEM: Final = "kinematic-full.yaml"
LEFT_OUT: Final = ("PSM2", "PSM3")
NUMBERS: Final = (float("nan"), float("inf"), -float("inf"), 1.7e308, -1.7e308, 5e-324, 0.0)
TEXTS: Final = (b"", b"\xff\xfe", "é…".encode(), b"FAULT", b"\x1b[31m", b"nan", b"error")
FIELDS: Final = ("event", "outcome", "command", "severity", "state", "program")
Field = tuple[str, str, str]
"""Process, ring and field."""


def smaller(folder: Path, name: str) -> SystemConfig:
    """Masters, setup joints, endoscope, one instrument, console, teleoperations and recorder; all of it KINEMATIC."""
    content = yaml.safe_load((PROJECT_CONFIGS / "systems" / SYSTEM).read_text())
    content["arms"] = [arm for arm in content["arms"] if arm["name"] not in LEFT_OUT]
    console = content["consoles"][0]
    console["teleop_PSMs"] = [row for row in console["teleop_PSMs"] if row["PSM"] not in LEFT_OUT]
    file = folder / "wild.yaml"
    file.write_text(yaml.safe_dump(content))
    loaded = load_system(file, name=name, records=True)
    assert loaded.system is not None, loaded.errors
    return replace(loaded.system, clock=WALL)


class WildSystem:
    """All rings of a system, each with one good record; `write` makes others."""

    def __init__(self, folder: Path, name: str) -> None:
        self.document, self.name = smaller(folder, name), name
        memory.create_all(self.document, partial(short, KEPT))
        self._pages = {one: ControlPage(name, one, write=True) for one in directory.instances(name)}
        for one, page in self._pages.items():
            page.segment.claim(one)
            page.field("pid")[...] = os.getpid()
            page.field("heartbeat_ns")[...] = monotonic_ns()
            page.show("RUNNING")
        self.rings: dict[tuple[str, str], RingWriter] = {}
        for one, ring in directory.rings(name):
            writer = self.rings[one, ring] = directory.writer(name, one, ring, None)
            self._begin(one, ring, writer)
            writer.publish(monotonic_ns())
        self._good = {key: self._record(writer).copy() for key, writer in self.rings.items()}

    def _begin(self, one: str, ring: str, writer: RingWriter) -> None:
        """What its process would say: an error, a command that was refused, a state that is valid."""
        said: dict[str, Any] = {"valid": True, "monotonic_ns": monotonic_ns(), "local_ns": local_ns(), "count": 6}
        if ring == "events":
            said |= {"event": b"error", "severity": 3, "code": b"tracking", "text": one.encode(), "hint": b"look"}
        elif ring == "audit":
            said |= {"command": b"servo_jp", "outcome": b"refused", "reason": b"not finite", "pid": 7, "origin": 9}
        elif (one, ring) == ("supervisor", "state"):
            for place, row in enumerate(self.document.processes):
                for field, word in (("instance", row.name), ("kind", row.kind), ("lifecycle", "RUNNING")):
                    writer.field(field)[place] = word.encode()
        else:
            said |= {"state": b"ENABLED", "sub_state": b"HOMED", "is_homed": True, "following": True}
        for field, value in said.items():
            if field in self._record(writer).dtype.names:
                writer.field(field)[...] = value

    @staticmethod
    def _record(writer: RingWriter) -> np.ndarray[Any, Any]:
        return np.frombuffer(writer._record.bytes, writer._record._array.dtype, 1)

    @property
    def fields(self) -> list[Field]:
        """Every field of every ring."""
        return [(*key, field) for key, writer in self.rings.items()
                for field in self._record(writer).dtype.names or () if field not in ("sequence", "stamp_ns")]

    def write(self, values: dict[Field, Any]) -> None:
        """One record of each ring that is named, good but for these fields; `value` is any of a kind (`values_of`)."""
        for key in dict.fromkeys(field[:2] for field in values):
            writer = self.rings[key]
            record = self._record(writer)
            record[...] = self._good[key]
            for (one, ring, field), value in values.items():
                if (one, ring) == key:
                    cell = writer.field(field)
                    cell[...] = worth(cell.dtype, value)
            writer.publish(monotonic_ns())

    def beat(self) -> None:
        """All processes live."""
        for page in self._pages.values():
            page.field("heartbeat_ns")[...] = monotonic_ns()

    def close(self) -> None:
        """Give all back, and remove it."""
        for part in (*self._pages.values(), *self.rings.values()):
            part.close()
        remove_all(self.name)


def worth(dtype: np.dtype[Any], number: int) -> Any:
    """The so-manieth value that a field of this type may have and no reader may stumble over."""
    kind = dtype.base.kind
    if kind == "f":
        return NUMBERS[number % len(NUMBERS)]
    if kind == "S":
        return TEXTS[number % len(TEXTS)][: dtype.base.itemsize]
    if kind == "b":
        return bool(number % 2)
    limits = np.iinfo(dtype.base)
    return (limits.max, limits.min, 0, 1, limits.max // 2, limits.max // 3, 2)[number % 7]
