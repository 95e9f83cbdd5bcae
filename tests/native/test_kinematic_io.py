"""KINEMATIC robots by native code and by numpy: the same, whatever arms write."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

from tests.io.harness import PERIOD_NS, FakeCommand, SteppedClock, document
from tests.native.shadow import bits
from tests.native.test_track import ARMS, COMMANDS, Both
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.halves import numpy_track
from trocar.procs.io.kinematic import KinematicHalves, kinematic_io
from trocar.procs.io.record import IoRecord
from trocar.procs.io.setpoint_rings import RingSource
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import TRACK
from trocar.procs.native.library import bind, native
from trocar.shm.system import directory

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")


class KinematicStand:
    """One io without boards."""

    def __init__(self, system: str) -> None:
        self.io, self.clock = document(len(ARMS), digital_inputs=()), SteppedClock()
        self.record = IoRecord.private(7 * len(ARMS), len(ARMS), 0)
        sources = [RingSource(directory.reader(system, arm, "setpoint", "arm")) for arm in ARMS]
        self.core = kinematic_io(IoContext(self.io, self.clock, self.record, sources))

    def run(self, cycles: int, *commands: FakeCommand) -> None:
        """So many cycles, the first with these commands."""
        for _ in range(cycles):
            self.clock.ns += PERIOD_NS
            with np.errstate(all="ignore"):
                self.core.cycle(commands)
            commands = ()


class BothKinematic(Both):
    """Two of them; what is written and asked is what Both does."""

    def __init__(self, system: str) -> None:
        super().__init__(system)
        self.stands: list[Any] = [KinematicStand(system) for _ in range(2)]
        slow = self.stands[1].core
        slow.halves.track = numpy_track(slow.parts)
        slow.halves._control, slow.halves._follow = slow.halves._by_numpy, None
        slow.halves.move = partial(KinematicHalves.move, slow.halves)
        self.bound = [bind(TRACK, stand.core.parts) for stand in self.stands]

    def compare(self) -> None:
        """The same in all that the native library works on, and in what is published."""
        one, other = (stand.record for stand in self.stands)
        super().compare()
        for name in ("position", "velocity", "setpoint_position", "setpoint_effort", "powered", "desired_generation"):
            assert np.array_equal(bits(getattr(one, name)), bits(getattr(other, name))), name


@pytest.fixture
def both(world: Any) -> Iterator[BothKinematic]:
    made = BothKinematic(world.name)
    yield made
    for writer in made.writers:
        writer.close()
    world.remove()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.slow
def test_both_come_to_the_same_in_every_cycle(both: BothKinematic, seed: int) -> None:
    both.rng = np.random.default_rng(seed)
    assert isinstance(both.bound[0], BoundStruct)
    moved = 0
    for count in range(400):
        both.cycle(count)
        both.compare()
        moved += int(both.stands[0].record.velocity.any())
    assert moved > 50, "hardly anything ever moved"


@pytest.mark.slow
def test_robots_that_follow_call_the_tracker_for_nothing(both: BothKinematic, monkeypatch: pytest.MonkeyPatch) -> None:
    stand = both.stands[0]
    for name, *values in COMMANDS[:2]:  # power, and then the joint controllers
        stand.run(5, *(FakeCommand(name, arm, *values) for arm in ARMS))
    asked = []
    for cycle in range(20):
        if cycle == 10:  # what is new to it has been looked at by then
            monkeypatch.setattr(stand.core.follow, "receive", lambda *given: asked.append(given))
        for place, writer in enumerate(both.writers):
            writer.field("mode")[...], writer.field("count")[...] = 1, 7
            writer.field("bias_generation")[...] = stand.record.bias_generation[place]
            writer.field("pid_generation")[...] = stand.record.pid_generation[place]
            writer.field("position")[...] = 0.001 * cycle
            writer.publish(stand.clock.ns + PERIOD_NS - 100_000)
        stand.run(1)
    assert asked == [] and stand.record.position == pytest.approx(np.full(14, 0.019))
