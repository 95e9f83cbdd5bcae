"""Fault generations: commands given before a fault are void after it.

One page per system with three cells for each component (an arm, setup joints, a robot of an io), written by its owner
alone:

Fault (owner):    F1 count := count + 1       F2 void := fault := sum of all counts
Stop (owner):     the same, but `fault` stays
Command (person): G1 generation := sum of all counts, before the command is sent
Check (owner):    the command counts when its generation ≥ void of the component

The sum is the system's fault generation: how many faults there were. Counts only grow, so a sum that was taken before
F1 is smaller than that of F2, one that was taken after F2 is not. No clock is compared with another; a fault of one
component does not affect commands to the others. A stop by a person, which is a power-off or the hold of an arm that is
not homed, is not a fault: it voids earlier commands to that component, and processes that work with others continue.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from trocar.shm.mailbox.guard import authorizes
from trocar.shm.mailbox.origins import Origin
from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.rows import Field, Topic
from trocar.shm.memory.segment import Make, Segment, SegmentError, create, segment_name
from trocar.shm.ring.ring import attach

WORD = (1 << 64) - 1

PAGE = Topic("faults", writer="supervisor", depth=1, fields=(
    Field("count", "(components,)<u8", "", "how often commands to this component became void; by its owner"),
    Field("fault", "(components,)<u8", "", "generation of its last fault, 0: there was none; by its owner"),
    Field("void", "(components,)<u8", "", "commands of an earlier generation are void; by its owner"),
))


def robot_component(io: str, robot: str) -> str:
    """The name of a robot of an io among the components."""
    return f"{io}/{robot}"


class NoFaults:
    """A component without faults of its own: every person's command counts."""

    valid_from = exempt_origin = 0

    def fault(self) -> None:
        """No effect."""

    def void_earlier(self, origin: Origin) -> None:
        """No command becomes void."""


def create_faults(system: str, components: Sequence[str], make: Make = create) -> int:
    """Make the page of a system; returns its size."""
    schema = schema_of(PAGE, {"components": len(components)})
    return make(segment_name(system, "supervisor", "faults"), "faults", schema, 1, {"components": list(components)})


class Faults:
    """The page, for any reader."""

    def __init__(self, system: str, *, write: bool = False) -> None:
        """Attach; SegmentError if the system has no such page."""
        self._segment = segment = Segment(segment_name(system, "supervisor", "faults"), write=write)
        try:
            components = segment.header.info.get("components")
            if not (isinstance(components, list) and all(isinstance(name, str) for name in components)):
                raise SegmentError(f"{segment.name}: its list of components is not readable")
            schema = schema_of(PAGE, {"components": len(components)})
            attach(segment, "faults", schema)
        except BaseException:
            segment.close()
            raise
        self.components: tuple[str, ...] = tuple(components)
        first, places = segment.header.first, range(len(components))
        self.words = segment.words()
        self._counts, self._faults, self._voids = ([(first + schema.offset(name)) // 8 + place for place in places]
                                                   for name in ("count", "fault", "void"))

    def generation(self) -> int:
        """Number of faults in the system so far."""
        words = self.words
        return sum([words[at] for at in self._counts]) & WORD  # G1

    def void(self, component: str) -> int:
        """The generation before which commands to a component are void; 0 for an unknown name."""
        return self.words[self._voids[self.components.index(component)]] if component in self.components else 0

    def cell(self, component: str) -> tuple[int, int, int]:
        """Positions of `count`, `fault` and `void` of a component in `words`; KeyError if it has none."""
        if component not in self.components:
            raise KeyError(f"no component {component}; there are {', '.join(self.components)}")
        place = self.components.index(component)
        return self._counts[place], self._faults[place], self._voids[place]

    @property
    def address(self) -> int:
        """Address of `words`."""
        return self._segment.address

    def close(self) -> None:
        """Unmap."""
        self._segment.close()


class FaultCell:
    """The cell of one component, for its owner."""

    def __init__(self, faults: Faults, component: str) -> None:
        """`faults` is attached with write; KeyError if it has no such component."""
        self._page = faults
        self._count, self._fault, self._void = faults.cell(component)
        self.valid_from: int = faults.words[self._void]
        """Commands of an earlier generation are void."""
        self.exempt_origin = 0
        """But the command with this number stays valid: it has itself stopped the component."""

    def fault(self) -> None:
        """A fault has happened: earlier commands are void from now on."""
        self._next(0)
        self._page.words[self._fault] = self.valid_from

    def void_earlier(self, origin: Origin) -> None:
        """The command `origin` stopped the component: it stays valid if it was; all earlier ones are void."""
        self._next(origin.id if authorizes(origin, self) else 0)

    def _next(self, exempt_origin: int) -> None:
        words = self._page.words
        words[self._count] = words[self._count] + 1 & WORD  # F1
        self.exempt_origin = exempt_origin
        self.valid_from = words[self._void] = self._page.generation()  # F2


class Watched:
    """The last fault of some components, for a process that uses them: a Cell whose `valid_from` others advance."""

    exempt_origin = 0

    def __init__(self, faults: Faults, components: Sequence[str]) -> None:
        """Names that are not components, such as third-party programs, have no faults."""
        self._faults, self._words = faults, faults.words
        self._places = [faults.cell(name)[1] for name in components if name in faults.components]

    @property
    def addresses(self) -> list[int]:
        """Addresses of the words that change with a fault; see Segment.address."""
        return [self._faults.address + 8 * at for at in self._places]

    @property
    def valid_from(self) -> int:
        """Commands of an earlier generation are void."""
        words = self._words
        return max([words[at] for at in self._places], default=0)


OwnCell: TypeAlias = FaultCell | NoFaults
"""The owner's record of its component's faults."""
Cell: TypeAlias = OwnCell | Watched
