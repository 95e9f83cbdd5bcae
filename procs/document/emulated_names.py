"""Names of robots and inputs on emulated boards: their own, or IO/NAME if several buses use the same name.

One process emulates the boards of all buses; two consoles may each have a robot MTML and a clutch pedal on their bus.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trocar.procs.document.system import ArmConfig, IoConfig, SystemConfig

Names = Mapping[tuple[str, str], str]  # (io, name in its files) → name on the boards


def names_on_boards(pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """The name on the boards for each (io, name): unchanged if only one bus has it, else IO/NAME."""
    buses: dict[str, set[str]] = {}
    rows = tuple(pairs)
    for io, name in rows:
        buses.setdefault(name, set()).add(io)
    return {(io, name): name if len(buses[name]) == 1 else f"{io}/{name}" for io, name in rows}


def with_names_on_boards(system: SystemConfig) -> SystemConfig:
    """The system with these names for robots and inputs; the same object if no name is shared."""
    robots = names_on_boards((io.name, robot.name) for io in system.ios for robot in io.robots)
    inputs = names_on_boards((io.name, row.name) for io in system.ios for row in io.digital_inputs)
    if all(name == new for (_, name), new in (*robots.items(), *inputs.items())):
        return system
    emulation = system.emulation
    if emulation is not None:
        joints = tuple(dataclasses.replace(one, name=robots.get((one.io, one.name), one.name))
                       for one in emulation.setup_joints)
        emulation = dataclasses.replace(emulation, setup_joints=joints)
    return dataclasses.replace(system, emulation=emulation, ios=tuple(_io(io, robots, inputs) for io in system.ios),
                               arms=tuple(_arm(arm, robots, inputs) for arm in system.arms))


def _io(io: IoConfig, robots: Names, inputs: Names) -> IoConfig:
    return dataclasses.replace(
        io,
        robots=tuple(dataclasses.replace(robot, name=robots[io.name, robot.name]) for robot in io.robots),
        pids=tuple(dataclasses.replace(pid, robot=robots.get((io.name, pid.robot), pid.robot)) for pid in io.pids),
        digital_inputs=tuple(dataclasses.replace(row, name=inputs[io.name, row.name]) for row in io.digital_inputs))


def _arm(arm: ArmConfig, robots: Names, inputs: Names) -> ArmConfig:
    def renamed(names: Names) -> Callable[[str], str]:
        return lambda name: names.get((arm.io, name), name)

    robot, switch = renamed(robots), renamed(inputs)
    own = {field.name: switch(getattr(arm.inputs, field.name)) for field in dataclasses.fields(arm.inputs)}
    return dataclasses.replace(arm, robot=robot(arm.robot), gripper=robot(arm.gripper),
                               inputs=dataclasses.replace(arm.inputs, **own))
