"""Setpoints by native code and by numpy: whatever arms write into their rings, and whatever is asked meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.io.harness import PERIOD_NS, FakeCommand, IoHarness, gains
from tests.native.shadow import bits
from trocar.procs.document.system import PidConfig
from trocar.procs.io.halves import numpy_track
from trocar.procs.io.setpoint_rings import RingSource
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import TRACK
from trocar.procs.native.library import bind, native
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import HEAD, RingWriter
from trocar.shm.system import directory
from trocar.shm.topics import SETPOINT

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

ARMS = ("PSM1", "PSM2")
COMMANDS = (("power_on",), ("pid_enable", 1.0), ("pid_enable", 0.0), ("use_setpoint_v", 1.0), ("use_setpoint_v", 0.0),
            ("enforce_limits", 1.0), ("enforce_limits", 0.0), ("power_off",), ("bias_encoders", 3.0))
ODD = (np.nan, np.inf, 1e300, -0.0)


class Both:
    """Two ios with rings of the same arms, one by native code, one by numpy."""

    def __init__(self, system: str) -> None:
        self.system, self.rng = system, np.random.default_rng()
        for arm in ARMS:
            directory.create_ring(system, arm, SETPOINT, {}, {})
        pids = tuple(PidConfig(arm, arm, tuple(gains() for _ in range(7)), max_speeds=(*(300.0,) * 6, 1e9))
                     for arm in ARMS)
        self.writers = [directory.writer(system, arm, "setpoint", "arm") for arm in ARMS]
        self.stands = [IoHarness(2, pids=pids, sources=[RingSource(directory.reader(system, arm, "setpoint", "arm"))
                                             for arm in ARMS]) for _ in range(2)]
        quick, slow = (stand.core for stand in self.stands)
        assert not quick.halves.why_numpy
        slow.halves.track = numpy_track(slow.parts)
        self.bound = [bind(TRACK, stand.core.parts) for stand in self.stands]

    def write(self, writer: RingWriter, place: int) -> None:
        """Anything that an arm, or somebody in its place, may write; mostly what makes sense."""
        rng, record, field = self.rng, self.stands[0].record, writer.field
        odd = rng.random() < 0.05
        field("mode")[...] = rng.choice((1, 1, 1, 1, 0, 7) if odd or rng.random() < 0.1 else (1,))
        field("count")[...] = rng.integers(0, 256) if odd else 7
        field("has_velocity")[...] = rng.random() < 0.7
        field("in_effort")[...] = rng.random(8) < 0.3 if rng.random() < 0.1 else False
        field("bias_generation")[...] = record.bias_generation[place] + (rng.random() < 0.05)
        field("pid_generation")[...] = record.pid_generation[place] + (rng.random() < 0.05)
        for name, size in (("position", 2.0), ("velocity", 1.0), ("effort", 0.5), ("feed_forward", 0.1)):
            field(name)[...] = rng.normal(0.0, size, 8)
            if odd:
                field(name)[rng.integers(8)] = rng.choice(ODD)
        if rng.random() < 0.1:
            field("desired_generation")[...] = rng.integers(0, 4)
            field("desired_pid")[...] = rng.integers(0, 3)
        late = int(rng.choice((0, 100_000, 100_000, 100_000, 40_000_000, -1_000_000, -90_000_000)))
        writer.publish(self.stands[0].clock.ns + PERIOD_NS - (late if odd else 100_000))

    def spoil(self, arm: str) -> None:
        """A slot that somebody is in, or a head that goes elsewhere."""
        with Segment(segment_name(self.system, arm, "setpoint"), write=True) as hand:
            words, header = hand.words(), hand.header
            words[(header.first + words[HEAD] % header.depth * header.stride) // 8] = 0
            if self.rng.random() < 0.3:
                words[HEAD] = int(self.rng.choice((0, 1, words[HEAD] - 5 if words[HEAD] > 5 else 0, 1 << 63)))
            words.release()

    def cycle(self, count: int) -> None:
        """One of both ios."""
        rng = self.rng
        for place, writer in enumerate(self.writers):
            if rng.random() < 0.8:
                self.write(writer, place)
        if rng.random() < 0.03:
            self.spoil(str(rng.choice(ARMS)))
        asked = []
        if rng.random() < 0.08:
            name, *values = COMMANDS[rng.integers(len(COMMANDS))]
            asked.append((name, str(rng.choice(ARMS)), values))
        if count % 25 in (0, 15):  # power, and then the joint controllers
            name, *values = COMMANDS[count % 25 // 15]
            asked += [(name, arm, values) for arm in ARMS]
        for stand in self.stands:
            stand.run(1, *(FakeCommand(name, arm, *values) for name, arm, values in asked))

    def compare(self) -> None:
        one, other = self.bound
        assert isinstance(one, BoundStruct) and isinstance(other, BoundStruct)
        for name, array in one.arrays.items():
            if not name.startswith(("head", "slots", "copy", "seen")):
                assert np.array_equal(bits(array), bits(other.arrays[name])), name
        reported = [[(e.kind, e.text, e.component, e.axis) for e in stand.core.reports.events] for stand in self.stands]
        assert reported[0] == reported[1]
        assert not one.moved()


@pytest.fixture
def both(world: Any) -> Iterator[Both]:
    made = Both(world.name)
    yield made
    for writer in made.writers:
        writer.close()
    world.remove()


def test_a_good_cycle_calls_no_function_of_numpy(both: Both, monkeypatch: pytest.MonkeyPatch) -> None:
    stand = both.stands[0]
    called: list[str] = []

    def cycle(*commands: FakeCommand) -> None:
        for place, writer in enumerate(both.writers):
            writer.field("mode")[...], writer.field("count")[...] = 1, 7
            writer.field("bias_generation")[...] = stand.record.bias_generation[place]
            writer.field("pid_generation")[...] = stand.record.pid_generation[place]
            writer.publish(stand.clock.ns + PERIOD_NS - 100_000)
        stand.run(1, *commands)

    def counted(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *given, **more: (called.append(name), function(*given, **more))[1]

    for name, *values in COMMANDS[:2]:  # power, and the joint controllers
        cycle(*(FakeCommand(name, arm, *values) for arm in ARMS))
        for _ in range(15):
            cycle()
    assert stand.record.pid_enabled.all() and not stand.codes
    for name in dir(np):
        if isinstance(getattr(np, name), np.ufunc):
            monkeypatch.setattr(np, name, counted(name, getattr(np, name)))
    for _ in range(5):
        cycle()
    assert stand.core.good and called == []
    stand.core.pid.control(stand.record.position, stand.record.velocity)
    assert "subtract" in called, "they are counted"


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow
def test_both_come_to_the_same_in_every_cycle(both: Both, seed: int) -> None:
    both.rng = np.random.default_rng(seed)
    handled = 0
    for count in range(400):
        both.cycle(count)
        both.compare()
        handled += int(both.stands[0].record.pid_enabled.any())
    assert handled > 50, "the joint controllers were hardly ever on"
