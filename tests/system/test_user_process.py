"""The examples of docs/write-a-process.md in a running system: what they do, and what their deaths do."""

from __future__ import annotations

import json
import os
import pty
import re
import tty
from pathlib import Path

import numpy as np
import pytest

from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_user_failures import problem
from trocar.procs.config.read.yamltext import parse_yaml
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber
from trocar.tools.cli import VERBS, examples_of

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
PAGE = (ROOT / "docs/write-a-process.md").read_text()

ASLEEP = """
def main(process):
    while process.tick():
        process.publish("count", count=1)
"""


def system_of_the_page(folder: Path) -> Path:
    """A kinematic PSM1, and the processes of the page beside it."""
    programs = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    sections = [parse_yaml(text).data["trocar"] for text in re.findall(r"```yaml\n(trocar:.*?)```", PAGE, re.DOTALL)]  # type: ignore[index,call-overload]
    assert all(len(program.splitlines()) <= 40 for program in programs)
    for name, program in zip(("box.py", "sensor.py", "smooth.py", "speed.py"), programs, strict=True):
        (folder / name).write_text(program)
    arms = [{"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml"}]
    rows = list({row["name"]: row for section in sections for row in section["processes"]}.values())
    rows.append({"name": "asleep", "module": "asleep.py", "start": "on-demand", "linger_s": 0.0,
                 "topics": [{"name": "count", "fields": [{"name": "count", "type": "int"}]}],
                 "properties": [{"name": "site", "type": "text[12]", "default": "left"}]})
    (folder / "asleep.py").write_text(ASLEEP)
    file = folder / "lab.json"
    file.write_text(json.dumps({"$id": "dvrk-system.schema.json", "$version": "1", "arms": arms,
                                "trocar": {"processes": rows}}))
    return file


def test_the_examples_of_the_page_run_and_their_deaths_change_nothing_else(robot: Robot, tmp_path: Path) -> None:
    line, device = pty.openpty()
    tty.setraw(device)
    robot.environment |= {"FORCE_SENSOR": os.ttyname(device), "TROCAR_SYSTEM": "another"}
    robot.up(system_of_the_page(tmp_path))  # its processes connect to their own system all the same
    robot.environment["TROCAR_SYSTEM"] = robot.name
    wrench = directory.reader(robot.name, "force", "wrench")
    os.write(line, b"1 2.5 -3\n4 5 ")  # and the beginning of another
    wait_for(lambda: wrench.newest() and wrench.field("force").tolist() == [1.0, 2.5, -3.0], 60, "the sensor's record")

    os.write(line, b"6\n")
    wait_for(lambda: wrench.newest() and wrench.field("force").tolist() == [4.0, 5.0, 6.0], 60, "a line in two parts")

    robot.home("PSM1")
    arm, smooth = (directory.reader(robot.name, *names) for names in (("PSM1", "state"), ("smooth", "measured")))
    wait_for(lambda: arm.newest() and smooth.newest()
             and np.allclose(arm.field("position"), smooth.field("position"), atol=1e-6), 60, "the filter has settled")
    (example,) = (line for verb in VERBS for line in examples_of(verb) if line.startswith("trocar set box"))
    assert "box.stiffness = 200" in robot.trocar(*example.split()[1:])
    push = directory.reader(robot.name, "box", "push")
    assert "box.z = 0.0" in robot.trocar("set", "box.z", "0") and "box.x = 0.05" in robot.trocar("get", "box")
    assert "out of range" in robot.trocar("set", "box.stiffness", "-1", code=1)
    wait_for(lambda: push.newest() and bool(push.field("outside")), 60, "the tip is outside of the box")
    left = json.loads(robot.trocar("echo", "box/events", "-n", "1", "--json").splitlines()[-1])
    assert left["event"] == "left_box" and left["value"] > 0.0 and left["text"].startswith("at ["), left
    assert "push" in robot.trocar("list") and "force" in robot.trocar("echo", "box/push", "--once")
    assert "done" in robot.trocar("send", "box", "keep_in", "1")
    wait_for(lambda: arm.newest() and int(arm.field("control_mode")) == 3, 60, "the arm is pushed")

    pushing = robot.pid("box")
    robot.trocar("power-off")
    robot.home("PSM1")  # where the tip is known again it is outside, and an operator has to ask again
    wait_for(lambda: "stopped pushing: " in problem(robot, "box"), 60, "it stops pushing, and says so")
    assert "done" in robot.trocar("send", "box", "keep_in", "1")
    wait_for(lambda: arm.newest() and int(arm.field("control_mode")) == 3, 60, "the arm is pushed again")
    assert problem(robot, "box") == "" and robot.pid("box") == pushing

    before, arm_before = robot.kill("box"), robot.pid("PSM1")
    robot.comes_back("box", before)
    assert problem(robot, "box") == "pushes nothing yet: trocar send box keep_in 1", "it has forgotten the command"
    assert robot.pid("PSM1") == arm_before and robot.state("force") == "RUNNING"
    epoch, lab = smooth.epoch, robot.kill("lab")
    wait_for(lambda: smooth.epoch > epoch and smooth.newest(), 60, "the filters are back")
    wait_for(lambda: robot.pid("smooth") == robot.pid("speed") == robot.pid("lab") != lab, 60, "both of them")
    robot.pids.add(robot.pid("lab"))
    assert "fastest" in robot.trocar("echo", "speed/state", "--once")
    assert "smooth.share" in robot.trocar("get", "smooth")
    for part in (wrench, push, arm, smooth):
        part.close()
    assert robot.state("asleep") != "RUNNING"
    somebody = Subscriber(robot.name, "asleep")
    somebody.want("count")
    robot.comes_back("asleep", 0)
    assert "asleep.site = far left" in robot.trocar("set", "asleep.site", "far left")
    assert "is not a number" in robot.trocar("set", "box.x", "far left", code=2)
    somebody.close()
    wait_for(lambda: robot.state("asleep") == "STOPPED", 60, "it ends when nobody does any more")
    assert robot.down() == 0
    os.close(line)
    os.close(device)
