"""An arm from outside: its state record, its last messages, and its amplifiers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.topics import writer_gone
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.inspect.messages import text_of
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import plain
from trocar.tools.systems.find import instances_of_kind, is_simulated, state_info, unknown

if TYPE_CHECKING:
    from trocar.procs.document.system import ArmConfig, SystemConfig, Tool

FRESH_S = 0.2  # an older record does not show the present state


def arm_names(system: str, wanted: Sequence[str] | None = None) -> list[str]:
    """The arms of a system, or the requested ones; Problem if one does not exist."""
    return _among(instances_of_kind(system, "arm"), wanted)


def powered_names(system: str, wanted: Sequence[str] | None = None) -> list[str]:
    """All powered and homed components, arms and setup joints, or the requested ones."""
    return _among([*instances_of_kind(system, "arm"), *instances_of_kind(system, "suj")], wanted)


def _among(known: list[str], wanted: Sequence[str] | None) -> list[str]:
    for name in wanted or []:
        if name not in known:
            raise unknown("arm", name, known)
    return list(wanted or known)


def arm_document(system: str, name: str) -> ArmConfig:
    """The configuration of an arm; Problem if the system's document lacks it."""
    try:
        return document_of(system).arm(name)
    except KeyError as error:
        raise Problem(f"system {system}: {error.args[0]}") from None


def arm_type(system: str, name: str) -> str:
    """The type of an arm; "": not an arm."""
    info = state_info(system, name)
    return str(info.get("type", "")) if info.get("kind") == "arm" else ""


def document_of(system: str) -> SystemConfig:
    """The configuration of the system; Problem if it is unreadable."""
    from trocar.procs.document.system import from_json  # verbs and scripts that read only records do without

    try:
        return from_json(directory.document(system))
    except ValueError as error:  # its content may come from any source
        raise Problem(f"system {system}: {error.args[0]}") from None


def tool_on(system: str, watch: Watch) -> Tool | None:
    """The inserted instrument, as described in the configuration; None: none, or not described."""
    arm, name = arm_document(system, watch.name), watch.text("tool")
    known = arm.tools + ((arm.tool,) if arm.tool is not None else ())
    return next((tool for tool in known if name and tool.name == name), None)


class Watch(Closable):
    """The newest state of one arm; a context manager. Fields are those of the record last read."""

    def __init__(self, system: str, name: str) -> None:
        """Attach to the state of an arm, or of setup joints."""
        self.system, self.name = system, name
        kind = "suj" if name in instances_of_kind(system, "suj") else "arm"
        self.reader: RingReader = directory.reader(system, name, "state", kind, often=False)
        self._events: RingReader = directory.reader(system, name, "events", kind, often=False)
        self._since = self._events.head
        self._simulated = is_simulated(system)

    @property
    def age_s(self) -> float:
        """Age of the record last read; 0 where time is simulated, and stamps are."""
        return age_of(self.reader, self._simulated)

    @property
    def stamp_ns(self) -> int:
        """Monotonic stamp of the record last read."""
        return self.reader.stamp_ns

    def number(self, field: str) -> float:
        """A field that is one number."""
        return float(self.reader.field(field))

    def look(self) -> bool:
        """Read the newest record; False if there is none, or none is whole."""
        return self.reader.newest()

    def problem(self) -> str:
        """Problem of the arm's record: its writer has ended, it is old, or it was never written."""
        return problem_of(self.reader, self._simulated)

    def text(self, field: str) -> str:
        """A text field."""
        return str(plain(self.reader.field(field).item()))

    def flag(self, field: str) -> bool:
        """A flag."""
        return bool(self.reader.field(field)[()])

    def joints(self, field: str) -> NDArray[np.float64]:
        """A joint field (n,), cut to the joints in use; a new array."""
        return np.array(self.reader.field(field)[: self.count], dtype=np.float64)

    @property
    def count(self) -> int:
        """Joints in use."""
        return int(self.reader.field("count")[()])

    @property
    def state(self) -> str:
        """The published operating state."""
        return self.text("state")

    @property
    def busy(self) -> bool:
        """Whether a move or transition is in progress."""
        return self.flag("is_busy")

    @property
    def homed(self) -> bool:
        """Whether the arm is homed and powered."""
        return self.flag("is_homed")

    def forget_errors(self) -> None:
        """`last_error` covers only errors from now on."""
        self._since = self._events.head

    def last_error(self) -> str:
        """Text of the newest error, else warning, since we attached (or `forget_errors`); empty: none."""
        kept: NDArray[Any] = self._events.last(1024)
        ours = kept[kept["sequence"] > self._since]
        for event in (b"error", b"warning"):
            rows = ours[ours["event"] == event]
            if len(rows):
                return text_of({name: plain(rows[-1][name]) for name in rows.dtype.names})
        return ""

    def close(self) -> None:
        """Unmap."""
        self.reader.close()
        self._events.close()


class Amplifiers(Closable):
    """The amplifiers of an arm, or of setup joints, as io measures them: only io can confirm that they are off."""

    def __init__(self, system: str, name: str) -> None:
        """Attach to the record of its io in any state: a power-off command must never be prevented."""
        self._io, self._why = "io", ""
        self._simulated = is_simulated(system)
        self._reader: RingReader | None = None
        try:
            self._attach(system, name)
        except (Problem, SegmentError) as error:
            self._why = str(error)

    def _attach(self, system: str, name: str) -> None:
        document = document_of(system)
        places = [(row.io, row.robot) for row in document.arms if row.name == name]
        places += [(row.io, row.robot) for row in document.carts if row.name == name]
        for io, wanted in places:
            for place in document.io(io).places if io else ():
                if place.robot.name == wanted:  # setup joints may have none, and then no amplifiers
                    self._io, self._row, self._drives = io, place.row, place.axes
                    self._reader = directory.reader(system, io, "state", "io", often=False)

    def why_not_off(self) -> str:
        """Why it is not certain that all are off; empty if they are."""
        reader = self._reader
        if reader is None:
            return self._why
        if not reader.newest():
            return f"{self._io} has not shown its state"
        if problem := problem_of(reader, self._simulated):
            return f"{self._io}: {problem}"
        on = reader.field("amps_on")[self._row] or reader.field("amp_on")[self._drives].any()
        return f"{self._io} sees amplifiers that are on" if on else ""

    def close(self) -> None:
        """Unmap."""
        if self._reader is not None:
            self._reader.close()


def age_of(reader: RingReader, simulated: bool) -> float:
    """Age of the record last read, s; 0 where time is simulated, and stamps are."""
    return 0.0 if simulated else (monotonic_ns() - reader.stamp_ns) * 1e-9


def problem_of(reader: RingReader, simulated: bool) -> str:
    """Problem of a record that should be current, in words; empty if there is none."""
    age_s = age_of(reader, simulated)
    old = f"its last record is {age_s:.1f} s old" if age_s > FRESH_S else ""
    return "; ".join(part for part in (writer_gone(reader.gone) or old, reader.problem) if part)
