"""Setpoints that cannot be read whole: they were never there, and the robot is held where it is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.io.harness import PERIOD_NS, IoHarness
from trocar.procs.io.setpoint_rings import RingSource
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import HEAD
from trocar.shm.system import directory
from trocar.shm.topics import SETPOINT

TIMEOUT = 30_000_000 // PERIOD_NS
NAMES = ("mode", "has_velocity", "count", "in_effort", "bias_generation", "pid_generation", "position", "velocity",
         "effort", "feed_forward")


class Torn:
    """The setpoints of a stand's only arm by way of a real ring, which can be spoilt."""

    def __init__(self, system: str) -> None:
        directory.create_ring(system, "PSM1", SETPOINT, {}, {})
        self.ring = directory.writer(system, "PSM1", "setpoint", "arm")
        self.reader = directory.reader(system, "PSM1", "setpoint", "arm")
        self.hand = Segment(segment_name(system, "PSM1", "setpoint"), write=True)
        self.source = RingSource(self.reader)
        self.harness = IoHarness(sources=[self.source])
        self.plain = self.harness.arms[0]
        self.spoil: str = ""

    def run(self, cycles: int) -> None:
        """As the stand does it; the arm's record goes through the ring."""
        record = self.harness.record
        for _ in range(cycles):
            for name in NAMES:
                self.ring.field(name)[...] = getattr(self.plain, name)
            self.ring.field("bias_generation")[...] = record.bias_generation[0]
            self.ring.field("pid_generation")[...] = record.pid_generation[0]
            self.ring.publish(self.harness.clock.ns + PERIOD_NS - 100_000)
            if self.spoil:
                getattr(self, self.spoil)()
            self.harness.run(1)

    def torn(self) -> None:
        """Another position with the tags of the good record, in a slot that somebody is writing."""
        header, words = self.hand.header, self.hand.words()
        at = header.first + words[HEAD] % header.depth * header.stride
        offset = at + header.schema.offset("position")
        self.hand.view[offset : offset + 64] = np.full(8, 1.25).tobytes()
        words[at // 8] = 0

    def garbage(self) -> None:
        """The whole slot is garbage."""
        header, words = self.hand.header, self.hand.words()
        at = header.first + words[HEAD] % header.depth * header.stride
        self.hand.view[at : at + header.stride] = b"\xc7" * header.stride

    def backwards(self) -> None:
        """The head names an old record."""
        self.hand.words()[HEAD] = 1

    def ahead(self) -> None:
        """The head names a record that does not exist."""
        self.hand.words()[HEAD] = self.ring.sequence + 12345

    def close(self) -> None:
        for part in (self.ring, self.reader, self.hand):
            part.close()


@pytest.fixture
def torn(world: Any) -> Iterator[Torn]:
    made = Torn(world.name)
    yield made
    made.close()
    world.remove()


@pytest.mark.parametrize("how", ["torn", "garbage", "backwards", "ahead"])
def test_set_points_that_are_not_whole_are_missing_ones(torn: Torn, how: str) -> None:
    harness, record = torn.harness, torn.harness.record
    harness.control()
    harness.send(1, position=0.1)
    torn.run(3)
    assert (record.setpoint_position == 0.1).all() and torn.reader.problem == ""
    torn.spoil = how
    harness.send(1, position=0.11)
    torn.run(TIMEOUT - 2)
    assert not record.holding[0] and record.setpoint_age_ns[0] == -1
    torn.run(3)
    assert record.holding[0] and (record.setpoint_position == 0.1).all()
    harness.pass_s(2.8)
    torn.run(10)
    assert harness.codes == []
    harness.pass_s(0.2)
    torn.run(10)
    assert harness.codes == ["arm-lost"] and record.pid_enabled[0]
    assert (record.setpoint_position == 0.1).all() and (harness.record.setpoint_velocity == 0.0).all()
    assert torn.reader.problem != ""
    torn.spoil = ""
    torn.run(1)
    assert not record.holding[0] and (record.setpoint_position == 0.11).all()


@pytest.mark.slow
def test_one_that_is_not_whole_now_and_then_is_no_matter(torn: Torn) -> None:
    harness, record = torn.harness, torn.harness.record
    harness.control()
    for i in range(200):
        harness.send(1, position=0.001 * i)
        torn.spoil = "torn" if i % 3 else ""
        torn.run(1)
        assert not record.holding[0]
        assert (record.setpoint_position == 0.001 * (i - i % 3)).all()
    assert harness.codes == [] and torn.reader.torn > 100
