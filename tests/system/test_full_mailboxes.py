"""Others have every place in every mailbox: stopping goes on, whoever asks for something else is told who they are."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import trocar
from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_socket_bridge import COARSE
from trocar.shm.memory.segment import names_of

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
TELEOP = ROOT / "configs/systems/kinematic-teleop.yaml"
PLAN = """
import sys
from trocar.shm.mailbox.place import take_place
from trocar.shm.memory.segment import SegmentError, names_of
kept = []
for _, instance, what in names_of(sys.argv[1]):
    while what == "mailbox":
        try:
            kept.append(take_place(sys.argv[1], instance, "plan.py"))
        except SegmentError:
            break
print(len(kept), flush=True)
sys.stdin.read()
"""


@pytest.fixture
def full(robot: Robot, tmp_path: Path) -> Robot:
    """A homed system with a console that lets it follow."""
    robot.up(TELEOP, *COARSE)
    robot.are_verbs_apart = True
    robot.trocar("send", "system", "home", "--wait")
    robot.trocar("send", "console", "teleop_enable", "1")
    return robot


def take_all_places(robot: Robot) -> subprocess.Popen[str]:
    """A program that has every place that is free, in every mailbox."""
    command = [sys.executable, "-c", PLAN, robot.name]
    child = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    mailboxes = sum(what == "mailbox" for _, _, what in names_of(robot.name))
    assert int(child.stdout.readline()) > 10 * mailboxes
    return child


def test_stopping_never_queues_behind_those_who_have_all_places(full: Robot) -> None:
    with trocar.arm("PSM1", full.name) as mover:
        mover.trajectory_j_set_ratio(0.001)  # minutes: all that follows happens under way
        under_way = mover.move_jp([0.5, 0.3, 0.2, 0.0, 0.0, 0.0])
        plan = take_all_places(full)
        try:
            reported = full.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0", code=1)
            assert "PSM1: all 16 places for commands are taken: " in reported and reported.endswith("; close one\n")
            assert re.search(rf"plan\.py \(pid {plan.pid}, 1\d places\)", reported)
            assert re.search(r"teleop MTMR_PSM1 \(pid \d+\)", reported) and re.search(r"system \(pid \d+\)", reported)
            assert under_way.is_busy()
            assert full.trocar("send", "PSM1", "hold").startswith("done")
            with pytest.raises(trocar.Refused, match="replaced by hold"):
                under_way.wait(60.0)
            full.trocar("send", "console", "teleop_enable", "0")
            with trocar.arm("MTMR", full.name) as master:
                master.hold()
                master.pause()
                master.state_command("disable")
                with pytest.raises(trocar.Problem, match="MTMR: all 16 places for commands are taken"):
                    master.enable()
            full.trocar("power-off", "PSM1")
            assert mover.is_disabled()
            trocar.system(full.name).power_off()
            full.trocar("send", "system", "power_off", "--wait")
            full.trocar("down")
            wait_for(lambda: not names_of(full.name), 60.0, "the end of the system")
        finally:
            plan.kill()
            plan.communicate()
