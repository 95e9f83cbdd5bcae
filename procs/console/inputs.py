"""The inputs of a console: pressed and released by io's record, clicks by its events, presence by a head sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from trocar.procs.console.goovis import Goovis
from trocar.procs.console.logic import CAMERA, CLUTCH, OPERATOR
from trocar.procs.document.system import Console, SystemConfig, WiredInput
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.node.inputs import Input
from trocar.shm.ring.ring import RingReader

BUTTON, CLICK = b"button", b"clicked"


class InputLine:
    """One digital input of an io, or button of a third-party program."""

    __slots__ = ("_age", "_index", "_input", "_record", "name")

    def __init__(self, record: Input, index: int, name: str) -> None:
        """`index` is its place in the record."""
        self._record, self._index, self.name = record, index, name.encode()
        self._input, self._age = record.field("input"), record.field("age_ns")

    def pressed(self, now_ns: int) -> bool | None:
        """Whether the debounced input is pressed; None: no current value is known."""
        self._record.look(now_ns)
        return bool(self._input[self._index]) if self._record.sampled(int(self._age)) else None


class Inputs:
    """All inputs of a console. An input that is pressed when a console restarts must be released first."""

    def __init__(self, row: Console, system: SystemConfig, reads: Callable[[str, str], RingReader],
                 head: Goovis | None, *,
                 began_anew: bool) -> None:
        """`reads(instance, topic)` attaches to a ring, `head` is the Goovis's."""
        self._levels: dict[str, bool] = dict.fromkeys((OPERATOR, CLUTCH, CAMERA), False)
        self._unproved = {OPERATOR, CAMERA} if began_anew else set[str]()
        self._head, self._needed = head, row.present_count
        self.valid, self.seen = True, 0
        states: dict[str, Input] = {}
        self._clicks: list[tuple[RingReader, dict[bytes, str]]] = []

        def line(wired: WiredInput | None) -> InputLine | None:
            if wired is None:
                return None
            if wired.io not in states:
                states[wired.io] = Input(reads(wired.io, "state"))
            return InputLine(states[wired.io], system.inputs(wired.io).index(wired.name), wired.name)

        self._lines = {CLUTCH: line(row.clutch), CAMERA: line(row.camera)}
        self._present = [found for wired in row.operator_present if (found := line(wired)) is not None]
        for io in states:
            names = {wired.name.encode()[:24]: button for button, wired in ((CLUTCH, row.clutch), (CAMERA, row.camera))
                     if wired is not None and wired.io == io}
            events = reads(io, "events")
            events.newest()
            self._clicks.append((events, names))

    @property
    def has_news(self) -> bool:
        """Whether an io has published since the last `poll`; it publishes every input that changes."""
        return any(events.head != events.sequence for events, _ in self._clicks)

    def poll(self, now_ns: int) -> list[tuple[str, int]]:
        """Buttons with PRESSED, RELEASED or CLICKED since the last call; releases first."""
        found: list[tuple[str, int]] = []
        self.valid = True
        for button, level in ((OPERATOR, self._operator(now_ns)), *self._pedals(now_ns)):
            if level is None:
                self.valid = False
                if button == CLUTCH:  # unknown; keep the last value
                    continue
                self._unproved.add(button)
            elif not level:
                self._unproved.discard(button)
            new = bool(level) and button not in self._unproved
            if new != self._levels[button]:
                self._levels[button] = new
                found.append((button, PRESSED if new else RELEASED))
        found += [(button, CLICKED) for button in self._clicked()]
        return found

    def _operator(self, now_ns: int) -> bool | None:
        if self._head is not None:
            self.seen = int(self._head.present(now_ns))
            return self.seen >= self._needed
        values = [line.pressed(now_ns) for line in self._present]
        self.seen = sum(value is True for value in values)
        return None if None in values else bool(values) and self.seen >= self._needed

    def _pedals(self, now_ns: int) -> Iterator[tuple[str, bool | None]]:
        for button, line in self._lines.items():
            yield button, line.pressed(now_ns) if line is not None else False

    def _clicked(self) -> Iterator[str]:
        for events, names in self._clicks:
            while events.next():
                button = names.get(events.field("component").item())
                if button and events.field("event").item() == BUTTON and events.field("code").item() == CLICK:
                    yield button
