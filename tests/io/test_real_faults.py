"""What breaks on a real robot, broken on emulated boards: the fault that io tells comes through the whole bus."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from procs.boards.board_faults import BoardFaults
from procs.boards.robots.plant import Plant
from tests.io.boards_harness import Rig
from tests.io.test_real_robots import rig_of

pytestmark = pytest.mark.slow
ROBOTS = (("jhu-dVRK/system-PSM1", "PSM1"), ("jhu-daVinci-Si/system-PSM1", "PSM1"))
FAULTS: tuple[tuple[str, Callable[[BoardFaults, Rig], None], set[str]], ...] = (
    ("emergency stop", lambda hand, rig: hand.stop(True), {"power-lost"}),
    ("supply", lambda hand, rig: hand.lose_supply("PSM1", True), {"power-lost", "power-fault"}),
    ("amplifier", lambda hand, rig: hand.fail_amplifier("PSM1", 2, True), {"amplifier"}),
    ("encoder", lambda hand, rig: hand.jump_encoder("PSM1", 1, 200_000), {"potentiometer", "tracking"}),
    ("board", lambda hand, rig: hand.take_away(rig.robots.board_ids[0], True), {"bad-reads", "board-away"}),
)


@pytest.mark.parametrize(("system", "robot"), ROBOTS)
@pytest.mark.parametrize(("what", "breaks", "codes"), FAULTS, ids=[row[0] for row in FAULTS])
def test_what_breaks_is_told_by_its_name(system: str, robot: str, what: str,
                                         breaks: Callable[[BoardFaults, Rig], None], codes: set[str]) -> None:
    rig = rig_of(system)
    rig.bring_up(robot)
    rig.run(3.1 if what == "emergency stop" else 0.1)  # with power just on it is no other than later
    assert rig.errors() == [] and isinstance(rig.plant, Plant)
    breaks(BoardFaults(rig.world, rig.plant), rig)
    rig.run(0.3)
    told = [code for code, component in rig.errors() if component == robot]
    assert told and set(told) <= codes and len(set(told)) == len(told), told
    assert not rig.record.pid_enabled[0] and not rig.record.brakes_released[0]
    assert (rig.record.current_request[:7] == 0.0).all()
