"""The table of docs/ros.md has the topics that the bridge has: no other, and none is missing."""

from __future__ import annotations

import json
import os
import re
from collections import defaultdict
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import yaml

from tests.conftest import World
from tests.stock import ROOT
from trocar.procs.config import load_system
from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.ros_bridge.loop import RosLoop
from trocar.procs.ros_messages.command_messages import MESSAGES
from trocar.procs.supervisor import memory
from trocar.shm.system import directory

FOCUS = [{"name": f"endoscope_focus_{way}", "board_id": 0, "bit_id": bit, "is_PWM": False}
         for bit, way in enumerate(("in", "out"))]
HEADINGS = {"arm": "an arm", "teleop": "a teleoperation", "console": "a console", "system": "`system`",
            "focus": "the focus", "ros_bridge": "`ros_bridge`"}


def made(file: str, folder: Path, name: str) -> SystemConfig:
    """One of ours with a bridge that shows all, and on boards with a focus controller."""
    content = yaml.safe_load((ROOT / f"configs/systems/{file}.yaml").read_text())
    content.setdefault("trocar", {})["ros"] = {"domain": 1 + os.getpid() % 230, "pid": "rw", "io": "rw"}
    if "IOs" in content:
        (folder / "focus.json").write_text(
            json.dumps({"$id": "saw-robot-io.schema.json", "$version": "6", "digital_outputs": FOCUS}))
        content["ISI_focus_controller"] = {"name": "focus", "IO": "IO1", "IO_file": "focus.json"}
    (folder / "made.json").write_text(json.dumps(content))
    loaded = load_system(folder / "made.json", search=[ROOT / "configs"], boards="emulated", name=name)
    assert loaded.system is not None, loaded.errors
    return replace(loaded.system, clock=WALL)  # only io, the bridge and rings are made, no supervisor


def documented() -> dict[str, set[str]]:
    """Names by what they are of, as the page has them."""
    found = defaultdict(set)
    for heading, names in re.findall(r"^\| ([^|]+) \| (.*`.*) \|$", (ROOT / "docs/ros.md").read_text(), re.M):
        found[heading.partition(",")[0]] |= set(re.findall(r"`([^`]+)`", names))
    return found


def existing(system: SystemConfig) -> dict[str, set[str]]:
    """Those that there are."""
    loop, found = RosLoop(Node(document_of(system.name), "ros_bridge")), defaultdict(set)
    kinds = {row.name: row.kind for row in system.processes}
    buttons = {each.name for io in system.ios for each in io.digital_inputs}
    setups = "|".join(arm.name for cart in system.carts for arm in cart.arms)
    try:
        loop.begin()
        ends = [each.name for each in (*loop.participant.writers, *loop.participant.readers)] + loop.services.names
    finally:
        loop.quit()
        loop.node.close()
    for name in {end.removeprefix("rt/") for end in ends}:
        first, _, rest = name.partition("/")
        if first == "PID":
            found["`PID/ARM/` (`pid`)"].add(rest.partition("/")[2])
        elif first == "IO":
            robot, _, of_robot = rest.partition("/")[2].partition("/")
            found["`IO/NAME/ROBOT/` (`io`)" if of_robot else "`IO/NAME/` (`io`)"] |= {of_robot or robot} - buttons
        elif rest.startswith("IO/"):
            found["an arm's buttons"].add(rest)
        elif kinds.get(first) == "suj":
            found["SUJ"].add(re.sub(f"^({setups})/", "ARM/", rest))
        elif first in kinds:
            found[HEADINGS[kinds[first]]].add(rest)
    return found


@pytest.mark.slow
def test_the_page_has_the_topics_that_there_are(
        tmp_path: Path, world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(directory, "reader", partial(directory.reader, often=False))  # no record is read
    found: dict[str, set[str]] = defaultdict(set)
    for file in ("kinematic-full", "demo-teleop"):
        system = made(file, tmp_path, world.name)
        memory.create_all(system)
        for heading, names in existing(system).items():
            found[heading] |= names
        world.remove()
    page = documented()
    for heading, names in found.items():
        assert names == page[heading] - {"rw"}, heading


def test_the_page_has_the_message_of_each_word_of_the_command_table() -> None:
    page = (ROOT / "docs/ros.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"\| ([a-z ]+) \| ([a-z_0-9]+/[A-Za-z0-9]+) \|", page))
    assert rows == {word: taken.message.__idl_typename__.replace(".msg.dds_.", "/").removesuffix("_")
                    for word, taken in MESSAGES.items()}
