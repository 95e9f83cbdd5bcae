"""What breaks on a real robot, broken on emulated boards: the fault that io tells comes through the whole bus."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.io.boards_harness import BoardsHarness, rig_of
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.boards.robots.plant import Plant

pytestmark = pytest.mark.slow
ROBOTS = (("jhu-dVRK/system-PSM1", "PSM1"), ("jhu-daVinci-Si/system-PSM1", "PSM1"))
FAULTS: tuple[tuple[str, Callable[[BoardFaults, BoardsHarness], None], set[str]], ...] = (
    ("emergency stop", lambda hand, harness: hand.stop(True), {"power-lost"}),
    ("supply", lambda hand, harness: hand.lose_supply("PSM1", True), {"power-lost", "power-fault"}),
    ("amplifier", lambda hand, harness: hand.fail_amplifier("PSM1", 2, True), {"amplifier"}),
    ("encoder", lambda hand, harness: hand.jump_encoder("PSM1", 1, 200_000), {"potentiometer", "tracking"}),
    ("board", lambda hand, harness: hand.take_away(harness.robots.board_ids[0], True), {"bad-reads", "board-away"}),
)


@pytest.mark.parametrize(("system", "robot"), ROBOTS)
@pytest.mark.parametrize(("what", "breaks", "codes"), FAULTS, ids=[row[0] for row in FAULTS])
def test_what_breaks_is_told_by_its_name(system: str, robot: str, what: str,
                                         breaks: Callable[[BoardFaults, BoardsHarness], None], codes: set[str]) -> None:
    harness = rig_of(system)
    harness.bring_up(robot)
    harness.run(3.1 if what == "emergency stop" else 0.1)  # with power just on it is no other than later
    assert harness.errors() == [] and isinstance(harness.plant, Plant)
    breaks(BoardFaults(harness.world, harness.plant), harness)
    harness.run(0.3)
    reported = [code for code, component in harness.errors() if component == robot]
    assert reported and set(reported) <= codes and len(set(reported)) == len(reported), reported
    assert not harness.record.pid_enabled[0] and not harness.record.brakes_released[0]
    assert (harness.record.current_request[:7] == 0.0).all()
