"""The bridge to ROS in a system file."""

from __future__ import annotations

import pytest

from tests.cases import cases
from tests.config.conftest import Home
from tests.config.test_consoles import ARMS
from tests.system.robot import ROOT
from trocar.procs.config import load_system
from trocar.procs.document.bridges import RosBridge
from trocar.procs.document.system import SystemConfig

PSM = next(arm for arm in ARMS if arm["name"] == "PSM1")
FILE = ROOT / "configs" / "systems" / "kinematic.yaml"


def made(*sets: str) -> SystemConfig:
    loaded = load_system(FILE, sets=list(sets))
    assert loaded.system is not None, loaded.errors
    return loaded.system


def test_without_a_key_there_is_no_bridge() -> None:
    system = made()
    assert system.ros is None and "ros_bridge" not in {row.name for row in system.processes}


def test_sections_of_bridges_count_without_a_key(home: Home) -> None:
    loaded = home.load_made({"arms": [PSM], "trocar": {"ros": {}, "socket": {}}})
    assert loaded.system is not None, loaded.errors
    assert loaded.system.ros is not None and loaded.system.socket is not None
    none = home.load_made({"arms": [PSM], "trocar": {"io": {}}}).system
    assert none is not None and none.ros is None and none.socket is None


def test_on_this_machine_who_asks_may_power() -> None:
    system = made("ros.domain=7")
    assert system.ros == RosBridge(7, "lo", 0.01) and system.ros.may_power
    row = system.process("ros_bridge")
    assert (row.kind, row.period_s, row.priority) == ("ros_bridge", 0.01, 0) and "PSM1" in row.after
    assert not [note for note in system.notes if "ros" in note]


@pytest.mark.parametrize(("sets", "expected"), [
    ((), False), (("ros.may_power=true",), True), (("ros.may_power=false",), False),
])
def test_elsewhere_only_where_the_file_says_so_and_everybody_is_told(sets: tuple[str, ...], expected: bool) -> None:
    system = made("ros.interface=eth0", *sets)
    assert system.ros is not None and system.ros.may_power is expected
    (note,) = [note for note in system.notes if note.startswith("ros:")]
    assert "eth0" in note and ("power" in note) is expected


def test_an_interface_that_this_machine_lacks_is_a_warning() -> None:
    loaded = load_system(FILE, sets=["ros.interface=none9"])
    assert not loaded.errors and any("none9" in str(problem) for problem in loaded.warnings)


@cases("text", ["ros.domain=233", "ros.domain=-1", "ros.period_s=0", "ros.interface=a b",
                "ros.namespace=1x", "ros.io=yes", "ros.unknown=1"])
def test_what_makes_no_sense_is_refused(text: str) -> None:
    assert load_system(FILE, sets=[text]).errors


def test_which_characters_a_namespace_may_have_is_said() -> None:
    (problem,) = load_system(FILE, sets=["ros.namespace=a b"]).errors
    assert "letters, digits" in problem.allowed
