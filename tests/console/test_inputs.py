"""Pedals and head sensors: levels from io's record, clicks from its events, presence by three beams of four."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.procs.console.goovis import LOOK_AGAIN_NS, Goovis, find
from trocar.procs.console.inputs import Inputs
from trocar.procs.document.consoles import HidSensor
from trocar.procs.document.system import Console, WiredInput
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.node.inputs import LATE_NS
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import EVENTS, IO_STATE, Topic

GOOVIS = HidSensor(0x880A, 0x3501, 17)
NAMES = ("clutch", "camera", "coag", "beam_1", "beam_2", "beam_3", "beam_4")
DIMS = {"axes": 0, "drives": 0, "robots": 0, "inputs": len(NAMES), "outputs": 0, "readers": 0}
PEDALS = Console("c", "PEDALS_ONLY", 0.01, (), WiredInput("IO1", "clutch"), WiredInput("IO1", "camera"),
                 (WiredInput("IO1", "coag"),))
BEAMS = Console("c", "PEDALS_ISI_HEAD_SENSOR", 0.01, (), WiredInput("IO1", "clutch"), WiredInput("IO1", "camera"),
                tuple(WiredInput("IO1", name) for name in NAMES[3:]), 3)
SYSTEM: Any = SimpleNamespace(inputs=lambda name: NAMES)


class FakeInputRing:
    """The newest record of a ring, and events that wait."""

    epoch = 1

    def __init__(self, topic: Topic) -> None:
        self._record: Any = np.zeros(1, dtype=schema_of(topic, DIMS if topic is IO_STATE else {}).dtype)
        self.stamp_ns = 0
        self.waiting: list[tuple[str, str]] = []

    def field(self, name: str) -> Any:
        return self._record[name].reshape(self._record[name].shape[1:])

    def newest(self) -> bool:
        return self.stamp_ns > 0

    def next(self) -> bool:
        if self.waiting:
            component, code = self.waiting.pop(0)
            for name, text in (("event", "button"), ("component", component), ("code", code)):
                self.field(name)[...] = text.encode()
            return True
        return False


class Wired:
    """A console's inputs on rings that a test writes."""

    def __init__(self, row: Console = PEDALS, *, began_anew: bool = False) -> None:
        self.rings = {"state": FakeInputRing(IO_STATE), "events": FakeInputRing(EVENTS)}
        self.now_ns = 1_000_000_000
        self.hold()
        self.inputs = Inputs(row, SYSTEM, lambda io, topic: self.rings[topic], None, began_anew=began_anew)

    def hold(self, *pressed: str) -> None:
        self.rings["state"].stamp_ns = self.now_ns
        self.rings["state"].field("input")[...] = [name in pressed for name in NAMES]

    def see(self, *pressed: str) -> list[tuple[str, int]]:
        self.now_ns += 10_000_000
        self.hold(*pressed)
        return self.inputs.poll(self.now_ns)


def test_levels_become_buttons() -> None:
    wired = Wired()
    assert wired.see() == []
    assert wired.see("coag", "clutch") == [("operator_present", PRESSED), ("clutch", PRESSED)]
    assert wired.see("coag") == [("clutch", RELEASED)]
    assert wired.see() == [("operator_present", RELEASED)]


def test_clicks_come_from_events() -> None:
    wired = Wired()
    wired.rings["events"].waiting = [("clutch", "clicked"), ("beam_1", "clicked"), ("camera", "pressed")]
    assert wired.see() == [("clutch", CLICKED)]


@pytest.mark.parametrize("count", range(5))
def test_three_beams_of_four_see_the_operator(count: int) -> None:
    wired = Wired(BEAMS)
    found = wired.see(*NAMES[3 : 3 + count])
    assert found == ([("operator_present", PRESSED)] if count >= 3 else []) and wired.inputs.seen == count


def test_silent_io_means_an_absent_operator_until_seen_released() -> None:
    wired = Wired()
    wired.see("coag", "clutch")
    wired.now_ns += LATE_NS + 1
    assert wired.inputs.poll(wired.now_ns) == [("operator_present", RELEASED)] and not wired.inputs.valid
    assert wired.see("coag", "clutch") == [] and wired.inputs.valid, "the pedal was not let go meanwhile"
    wired.see()
    assert ("operator_present", PRESSED) in wired.see("coag")


def test_console_that_began_anew_wants_presence_shown_again() -> None:
    wired = Wired(began_anew=True)
    assert wired.see("coag", "camera", "clutch") == [("clutch", PRESSED)]
    wired.see()
    assert wired.see("coag") == [("operator_present", PRESSED)]


def test_goovis_is_found_by_its_numbers(tmp_path: Path) -> None:
    for name, text in (("hidraw0", "HID_ID=0003:0000046D:0000C52B"), ("hidraw1", "HID_ID=0003:0000880A:00003501")):
        (tmp_path / name / "device").mkdir(parents=True)
        (tmp_path / name / "device/uevent").write_text(text)
    assert find(GOOVIS, tmp_path, Path("/dev")) == Path("/dev/hidraw1")
    assert find(HidSensor(0x046D, 0xC52B, 0), tmp_path, Path("/dev")) == Path("/dev/hidraw0")
    assert find(GOOVIS, tmp_path / "nothing") is None


def test_goovis_tells_presence_by_its_byte(tmp_path: Path) -> None:
    reported: list[str] = []
    places: list[Path | None] = [None]
    head = Goovis(GOOVIS, reported.append, lambda sensor: places[0])
    assert not head.present(0) and not head.present(1)
    assert len(reported) == 1 and "no head sensor (USB 880a:3501)" in reported[0]
    pipe = tmp_path / "hidraw"
    os.mkfifo(pipe)
    keep = os.open(pipe, os.O_RDWR)
    places[0] = pipe
    os.write(keep, bytes(17) + b"\1" + bytes(46))
    assert head.present(LOOK_AGAIN_NS)
    os.write(keep, bytes(64))
    assert not head.present(LOOK_AGAIN_NS + 1)
    os.write(keep, bytes(17) + b"\1" + bytes(46))
    assert head.present(LOOK_AGAIN_NS + 2)
    os.close(keep)
    assert not head.present(LOOK_AGAIN_NS + 3) and "gone" in reported[-1]
