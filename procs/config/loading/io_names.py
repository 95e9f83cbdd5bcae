"""What belongs to an arm on its bus besides its robot: buttons and switches, an instrument's memory, a gripper.

They are known by their names in the IO files, which begin with that of the arm: PSM1_arm_clutch, PSM1_dallas.
"""

from __future__ import annotations

from trocar.procs.config.loading.buses import BusFiles
from trocar.procs.config.models.io_file import DallasKeys, IoFile, RobotKeys
from trocar.procs.document import system as document

INPUTS = {
    "clutch": "arm_clutch",
    "adapter": "adapter",
    "tool": "tool",
    "suj_clutch": "SUJ_clutch",
    "suj_clutch_2": "SUJ_clutch_2",
}
"""Fields of `document.ArmInputs`, and how the names of these inputs end."""


def inputs_of(bus: BusFiles | None, arm: str, robot: str) -> document.ArmInputs:
    """The digital inputs of an arm, which has this robot."""
    there = {row.name for opened in _files(bus) for row in opened.digital_inputs}
    found = {field: next((name for name in _names(arm, robot, end) if name in there), "")
             for field, end in INPUTS.items()}
    return document.ArmInputs(**found)


def reader_of(bus: BusFiles | None, arm: str, robot: str, keys: RobotKeys | None) -> str:
    """What reads the memory of an arm's instruments: by its name, else the only one on the boards of its robot."""
    readers: list[DallasKeys] = [row for opened in _files(bus) for row in opened.dallas_chips]
    for name in _names(arm, robot, "dallas"):
        if any(row.name == name for row in readers):
            return name
    boards = {actuator.board_id for actuator in keys.actuators} if keys is not None else set()
    own = [row.name for row in readers if row.board_id in boards]
    return own[0] if len(own) == 1 else ""


def gripper_of(gripper_file: IoFile | None, arm: str, robot: str) -> str:
    """The robot of a master's gripper: by its name, else the only one of its file."""
    robots = [row.name for row in gripper_file.robots] if gripper_file is not None else []
    for name in _names(arm, robot, "gripper"):
        if name in robots:
            return name
    return robots[0] if len(robots) == 1 else ""


def _names(arm: str, robot: str, end: str) -> tuple[str, ...]:
    return f"{robot}_{end}", f"{arm}_{end}"


def _files(bus: BusFiles | None) -> list[IoFile]:
    return [opened.content for opened in bus.opened()] if bus is not None else []
