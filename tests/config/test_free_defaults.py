"""Ports and ROS domains that a file does not choose, where other users have the usual ones."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.config.conftest import Home
from tests.config.test_arms_from_ros import ARMS, PSM2
from tests.page_blocks import blocks
from tests.system.robot import ROOT
from trocar.procs.config import Machine, load_system
from trocar.procs.document.bridges import reached_at
from trocar.procs.document.system import SystemConfig, to_json
from trocar.procs.supervisor.addresses import Reservations

FILE = ROOT / "configs" / "systems" / "kinematic.yaml"


class Crowded:
    """A machine where another system has every usual port and the first three ROS domains."""

    def address(self, usual: str) -> str:
        host, port = usual.split(":")
        return f"{host}:{int(port) + 3}"

    def domain(self, first: int, last: int) -> int | None:
        return next((number for number in range(first, last + 1) if number > 2), None)


def made(*sets: str) -> SystemConfig:
    loaded = load_system(FILE, sets=list(sets), machine=Machine(free=Crowded()))
    assert loaded.system is not None, loaded.errors
    return loaded.system


def test_what_the_file_leaves_open_moves_and_is_reported() -> None:
    system = made("gui={}", "socket={}", "foxglove={}", "ros={}")
    assert system.gui is not None and system.socket is not None and system.foxglove is not None and system.ros
    assert system.gui.listen == system.process("gui").listen == ("127.0.0.1:8083",)
    assert system.socket.listen == ("127.0.0.1:7383",) and system.foxglove.listen == "127.0.0.1:8768"
    assert system.ros.domain == 3
    for word in ("127.0.0.1:8083", "127.0.0.1:7383", "127.0.0.1:8768", "ROS_DOMAIN_ID=3"):
        assert any(word in note for note in system.notes)
    assert reached_at(to_json(system)) == {"foxglove": ("127.0.0.1:8768",), "ros_bridge": ("ROS domain 3 on lo",)}


def test_what_the_file_chooses_stays_and_two_in_a_domain_are_reported() -> None:
    usual = "127.0.0.1:8080"
    system = made(f"gui.listen={usual}", "ros.domain=0")
    assert system.gui is not None and system.gui.listen == (usual,) and system.ros is not None
    assert system.ros.domain == 0 and any("domain 0, too" in note for note in system.notes)


def test_a_domain_beyond_this_machine_stays() -> None:
    system = made("ros.interface=eth0")
    assert system.ros is not None and system.ros.domain == 0


def test_a_system_with_an_arm_from_ros_stays_in_the_domain_of_that_arm(home: Home) -> None:
    file = home.path / "made.json"
    home.load_made({"arms": [*ARMS, {**PSM2, "component": {"from": "ros"}}], "trocar": {"ros": {}}})
    system = load_system(file, configs=home.path, machine=Machine(free=Crowded())).system
    assert system is not None and system.ros is not None and system.ros.domain == 0
    assert json.loads(to_json(system))["third_parties"][0]["ros"]["domain"] == 0


def test_the_file_for_a_class_chooses_no_ports(tmp_path: Path) -> None:
    (text,) = blocks("teaching.md", "yaml")
    (tmp_path / "class.yaml").write_text(text)
    loaded = load_system(tmp_path / "class.yaml", machine=Machine(free=Crowded()), records=True)
    system = loaded.system
    assert system is not None and not loaded.warnings, (loaded.errors, loaded.warnings)
    assert system.gui is not None and system.gui.listen == ("127.0.0.1:8083",) and system.recorder is None
    assert {row.period_s for row in system.processes if row.kind in ("io", "arm")} == {0.01}


@pytest.mark.parametrize("domain", [231])  # high: no other system of this machine should have it
def test_two_systems_do_not_get_the_same_domain(domain: int) -> None:
    with Reservations() as one, Reservations() as two:
        first = one.domain(domain, 232)
        assert first is not None and two.domain(first, first) is None and two.domain(first, 232) != first
