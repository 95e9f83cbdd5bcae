"""The arm faulted an hour ago: why? The three commands of docs/faults.md, when the system is long down."""

from __future__ import annotations

import json
import re
import shlex

import pytest

from tests.system.robot import DEMO, ROOT, Robot, wait_for
from trocar.shm.time.held_time import HeldTime

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]


def test_three_commands_of_the_page_say_why_an_arm_faulted(robot: Robot) -> None:
    page = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"\*\*Why was there a fault an hour ago\?\*\*.*?\n\n((?:    .*\n)+)", page)
    listed, said, scoped = (shlex.split(line, comments=True)[1:] for line in block.splitlines())
    robot.up(DEMO, "--boards", "emulated", "--set", "recorder.on=true", "--set", "processes.recorder.hung_s=60")
    robot.home()
    robot.trocar("send", "boards", "amp_fault", "PSM1", "3", "1")
    with HeldTime(robot.name) as held:  # rings keep 3 s: time creeps until the recorder, however late, has read them
        held.run_until(held.now_ns() + 500_000_000, 60.0)

        def is_kept() -> bool:
            held.run_until(held.now_ns() + 10_000_000, 60.0)
            return "a recording of the time before it" in robot.trocar("status", code=None)

        wait_for(is_kept, 60.0, "the file of the fault")
    wait_for(lambda: robot.trocar(*listed).count("an amplifier is off") == 1, 30.0, "the file is listed")
    assert robot.down() == 0

    row = json.loads(robot.trocar(*listed, "--json"))
    assert row["kind"] == "fault" and "axis 3" in row["reason"]

    def does(words: list[str], *more: str) -> str:
        return robot.trocar(*[row["path"] if word == "FILE" else word for word in words], *more)

    assert "an amplifier is off although it should be on; check the motor cable" in does(said)
    assert "amp_fault PSM1 3 1: done" in does(said, "--commands")
    shown = json.loads(does(scoped, "--json").splitlines()[0])
    assert [field["field"] for field in shown["fields"]] == ["IO1/state.effort[3]", "PSM1/measured_js.position[3]"]
    assert shown["condition"] == "fault" and shown["lost"] == 0
