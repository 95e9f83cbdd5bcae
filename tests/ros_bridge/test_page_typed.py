"""The blocks of docs/ros.md: its sections load, its lines for `ros2` name topics of the bridge and take effect."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.page_blocks import blocks, system_of, system_with, typed
from tests.ros_bridge.hosted_bridge import HostedBridge, bridged
from trocar.procs.document.bridges import RosBridge
from trocar.procs.ros_messages import messages

LINES = typed("ros.md")
EFFECTS: dict[str, Callable[[Any], bool]] = {
    "/system/home": lambda arm: bool(arm.field("is_homed").item()),
    "/PSM1/move_jp": lambda arm: abs(arm.field("position")[0] - 0.1) < 1e-6,
    "/PSM1/state_command": lambda arm: bool(arm.field("is_homed").item()),  # enable: it is enabled already
}
"""What publishing on these topics of the page does."""


@pytest.fixture(scope="module")
def bridge() -> Iterator[HostedBridge]:
    with bridged(arms=()) as made:
        yield made


def test_the_sections_and_the_systems_of_the_page_have_a_bridge(tmp_path: Path) -> None:
    section, arms = blocks("ros.md", "yaml")
    lines = [words for words in LINES if words[0] == "trocar"]
    assert len(lines) == 2 and all(system_of(line).ros == RosBridge() for line in lines)
    assert system_with(section, tmp_path).ros == RosBridge()
    (arm,) = system_with(f"{arms}trocar: {{clock: wall}}", tmp_path).third_parties
    assert arm.ros is not None and arm.ros.namespace == "/PSM1"


@pytest.mark.slow
def test_the_lines_for_ros2_do_what_they_say(bridge: HostedBridge) -> None:
    published = [words for words in LINES if words[:3] == ["ros2", "topic", "pub"]]
    assert [words[4] for words in published] == list(EFFECTS)
    state = bridge.host.reader("PSM1")
    for _, _, _, once, topic, kind, *content in published:
        assert once == "--once"
        bridge.tell(topic.removeprefix("/"), message(kind, *content))
        for _ in range(100):
            if state.newest() and EFFECTS[topic](state):
                break
            bridge.run(0.1)
        assert EFFECTS[topic](state), topic


def test_the_topics_that_lines_name_are_there(bridge: HostedBridge) -> None:
    participant = bridge.loop.participant
    there = {each.name.removeprefix("rt") for each in (*participant.writers, *participant.readers)}
    named = {name for words in LINES for word in words for name in re.findall(r"(/PSM1/\w+)", word)}
    assert named and named - {"/PSM1/shown"} <= there


def message(kind: str, content: str = "{}") -> Any:
    """A message as `ros2 topic pub` makes it."""
    name = kind.replace("/msg/", ".msg.dds_.") + "_"
    (made,) = [each for each in vars(messages).values() if getattr(each, "__idl_typename__", "") == name]
    return made(**yaml.safe_load(content))
