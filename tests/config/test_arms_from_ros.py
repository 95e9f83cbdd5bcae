"""Arms from ROS: both forms of their component, what is filled in, and mistakes."""

from __future__ import annotations

from typing import Any

import pytest

from tests.config.conftest import Home
from tests.config.test_consoles import ARMS
from trocar.procs.document import system as document
from trocar.procs.document.bridges import RosArm
from trocar.procs.tables.manifest import proc

PSM2 = {"name": "PSM2", "type": "PSM_GENERIC"}
LOADED = [
    {"shared-library": "dvrk_arm_from_ros", "class-name": "dvrk_psm_from_ros",
     "constructor-arg": {"Name": "PSM2", "Period": 0.01}},
    {"shared-library": "dvrk_arm_from_ros", "class-name": "dvrk_arm_from_ros", "constructor-arg": {"Name": "ECM"}}]
MASTER = next(arm for arm in ARMS if arm["name"] == "MTMR")


def made(home: Home, component: Any, **keys: Any) -> document.SystemConfig:
    loaded = home.load_made({"arms": [*ARMS, {**PSM2, "component": component}], **keys})
    assert loaded.system is not None, loaded.errors
    return loaded.system


@pytest.mark.parametrize(("component", "expected"), [
    ({"from": "ros"}, RosArm("/PSM2")), ({"name": "other", "from": "ros"}, RosArm("/other")),
    ({"name": "other", "from": "ros", "namespace": "/site/PSM1", "domain": 7, "interface": "127.0.0.1",
     "check_names": False}, RosArm("/site/PSM1", 7, "127.0.0.1", check_names=False)),
    ({"from": "ros", "namespace": "site/PSM1"}, RosArm("/site/PSM1"))])
def test_an_arm_from_ros_has_our_program_in_its_place(home: Home, component: Any, expected: RosArm) -> None:
    system = made(home, component)
    assert system.third_party("PSM2").ros == expected
    process, user = system.process("PSM2"), system.user("PSM2")
    assert process.kind == "third_party" and process.start == proc("third_party").start == "always"
    assert user is not None and user.module == "trocar.tools.from_ros.arm" and process.period_s == 0.005
    assert document.from_json(document.to_json(system)) == system


def test_domain_and_interface_are_those_of_the_bridge(home: Home) -> None:
    bridge = {"ros": {"domain": 12, "interface": "127.0.0.1"}}
    assert made(home, {"from": "ros"}, trocar=bridge).third_party("PSM2").ros == RosArm("/PSM2", 12, "127.0.0.1")
    given = made(home, {"from": "ros", "domain": 3}, trocar=bridge).third_party("PSM2").ros
    assert given == RosArm("/PSM2", 3, "127.0.0.1")


@pytest.mark.parametrize("manager", [{"components": LOADED}, LOADED])
def test_a_component_of_dvrk_files_is_the_same(home: Home, manager: Any) -> None:
    loaded = home.load_made({"arms": [*ARMS, {**PSM2, "component": "PSM2", "interface": "PSM2",
                                              "skip_ROS_bridge": True}], "component_manager": manager})
    assert loaded.system is not None and loaded.system.third_party("PSM2").ros == RosArm("/PSM2")
    (warning,) = (row for row in loaded.warnings if row.key == "component_manager")
    assert "dvrk_arm_from_ros" in warning.text and "dvrk_psm_from_ros" not in warning.text, "the used one is no news"
    assert "an arm of a _GENERIC type with this component" in warning.allowed


def test_files_whose_components_are_all_used_have_no_warning(home: Home) -> None:
    loaded = home.load_made({"arms": [*ARMS, {**PSM2, "component": "PSM2"}],
                             "component_manager": {"components": LOADED[:1]}})
    assert loaded.system is not None and not [row for row in loaded.warnings if row.key == "component_manager"]


def test_other_components_are_third_party_programs_as_before(home: Home) -> None:
    for component in ("Falcon", {"name": "Falcon"}):
        system = made(home, component)
        assert system.third_party("PSM2").ros is None and system.user("PSM2") is None


def test_another_network_is_noted(home: Home) -> None:
    notes = " ".join(made(home, {"from": "ros", "interface": "eth0"}).notes)
    assert "PSM2 is /PSM2 in ROS domain 0 on eth0: every program on that network can publish as this arm" in notes


def test_an_arm_from_ros_is_a_component_and_may_be_faulty(home: Home) -> None:
    from trocar.procs.supervisor.memory import components

    assert "PSM2" in components(made(home, {"from": "ros"})) and "PSM2" not in components(made(home, "Falcon"))


@pytest.mark.parametrize(("component", "key", "says"), [
    ({"from": "ros2"}, "component.from", 'the text "ros"'),
    ({"from": "ros", "topic": "x"}, "component.topic", "name, from, namespace, domain, interface, check_names"),
    ({"from": "ros", "namespace": "/1st/PSM"}, "component.namespace", "letters, digits, _ and /"),
    ({"from": "ros", "domain": 233}, "component.domain", "from 0 up to 232"),
    ({"name": "x", "domain": 3}, "component.domain", "from: ros beside it"),
    (3, "component", "an object with name, from")])
def test_mistakes_are_explained(home: Home, component: Any, key: str, says: str) -> None:
    loaded = home.load_made({"arms": [*ARMS, {**PSM2, "component": component}]})
    (error,) = loaded.errors
    assert error.key == f"arms[{len(ARMS)}].{key}" and says in error.allowed


def test_only_arms_of_a_generic_type_come_from_ros(home: Home) -> None:
    (error,) = home.load_made({"arms": [*ARMS[:-1], {**ARMS[-1], "component": {"from": "ros"}}]}).errors
    assert error.key.endswith("component.from") and "_GENERIC as its type" in error.allowed


def test_an_arm_of_our_own_bridge_is_no_arm_from_ros(home: Home) -> None:
    arms = [*ARMS, {**PSM2, "component": {"from": "ros", "namespace": f"/site/{MASTER['name']}"}}]
    bridge = {"ros": {"namespace": "site"}}
    (error,) = home.load_made({"arms": arms, "trocar": bridge}).errors
    assert "is an arm of this system: its own ROS bridge publishes it" in error.text
    assert home.load_made({"arms": arms, "trocar": {"ros": {}}}).system is not None


def test_a_module_for_an_arm_from_ros_is_refused(home: Home) -> None:
    (home.path / "own.py").write_text("")
    loaded = home.load_made({"arms": [*ARMS, {**PSM2, "component": {"from": "ros"}}],
                             "trocar": {"processes": [{"name": "PSM2", "module": "own.py"}]}})
    assert [error.key for error in loaded.errors] == ["trocar.processes.PSM2.module"]


def test_buttons_do_not_come_from_ros(home: Home) -> None:
    buttons = {name: {"component": "PSM2", "interface": name} for name in ("clutch", "camera", "operator_present")}
    loaded = home.load_made({"arms": [*ARMS, {**PSM2, "component": {"from": "ros"}}],
                             "consoles": [{"name": "c", "input_type": "COMPONENTS", **buttons}]})
    assert {error.text for error in loaded.errors} == {"PSM2 is an arm from ROS, which has no buttons"}
