"""What io sees of an arm's amplifiers: only that tells that they are off."""

from __future__ import annotations

from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.tools.inspect.watch import document_of, problem_of
from trocar.tools.output.errors import Problem
from trocar.tools.systems.find import is_simulated


class Amplifiers:
    """Those of one arm, or of setup joints; a context manager."""

    def __init__(self, system: str, name: str) -> None:
        """Attach to the record of its io, whatever that is like: who wants power off must not be kept from asking."""
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
            robots = document.io(io).robots if io else ()
            first = 0
            for row, robot in enumerate(robots):
                end = first + len(robot.actuators)
                if robot.name == wanted:  # setup joints may have none, and then no amplifiers
                    self._io, self._row, self._drives = io, row, slice(first, end)
                    self._reader = directory.reader(system, io, "state", "io")
                first = end

    def why_not_off(self) -> str:
        """Why it cannot be said that all are off; empty when they are."""
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

    def __enter__(self) -> Amplifiers:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
