"""Arms of a `_DERIVED` type in the system file: the class that each becomes, and mistakes told with their place."""

from __future__ import annotations

import pytest

from tests.config.conftest import Home
from trocar.procs.document import system as document

ARM = {"name": "PSM1", "type": "PSM_DERIVED", "simulation": "KINEMATIC", "arm_file": "arms/PSM1-demo.yaml",
       "component": "mine.Mine"}


def test_a_derived_arm_is_its_type_with_a_class(home: Home) -> None:
    (home.path / "mine.py").write_text("raise SystemExit('nobody runs this here')\n")
    loaded = home.load_made({"arms": [ARM], "trocar": {"processes": [
        {"name": "PSM1", "commands": [{"name": "scan"}]}]}})
    assert loaded.errors == () and loaded.system is not None
    arm = loaded.system.arm("PSM1")
    assert arm.type == "PSM" and arm.derived == f"{home.path / 'mine.py'}:Mine"
    assert [row.name for row in arm.commands] == ["scan"] and loaded.system.process("PSM1").kind == "arm"
    assert document.from_json(document.to_json(loaded.system)) == loaded.system


@pytest.mark.parametrize(("component", "text"), [
    ("", "this key is required for PSM_DERIVED"), ("yours_of_nobody.Mine", "no such module"),
    ("mine.1", "not the name of a class")])
def test_mistakes_are_told_with_their_place(home: Home, component: str, text: str) -> None:
    (home.path / "mine.py").write_text("")
    loaded = home.load_made({"arms": [{**ARM, "component": component}]})
    (error,) = loaded.errors
    assert error.key == "arms[0].component" and text in error.text


def test_a_component_of_the_original_program_is_not_started(home: Home) -> None:
    loaded = home.load_made({"arms": [{**ARM, "component": "myPSM"}]})
    assert loaded.errors == () and loaded.system is not None and not loaded.system.arms
    assert any("myPSM is a component of the original program" in note for note in loaded.system.notes)


def test_an_arm_of_ours_declares_no_commands(home: Home) -> None:
    loaded = home.load_made({"arms": [{**ARM, "type": "PSM"}], "trocar": {"processes": [
        {"name": "PSM1", "commands": [{"name": "scan"}]}]}})
    (error,) = loaded.errors
    assert error.key == "trocar.processes.PSM1" and "not declared here" in error.text
