"""Names that are not there, in words."""

from __future__ import annotations

from trocar.procs.crtk.calls import CommandOwner
from trocar.procs.crtk.names import none_such
from trocar.shm.commands import COMMANDS


def test_the_owner_and_the_nearest_names_are_in_the_sentence() -> None:
    known = ["servo_jp", "hold", "move_cp"]
    assert none_such("command", "servo_jpp", known, "PSM1") == "PSM1 has no command servo_jpp; did you mean servo_jp?"


def test_where_no_name_is_near_all_are_listed() -> None:
    assert none_such("arm", "x", ["PSM1", "ECM"]) == "no arm x; there are: PSM1, ECM"
    assert "there are none" in none_such("arm", "x", [])


def test_a_component_without_properties_says_so_and_an_arm_suggests_commands_of_its_type() -> None:
    psm = CommandOwner("arm", {row.name: row for row in COMMANDS["arm"]}, "PSM")
    assert psm.lacks("PSM1", "set_property") == "PSM1 has no properties"
    assert "set_endoscope_type" not in psm.lacks("PSM1", "set_endoscope_typ")
