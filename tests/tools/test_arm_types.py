"""What an arm of one type has is not listed for another; the tables agree with what arms carry out."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import pytest
from typer.testing import CliRunner

from tests.arm.fake_io import ArmHarness
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.arm.arm import ArmLogic
from trocar.procs.config.models.arm_file import ArmFile
from trocar.procs.tables.arm_types import ARM_TYPES, class_of, found
from trocar.shm.commands import COMMANDS
from trocar.tools import cli
from trocar.tools.client.arm import Arm

APP = cli.build()


@pytest.fixture
def kinematic(world: Any) -> Iterator[ScriptedRobot]:
    with robot(world.name) as made:
        yield made


def listed(kinematic: ScriptedRobot, *words: str) -> str:
    result = CliRunner().invoke(APP, [*words, "--system", kinematic.name])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_psm_lists_no_commands_of_masters_and_cameras(kinematic: ScriptedRobot) -> None:
    text = listed(kinematic, "send", "PSM1")
    assert "set_tool_type" in text and "jaw/move_jp" in text and "move_cp" in text
    assert "set_endoscope_type" not in text and "lock_orientation" not in text


@pytest.mark.slow
def test_a_psm_lists_no_events_and_views_of_masters_and_cameras(kinematic: ScriptedRobot) -> None:
    text = listed(kinematic, "list")
    assert "PSM1/tool_type" in text and "PSM1/jaw/measured_js" in text and "PSM1/goal_reached" in text
    for other in ("gripper", "endoscope_type", "orientation_locked"):
        assert f"PSM1/{other}" not in text


def test_the_types_of_commands_are_those_that_carry_them_out() -> None:
    psm = ArmHarness().arm._commands
    for command in COMMANDS["arm"]:
        if command.types:
            assert (command.name in psm.rows) is ("PSM" in command.types), command.name


@pytest.mark.parametrize("name", ARM_TYPES)
def test_what_a_type_names_is_there_and_of_its_size(name: str) -> None:
    row = ARM_TYPES[name]
    class_of(row.arm_file, ArmFile)
    class_of(row.process, ArmLogic)
    class_of(row.client, Arm)
    assert not row.inverse or callable(found(row.inverse))
    sizes = {len(part) for pair in (row.moves, row.efforts) for part in dataclasses.astuple(pair)}
    assert sizes == {len(row.kinematic_home)} == {row.actuators}
    assert all(len(plant.initial) == row.actuators and len(plant.joints) in (row.joints, row.actuators)
               for plant in row.plant.values())
