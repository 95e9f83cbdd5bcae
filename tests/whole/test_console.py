"""A console with everything it has: from what a person presses, by all processes, to who follows whom."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from tests.host.hosted import AT_200_HZ, document
from trocar.procs.console.logic import OPERATOR
from trocar.procs.host.host import Host
from trocar.procs.node.debounce import RELEASED
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.origins import Origin, new_id
from trocar.shm.mailbox.place import Place
from trocar.shm.system import directory

pytestmark = pytest.mark.slow

PERIOD_NS = 5_000_000
SETS = (*AT_200_HZ, "processes.SUJ.period_s=0.01")
CARRIED = ("ECM", "PSM1", "PSM2", "PSM3")


class Room:
    """A full robot without hardware, and a person in front of it."""

    def __init__(self, host: Host) -> None:
        self.host, name = host, host.name
        self.people = {each: Client(name, each) for each in ("system", "console", "SUJ", "MTMR_PSM1")}
        self.teleops, self.arms = ({each: directory.reader(name, each, "state", kind) for each, loop in
                                    host.loops.items() if loop.node.kind == kind} for kind in ("teleop", "arm"))
        self.cart = directory.reader(name, "SUJ", "state", "suj")
        self.console = directory.reader(name, "console", "state", "console")

    def close(self) -> None:
        for part in (*self.people.values(), *self.teleops.values(), *self.arms.values(), self.cart, self.console):
            part.close()

    def says(self, owner: str, command: str, *values: float, text: str = "", seconds: float = 0.1) -> str:
        """What became of it."""
        number = self.people[owner].send(command, values, text)
        self.host.run(seconds)
        outcomes = [reply.outcome for reply in self.people[owner].poll() if reply.id == number]
        return outcomes[-1] if outcomes else ""

    @property
    def following(self) -> set[str]:
        return {name for name, ring in self.teleops.items() if ring.newest() and ring.field("following").item()}

    def settles(self, *following: str) -> bool:
        """Whether these follow, and no others, once everybody has aligned."""
        for _ in range(20):
            if self.following == set(following):
                return True
            self.host.run(0.2)
        return False

    def homed(self) -> bool:
        return all(ring.newest() and ring.field("is_homed").item() for ring in self.arms.values())


@contextlib.contextmanager
def homed() -> Iterator[Room]:
    """The full robot, homed."""
    with Host(document("kinematic-full.yaml", sets=SETS)) as host, contextlib.closing(Room(host)) as made:
        made.says("system", "home")
        for _ in range(100):
            host.run(0.2)
            if made.homed():
                break
        yield made


@pytest.fixture(scope="module")
def room() -> Iterator[Room]:
    with homed() as made:
        yield made


@pytest.fixture
def driven(room: Room) -> Room:
    """Somebody looks into the console, and teleoperation is wanted."""
    for button in ("emulate_operator_present", "emulate_camera", "emulate_clutch", "teleop_enable"):
        assert room.says("console", button, 0.0) == "done"
    assert room.following == set()
    for button in ("teleop_enable", "emulate_operator_present"):
        assert room.says("console", button, 1.0) == "done"
    assert room.settles("MTMR_PSM1", "MTML_PSM2")
    return room


def test_a_cart_carries_all_its_arms(room: Room) -> None:
    assert room.homed() and room.cart.newest()
    assert room.cart.field("base_valid").all() and room.cart.field("valid").item()
    for name in CARRIED:
        assert room.arms[name].newest() and room.arms[name].field("reference_valid").item(), name


def test_the_camera_pedal_swaps_instruments_for_the_camera(driven: Room) -> None:
    driven.says("console", "emulate_camera", 1.0)
    assert driven.settles("MTML_MTMR_ECM")
    driven.says("console", "emulate_camera", 0.0)
    assert driven.settles("MTMR_PSM1", "MTML_PSM2")


def test_who_leaves_stops_following(driven: Room) -> None:
    driven.says("console", "emulate_operator_present", 0.0)
    assert driven.following == set()


def test_the_clutch_stops_following_until_it_is_released(driven: Room) -> None:
    driven.says("console", "emulate_clutch", 1.0)
    assert driven.following == set()
    driven.says("console", "emulate_clutch", 0.0)
    assert driven.settles("MTMR_PSM1", "MTML_PSM2")


def test_a_tap_of_the_clutch_gives_the_master_another_instrument(driven: Room) -> None:
    driven.says("console", "emulate_clutch", 2.0)
    assert driven.settles("MTMR_PSM1", "MTML_PSM3")
    driven.says("console", "emulate_clutch", 2.0)
    assert driven.settles("MTMR_PSM1", "MTML_PSM2")


def test_a_teleoperation_that_was_restarted_follows_when_presence_is_shown_again(driven: Room) -> None:
    driven.host.restart("MTMR_PSM1")
    driven.host.run(0.3)
    assert driven.settles("MTML_PSM2")
    driven.says("console", "emulate_operator_present", 0.0)
    driven.says("console", "emulate_operator_present", 1.0)
    assert driven.settles("MTMR_PSM1", "MTML_PSM2")


def test_a_console_that_was_restarted_waits_for_presence(driven: Room) -> None:
    driven.host.restart("console")
    driven.host.run(0.3)
    assert driven.following == set()
    driven.says("console", "emulate_operator_present", 1.0)
    assert driven.settles("MTMR_PSM1", "MTML_PSM2")


def test_an_emulated_operator_goes_when_its_program_dies(driven: Room) -> None:
    other = Place(driven.host.name, "console", "another program")
    other.claim()
    other.send("emulate_operator_present", (1.0,), origin=Origin(new_id(), 1 << 60, "another program"))
    driven.says("console", "teleop_enable", 1.0)
    assert driven.settles("MTMR_PSM1", "MTML_PSM2")
    other.close()
    driven.host.run(0.05)
    assert driven.following == set() and driven.console.newest() and not driven.console.field("operator_present")


def test_one_scale_reaches_every_teleoperation(driven: Room) -> None:
    for scale in (0.3, 0.2):
        driven.says("console", "set_scale", scale)
        assert [ring.newest() and ring.field("scale").item() for ring in driven.teleops.values()] == [scale] * 4


def test_a_cart_can_be_asked(room: Room) -> None:
    assert room.says("SUJ", "servo_jp", *([0.1] * 6), text="PSM2") == "done"
    assert room.cart.newest() and room.cart.field("position")[2, :6] == pytest.approx([0.1] * 6)
    assert room.says("SUJ", "servo_jp", *([0.0] * 6), text="PSM2") == "done"


def test_who_looks_away_is_heard_by_the_console(driven: Room) -> None:
    loop: Any = driven.host.loops["console"]
    poll, pressed = loop._inputs.poll, [(OPERATOR, RELEASED)]
    loop._inputs.poll = lambda now_ns: [pressed.pop()] if pressed else poll(now_ns)
    driven.host.run(0.1)
    assert driven.following == set()


def test_a_teleoperation_keeps_the_pace_of_its_master(driven: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    node, stamps, late = driven.host.loops["MTMR_PSM1"].node, [], []
    monkeypatch.setattr(node, "follow", lambda stamp_ns, lead_ns: stamps.append(stamp_ns))
    monkeypatch.setattr(node.pacing, "latency", late.append)
    for number in range(1, 4):
        driven.host.run(0.001)
        assert driven.arms["MTMR"].newest() and len(stamps) == number
        assert 0 <= driven.arms["MTMR"].stamp_ns - stamps[-1] <= PERIOD_NS
    assert len(late) == 3 and all(0 <= latency_ns < 10 * PERIOD_NS for latency_ns in late)
    driven.says("console", "emulate_operator_present", 0.0)
    late.clear()
    driven.host.run(0.001)
    assert not late, "nothing reacts to anything"


def test_a_teleoperation_that_refuses_is_reported_once(driven: Room, monkeypatch: pytest.MonkeyPatch) -> None:
    loop: Any = driven.host.loops["console"]
    reported: list[str] = []
    monkeypatch.setattr(driven.host.loops["console"].node.events, "report", lambda code, text,
                        component: reported.append(text))
    for _ in range(2):
        assert loop._desk.ask("MTMR_PSM1", "clutch", (-1.0,))
        driven.host.run(0.05)
    assert len(reported) == 1 and reported[0].startswith("MTMR_PSM1 refuses: clutch")
