"""A console's inputs against what is to be seen of them: levels, clicks, presence, and what is not known."""

from __future__ import annotations

import os
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest

from tests.console.test_inputs import NAMES, FakeInputRing
from trocar.procs.console import goovis
from trocar.procs.console.goovis import LOOK_AGAIN_NS, Goovis, find
from trocar.procs.console.inputs import Inputs
from trocar.procs.document.consoles import HidSensor
from trocar.procs.document.system import Console, WiredInput
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.node.inputs import LATE_NS
from trocar.shm.topics import EVENTS, IO_STATE

MS = 1_000_000
LONG = "a_pedal_whose_name_is_as_long_as_names_are"  # events have 24 letters of it
HEAD = HidSensor(0x880A, 0x3501, 2)


class TwoIos:
    """Pedals on one io, the head sensor's beams on another."""

    def __init__(self, count: int, *, began_anew: bool) -> None:
        beams = tuple(WiredInput("IO2", name) for name in ("beam_1", "beam_2"))
        row = Console("c", "PEDALS_ISI_HEAD_SENSOR", 0.01, (), WiredInput("IO1", "clutch"), WiredInput("IO1", LONG),
                      beams, count)
        self.names = {"IO1": (LONG, *NAMES[:-1]), "IO2": NAMES}
        self.rings = {(io, topic): FakeInputRing(kind) for io in ("IO1", "IO2")
                      for topic, kind in (("state", IO_STATE), ("events", EVENTS))}
        for (_, topic), ring in self.rings.items():
            ring.head = ring.sequence = 0  # type: ignore[attr-defined]
            ring.stamp_ns = 1 if topic == "state" else 0
        system: Any = SimpleNamespace(inputs=lambda io: self.names[io])
        self.inputs = Inputs(row, system, lambda io, topic: self.rings[io, topic], None,  # type: ignore[arg-type]
                             began_anew=began_anew)

    def hold(self, io: str, name: str, on: bool) -> None:
        self.rings[io, "state"].field("input")[self.names[io].index(name)] = on


@pytest.mark.parametrize(("count", "began_anew"), [(1, False), (2, False), (2, True)])
def test_buttons_are_those_of_a_plain_model(count: int, began_anew: bool) -> None:
    ios, chance, now_ns = TwoIos(count, began_anew=began_anew), Random(count), 1_000 * MS
    held = dict.fromkeys(("clutch", LONG, "beam_1", "beam_2"), False)
    place = {"clutch": "IO1", LONG: "IO1", "beam_1": "IO2", "beam_2": "IO2"}
    alive = {"IO1": True, "IO2": True}
    unproved = {"operator_present", "camera"} if began_anew else set[str]()
    levels = {"operator_present": False, "clutch": False, "camera": False}
    for _ in range(600):
        now_ns += 10 * MS
        if chance.random() < 0.3:
            name = chance.choice(list(held))
            held[name] = not held[name]
        if chance.random() < 0.05:
            io = chance.choice(("IO1", "IO2"))
            alive[io] = not alive[io]
        clicked = [(io, chance.choice(("clutch", LONG, "beam_1"))) for io in ("IO1", "IO2") if chance.random() < 0.1]
        for name, on in held.items():
            ios.hold(place[name], name, on)
        for io, fresh in alive.items():
            ios.rings[io, "state"].stamp_ns = now_ns if fresh else now_ns - LATE_NS - 1
            ios.rings[io, "events"].waiting = [(name[:24], "clicked") for at, name in clicked if at == io]
        seen = sum(held[beam] for beam in ("beam_1", "beam_2")) if alive["IO2"] else 0
        expected, known = [], {"operator_present": alive["IO2"], "clutch": alive["IO1"], "camera": alive["IO1"]}
        now = {"operator_present": seen >= count, "clutch": held["clutch"], "camera": held[LONG]}
        for button in levels:
            if not known[button]:
                if button == "clutch":
                    continue
                unproved.add(button)
            elif not now[button]:
                unproved.discard(button)
            level = known[button] and now[button] and button not in unproved
            if level != levels[button]:
                levels[button] = level
                expected.append((button, PRESSED if level else RELEASED))
        buttons = {"clutch": "clutch", LONG: "camera"}
        expected += [(buttons[name], CLICKED) for io, name in clicked if io == "IO1" and name in buttons]
        assert ios.inputs.poll(now_ns) == expected
        assert ios.inputs.valid is all(known.values()) and ios.inputs.seen == seen


def test_an_input_counts_as_long_as_its_sample_is_fresh() -> None:
    ios = TwoIos(1, began_anew=False)
    for io in ("IO1", "IO2"):
        ios.rings[io, "state"].stamp_ns = 1_000 * MS
        ios.rings[io, "state"].field("age_ns")[...] = 10 * MS
    ios.hold("IO2", "beam_1", True)
    assert ios.inputs.poll(1_000 * MS + LATE_NS - 10 * MS) == [("operator_present", PRESSED)]
    assert ios.inputs.poll(1_001 * MS + LATE_NS - 10 * MS) == [("operator_present", RELEASED)]
    assert not ios.inputs.valid


def test_news_are_events_that_were_not_read_yet() -> None:
    ios = TwoIos(1, began_anew=False)
    assert not ios.inputs.has_news
    for io in ("IO1", "IO2"):
        ios.rings[io, "events"].head += 1  # type: ignore[attr-defined]
        assert ios.inputs.has_news
        ios.rings[io, "events"].sequence += 1  # type: ignore[attr-defined]
        assert not ios.inputs.has_news


def test_only_clicks_of_buttons_are_clicks() -> None:
    ios = TwoIos(1, began_anew=False)
    ring = ios.rings["IO1", "events"]
    for component, code in (("clutch", "pressed"), ("coag", "clicked")):
        ring.waiting = [(component, code)]
        assert CLICKED not in [kind for _, kind in ios.inputs.poll(1_000 * MS)]
    ring.waiting = [("clutch", "clicked")]
    following = ring.next

    def other() -> bool:
        found = following()
        ring.field("event")[...] = b"status"
        return found

    ring.next = other  # type: ignore[method-assign]
    assert CLICKED not in [kind for _, kind in ios.inputs.poll(1_000 * MS)]


def test_a_console_without_wired_inputs_sees_nobody_and_nothing_is_wrong() -> None:
    inputs = Inputs(Console("c", "SIMULATED", 0.01), SimpleNamespace(), lambda io, topic: None,  # type: ignore[arg-type]
                    None, began_anew=True)
    assert inputs.poll(1) == [] and inputs.valid and inputs.seen == 0 and not inputs.has_news


def test_a_head_sensor_that_is_not_wired_decides_alone() -> None:
    worn = [False]
    head = SimpleNamespace(present=lambda now_ns: worn[0])
    inputs = Inputs(Console("c", "PEDALS_GOOVIS_HEAD_SENSOR", 0.01), SimpleNamespace(),  # type: ignore[arg-type]
                    lambda io, topic: None, head, began_anew=False)  # type: ignore[arg-type,return-value]
    assert inputs.poll(1) == [] and inputs.seen == 0
    worn[0] = True
    assert inputs.poll(2) == [("operator_present", PRESSED)] and inputs.seen == 1 and inputs.valid
    worn[0] = False
    assert inputs.poll(3) == [("operator_present", RELEASED)] and inputs.seen == 0


# -- the head sensor on USB --------------------------------------------------------------------------------------------


class Plug:
    """A device file that comes and goes."""

    def __init__(self, folder: Path) -> None:
        self.path, self.there, self.said = folder / "hidraw", False, list[str]()
        self.searches = 0
        os.mkfifo(self.path)
        self.end = os.open(self.path, os.O_RDWR)
        self.head = Goovis(HEAD, self.said.append, self.search)

    def search(self, sensor: HidSensor) -> Path | None:
        self.searches += 1
        return self.path if self.there else None

    def report(self, *values: int) -> None:
        os.write(self.end, bytes(values))


@pytest.fixture
def plug(tmp_path: Path) -> Any:
    made = Plug(tmp_path)
    yield made
    made.head.close()
    os.close(made.end)


def test_the_head_sensor_is_looked_for_every_second_and_said_once(plug: Plug) -> None:
    for now_ns, searches in ((5, 1), (4 + LOOK_AGAIN_NS, 1), (5 + LOOK_AGAIN_NS, 2), (6 + LOOK_AGAIN_NS, 2)):
        assert not plug.head.present(now_ns) and plug.searches == searches
    assert plug.said == ["no head sensor (USB 880a:3501) is there: the operator counts as absent"]
    plug.there = True
    assert not plug.head.present(5 + 2 * LOOK_AGAIN_NS), "it has not reported yet"
    assert plug.said[1:] == [f"head sensor {plug.path} found"]


def test_the_newest_report_that_is_long_enough_tells_whether_it_is_worn(plug: Plug) -> None:
    plug.there = True
    for now_ns, reports, worn in ((1, [(0, 0, 1)], True), (2, [(1, 1)], True), (3, [], True), (4, [(1, 1, 0)], False),
                                  (5, [(0, 0, 7, 0)], True)):
        for report in reports:
            plug.report(*report)
        assert plug.head.present(now_ns) is worn
    assert plug.searches == 1


def test_a_head_sensor_that_cannot_be_opened_or_read_is_said_with_the_reason(
        plug: Plug, monkeypatch: pytest.MonkeyPatch) -> None:
    plug.there = True
    monkeypatch.setattr(goovis.os, "open", lambda *_: (_ for _ in ()).throw(PermissionError(13, "Permission denied")))
    assert not plug.head.present(1)
    assert plug.said == [f"head sensor {plug.path} cannot be opened (Permission denied): the operator counts as absent"]
    monkeypatch.undo()
    plug.report(0, 0, 1)
    assert plug.head.present(1 + LOOK_AGAIN_NS)
    with monkeypatch.context() as patch:
        patch.setattr(goovis.os, "read", lambda *_: (_ for _ in ()).throw(OSError(19, "gone")))
        assert not plug.head.present(2 + LOOK_AGAIN_NS)
    assert plug.said[-1] == "the head sensor is gone: the operator counts as absent"
    assert not plug.head.present(3 + LOOK_AGAIN_NS), "it is looked for in a second"
    assert not plug.head.present(1 + 2 * LOOK_AGAIN_NS) and plug.said[-1] == f"head sensor {plug.path} found"
    plug.report(0, 0, 1)
    assert plug.head.present(2 + 2 * LOOK_AGAIN_NS)
    plug.head.close()
    assert not plug.head.present(3 + 2 * LOOK_AGAIN_NS), "given back"


def test_a_device_whose_description_cannot_be_read_is_passed_over(tmp_path: Path) -> None:
    for name, text in (("hidraw1", None), ("hidraw2", "HID_ID=0003:0000880a:00003501\n")):
        (tmp_path / name / "device").mkdir(parents=True)
        if text is not None:
            (tmp_path / name / "device/uevent").write_text(text)
    assert find(HEAD, tmp_path, Path("/dev")) == Path("/dev/hidraw2")
