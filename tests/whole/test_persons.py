"""Whatever happens in whatever order: each power-on, homing and motion comes from a person's command given since the
last fault, power-off or start of io; and a person who asks for it gets it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any, Final

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from tests.examples import examples
from tests.host.hosted import AT_200_HZ, document
from trocar.procs.host.host import Host
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.tables import codes
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.generations import Faults
from trocar.shm.system import directory

STEP_S: Final = 0.005
ARMS: Final = ("MTMR", "PSM1")
UP: Final = ("POWERING", "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS", "ENCODERS_BIASED", "HOMING", "HOMED")
PEDALS: Final = st.tuples(st.just("pedal"), st.sampled_from(("operator_present", "clutch", "camera")),
                          st.sampled_from((PRESSED, RELEASED, CLICKED)))
WORDS: Final = st.tuples(st.just("person"), st.sampled_from((*ARMS, "MTMR_PSM1")), st.just("state_command"),
                         st.just(()),
                         st.sampled_from(("enable", "disable", "home", "pause", "resume", "unhome", "align_MTM")))
WHOLE: Final = st.tuples(st.just("person"), st.just("system"), st.sampled_from(("home", "power_on", "power_off")),
                         st.just(()), st.just(""))
WANTED: Final = st.tuples(st.just("person"), st.just("console"), st.just("teleop_enable"),
                          st.sampled_from(((0.0,), (1.0,))), st.just(""))
EVENTS: Final = st.one_of(
    PEDALS, PEDALS, WORDS, WHOLE, WANTED,
    st.tuples(st.just("fault"), st.sampled_from(ARMS), st.sampled_from((codes.POWER_LOST, codes.TRACKING))),
    st.tuples(st.just("restart"), st.sampled_from(("io", *ARMS, "MTMR_PSM1", "console", "system"))),
    st.tuples(st.just("wait"), st.integers(1, 60)),
)


class Judge:
    """Watches arms and io: what comes up must have been asked for by a person since it went down."""

    def __init__(self, host: Host) -> None:
        self.host, name = host, host.name
        self.page = Faults(name)
        self.given: dict[int, int] = {}
        """Fault generation of each person's command, by its number."""
        self.clients = {each: Client(name, each) for each in host.loops if each != "io"}
        self.arms = {arm: directory.reader(name, arm, "state", "arm") for arm in ARMS}
        self.asked = {arm: directory.reader(name, arm, "audit", "arm") for arm in ARMS}
        self.io = directory.reader(name, "io", "state", "io")
        self.powered_by = directory.reader(name, "io", "audit", "io")
        self.wanted = dict.fromkeys(ARMS, False)
        self.states = dict.fromkeys(ARMS, "DISABLED")
        self.valid_from = dict.fromkeys(ARMS, 0)
        """The generation since which commands count."""
        self.exempt_origin = dict.fromkeys(ARMS, 0)

    def close(self) -> None:
        for part in (*self.clients.values(), *self.arms.values(), *self.asked.values(), self.io, self.powered_by,
                     self.page):
            part.close()

    def person(self, owner: str, command: str, values: tuple[float, ...], text: str) -> int:
        client = self.clients[owner]
        client.poll()
        client.send(command, values, text)
        self.given[client.origin.id] = self.page.generation()
        return client.origin.id

    def step(self) -> None:
        self.host.run(STEP_S)
        assert self.io.newest()
        robots = list(self.io.info["robots"])
        for arm in ARMS:
            self._power(arm, bool(self.io.field("power_requested")[robots.index(arm)]))
            self._state(arm)

    def _power(self, arm: str, wanted: bool) -> None:
        before, self.wanted[arm] = self.wanted[arm], wanted
        if wanted and not before:
            row = self._last(self.powered_by, b"power_on", arm)
            self._check(arm, row, "io powers it")
        elif before and not wanted:
            self.exempt_origin[arm] = self._switched_off(arm)
            self.valid_from[arm] = self.page.generation()

    def _switched_off(self, arm: str) -> int:
        """The person's command that took the power away: it counts on; a fault: none does."""
        rows = [row for row in self.asked[arm].since(0) if row["command"] == b"state_command"]
        last = rows[-1] if rows else None
        is_disable = last is not None and last["text"] == b"disable" and last["outcome"] in (b"accepted", b"done")
        return int(last["origin"]) if is_disable and not self.io.field("fault").any() else 0

    def _state(self, arm: str) -> None:
        assert self.arms[arm].newest()
        before, now = self.states[arm], self.arms[arm].field("sub_state").item().decode()
        self.states[arm] = now
        if now in UP and before not in UP and before != "PAUSED":
            self._check(arm, self._last(self.asked[arm], b"state_command", "enable"), f"it goes {before} → {now}")

    def _last(self, ring: Any, command: bytes, text: str) -> Any:
        rows = [row for row in ring.since(0) if row["command"] == command and row["text"] == text.encode()
                and row["outcome"] in (b"accepted", b"done")]
        assert rows, f"{text}: nobody asked for {command!r}"
        return rows[-1]

    def _check(self, arm: str, row: Any, what: str) -> None:
        origin = int(row["origin"])
        assert origin in self.given, f"{arm}: {what}, by {row['program']!r}, which is no person"
        assert self.given[origin] >= self.valid_from[arm] or origin == self.exempt_origin[arm], (
            f"{arm}: {what} by a command of generation {self.given[origin]}, void before {self.valid_from[arm]}")


@contextlib.contextmanager
def judged() -> Iterator[Judge]:
    """A system of its own, and its judge."""
    with Host(document("kinematic-teleop.yaml", sets=AT_200_HZ)) as host, contextlib.closing(Judge(host)) as judge:
        yield judge


def happens(judge: Judge, event: tuple[Any, ...]) -> None:
    """One event, and the cycle after it."""
    host = judge.host
    match event:
        case "pedal", button, kind:
            host.loops["console"]._logic.press(button, kind)  # type: ignore[attr-defined]
        case "person", owner, command, values, text:
            judge.person(owner, command, values, text)
        case "fault", arm, fault:
            core: Any = host.loops["io"]._core  # type: ignore[attr-defined]
            core.reports.trip(fault, core.robots.names.index(arm))
        case "restart", instance:
            host.restart(instance)
        case "wait", cycles:
            for _ in range(cycles):
                judge.step()
    judge.step()


def check(judge: Judge, events: list[tuple[Any, ...]]) -> None:
    """The random events; then nobody does anything but pedals, and a person can still have it all."""
    for event in events:
        happens(judge, event)
    for _ in range(20):
        judge.step()
    for arm in ARMS:
        if judge.states[arm] == "PAUSED":  # homing is not what a paused arm waits for
            judge.person(arm, "state_command", (), "resume")
    judge.step()
    judge.person("system", "home", (), "")
    for _ in range(1500):
        judge.step()
        if all(state == "HOMED" for state in judge.states.values()):
            return
    pytest.fail(f"a person asked for home; arms are {judge.states}")


TOO_SLOW: Final = [HealthCheck.too_slow]


@given(st.lists(EVENTS, max_size=20))
@examples(10, suppress_health_check=TOO_SLOW)
def test_every_power_on_ends_in_a_persons_command_of_the_present_generation(
    events: list[tuple[Any, ...]]
) -> None:
    with judged() as judge:
        check(judge, events)


@pytest.mark.soak
@given(st.lists(EVENTS, max_size=60))
@examples(50, suppress_health_check=TOO_SLOW)
def test_every_power_on_ends_in_a_persons_command_of_the_present_generation_for_long(
    events: list[tuple[Any, ...]]
) -> None:
    with judged() as judge:
        check(judge, events)


def test_a_pedal_does_not_power_what_a_fault_switched_off() -> None:
    with judged() as judge:
        pedals_after_a_fault(judge)


def pedals_after_a_fault(judge: Judge) -> None:
    for event in (("person", "console", "teleop_enable", (1.0,), ""), ("pedal", "operator_present", PRESSED)):
        happens(judge, event)
    homed = {"MTMR": "HOMED", "PSM1": "HOMED"}  # by the chain console, teleoperation, arm, io
    for _ in range(60):
        if judge.states != homed:
            happens(judge, ("wait", 20))
    assert judge.states == homed
    happens(judge, ("fault", "PSM1", codes.POWER_LOST))
    for event in (("wait", 5), ("pedal", "operator_present", RELEASED), ("wait", 5),
                  ("pedal", "operator_present", PRESSED), ("wait", 60), ("restart", "console"), ("wait", 60),
                  ("restart", "MTMR_PSM1"), ("pedal", "operator_present", PRESSED), ("wait", 60)):
        happens(judge, event)
        assert judge.states["PSM1"] == "FAULT" and not judge.wanted["PSM1"]
