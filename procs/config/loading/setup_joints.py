"""Classic setup joints on emulated boards: their file, and the outputs and axes that reach them."""

from __future__ import annotations

import dataclasses

from trocar.procs.config.loading import convert
from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.setup_file import PLUGS, SetupFile
from trocar.procs.config.models.system_file import ArmKeys, SystemFile
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import emulated
from trocar.procs.document import system as document
from trocar.procs.document.cart import LIFT_OUTPUTS, MULTIPLEXER_OUTPUTS

OUTPUTS = (*MULTIPLEXER_OUTPUTS, *LIFT_OUTPUTS)
_ROOM = {"QLA1": 4, "DQLA": 8}  # axes and outputs alike


def with_setup_joints(
    context: Context, source: SourceFile, content: SystemFile, system: document.SystemConfig | None
) -> document.SystemConfig | None:
    """The system, with the Classic setup joints among its arms on its emulated boards."""
    if system is None or system.emulation is None:
        return system
    found = []
    for index, keys in enumerate(content.arms):
        if keys.type == "SUJ_Classic" and keys.IO and keys.arm_file and keys.simulation == "NONE":
            found.append(_load(context, source, ("arms", index), keys, system))
    joints = tuple(one for one in found if one is not None)
    return dataclasses.replace(system, emulation=dataclasses.replace(system.emulation, setup_joints=joints))


def _load(
    context: Context, source: SourceFile, where: Key, keys: ArmKeys, system: document.SystemConfig
) -> emulated.EmulatedSetupJoints | None:
    path = context.find(source, (*where, "arm_file"), (keys.arm_file,))
    opened = context.open(SetupFile, path) if path is not None else None
    if opened is None:
        return None
    ios = system.emulation.ios if system.emulation is not None else None
    io = next((io for io in (ios or system.ios) if io.name == keys.IO), None)
    robot = next((r for r in io.robots if r.name == (keys.name_on_IO or keys.name)), None) if io is not None else None
    made = _fitted(system, io, robot, opened.content) if io is not None and robot is not None else None
    if made is None:
        need = f"{PLUGS} actuators and the outputs {', '.join(OUTPUTS)}, all on one QLA1 or DQLA"
        context.warning(source, where, f"emulated without setup joints: {keys.IO} has not all it takes", need)
    return made


def _fitted(
    system: document.SystemConfig, io: document.IoConfig, robot: document.Robot, content: SetupFile
) -> emulated.EmulatedSetupJoints | None:
    """The setup joints on the board that has their actuators and outputs; None when no board has them all."""
    named = {row.name: row for row in io.digital_outputs}
    outputs = [named[name] for name in OUTPUTS if name in named]
    boards = [actuator.board_id for actuator in robot.actuators] + [output.board_id for output in outputs]
    axes, bits = [actuator.axis_id for actuator in robot.actuators], [output.bit_id for output in outputs]
    if len(set(boards)) != 1 or len(axes) != PLUGS or len(bits) != len(OUTPUTS):
        return None
    buses = system.emulation.buses if system.emulation is not None else ()
    hardware = [c.hardware for bus in buses if bus.io == io.name for c in bus.controllers if c.board_id == boards[0]]
    if not hardware or max(*axes, *bits) >= _ROOM.get(hardware[0], 0):
        return None
    arms = tuple(convert.setup_arm(arm) for arm in content.arms)
    reset, increment, pwm, disable = bits
    return emulated.EmulatedSetupJoints(robot.name, io.name, boards[0], tuple(axes), reset, increment, pwm, disable,
                                        arms)
