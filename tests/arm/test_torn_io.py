"""Records of io that cannot be read whole: the arm goes by the last good one, and by its age."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.arm.fake_io import AXES, PERIOD_NS, ArmHarness, View
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.loop import LastGood
from trocar.procs.arm.psm.psm import PsmLogic
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.node.inputs import LATE_NS
from trocar.procs.tables import codes
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import HEAD
from trocar.shm.system import directory
from trocar.shm.topics import IO_STATE

GARBAGE = b"\xc7"  # every flag is set, every number is far away


class TornHarness(ArmHarness):
    """A rig whose io writes a real ring, which can be spoilt."""

    def __init__(self, system: str) -> None:
        dims = {"axes": AXES + 2, "drives": AXES + 2, "robots": 2, "inputs": 1, "outputs": 0}
        directory.create_ring(system, "IO1", IO_STATE, dims, {})
        self.ring = directory.writer(system, "IO1", "state", "io")
        self.reader = directory.reader(system, "IO1", "state", "io")
        self.hand = Segment(segment_name(system, "IO1", "state"), write=True)
        self.seen = LastGood(self.reader)
        self.torn = False
        super().__init__()

    def start_arm(self) -> None:
        view = View(self.ring.field)
        for name, value in (("position", self.io.position), ("setpoint_position", self.io.setpoint)):
            view[name][2:] = value
        self.io.record = view
        super().start_arm()
        self.arm = PsmLogic(self.document, ArmContext(
            self.seen.field, 1, 2, {}, False, self.io, self.state.field, self.setpoint.field, self.reports,
            lambda code: FaultReport(codes.IO_FAULT, f"fault number {code}")))

    def step(self, *requests: Any) -> None:
        self.now_ns += self.period_ns
        self.io.cycle(self.now_ns, self.setpoint)
        self.ring.publish(self.now_ns)
        if self.torn:
            self.tear()
        self.seen.take()
        self.arm.step(self.now_ns, self.seen.stamp_ns, self.seen.epoch, requests)

    def tear(self) -> None:
        """The newest record is garbage, and its sequence says that somebody is writing."""
        header = self.hand.header
        words = self.hand.words()
        at = header.first + words[HEAD] % header.depth * header.stride
        self.hand.view[at + 8 : at + header.stride] = GARBAGE * (header.stride - 8)
        words[at // 8] = 0

    def close(self) -> None:
        for part in (self.ring, self.reader, self.hand):
            part.close()


@pytest.fixture
def harness(world: Any) -> Iterator[TornHarness]:
    made = TornHarness(world.name)
    yield made
    made.close()
    world.remove()


def test_nothing_is_seen_before_a_whole_record(harness: TornHarness) -> None:
    harness.torn = True
    harness.run(0.1)
    assert harness.seen.stamp_ns == 0 and not harness.seen.field("position").any()
    assert not harness.seen.field("powered").any()
    assert harness.arm.state == "DISABLED" and not harness.state["valid"]


@pytest.mark.slow
def test_a_torn_record_now_and_then_changes_nothing(harness: TornHarness) -> None:
    harness.homed()
    before = harness.setpoint["position"].copy()
    for _ in range(20):
        harness.torn = True
        harness.run(0.01)
        harness.torn = False
        harness.run(0.01)
        assert harness.state["valid"]
    assert harness.arm.state == "HOMED" and harness.reports.of("error") == []
    assert harness.reader.torn >= 20
    np.testing.assert_array_equal(harness.setpoint["position"], before)
    np.testing.assert_allclose(harness.state["position"][:6], harness.arm.io.position[:6])


@pytest.mark.parametrize("busy", [False, True])
def test_torn_records_are_an_io_that_is_silent(harness: TornHarness, busy: bool) -> None:
    harness.homed()
    if busy:
        harness.send("move_jp", (0.5, 0.1, 0.1, 0.0, 0.0, 0.0))
        harness.run(0.3)
    harness.torn = True
    good = harness.setpoint["position"].copy()
    harness.run(0.02)
    assert harness.arm.state == "HOMED" and harness.state["valid"]
    harness.run(LATE_NS * 1e-9)
    assert harness.arm.state == "FAULT"
    assert [row[1] for row in harness.reports.of("error")] == ["io-timeout"]
    assert not harness.state["valid"] and not harness.state["position"].any()
    assert np.abs(harness.setpoint["position"] - good).max() < 0.05  # it never asked for anything garbage said
    assert np.abs(harness.arm.io.rows).max() < 10.0
    harness.torn = False
    harness.run(0.1)
    harness.state_command("enable")
    harness.until(lambda: harness.arm.state == "ENABLED")


def test_the_effort_mode_falls_back_to_a_real_position(harness: TornHarness) -> None:
    harness.homed()
    harness.send("servo_jf", (0.0,) * 6)
    here = harness.arm.io.setpoint.copy()
    harness.torn = True
    harness.run(LATE_NS * 1e-9 + 5 * PERIOD_NS * 1e-9)
    assert harness.arm.state == "FAULT"
    np.testing.assert_allclose(harness.arm.control.motion.goal[:6], here[:6], atol=0.01)
