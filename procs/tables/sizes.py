"""Named sizes of an instance's records, with the constants that describe them: ranges of robots, names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trocar.procs.document.system import IoConfig, SystemConfig

Sizes = tuple[dict[str, int], dict[str, Any]]
"""Sizes by name, and further information for the headers of the rings."""


def fixed(system: SystemConfig, name: str) -> Sizes:
    """Records of the same size in every system."""
    return {}, {}


def of_supervisor(system: SystemConfig, name: str) -> Sizes:
    """The supervisor's record: a row for every process."""
    return _counted("instances", [row.name for row in system.processes])


def of_third_party(system: SystemConfig, name: str) -> Sizes:
    """The buttons of a third-party program."""
    dims, info = _counted("inputs", list(system.third_party(name).inputs))
    starts = {"starts": True} if system.user(name) is not None else {}
    return dims, {**info, "type": system.third_party(name).type, **starts}


def of_boards(system: SystemConfig, name: str) -> Sizes:
    """All robots and boards on the emulated buses."""
    if system.emulation is None:
        return fixed(system, name)
    dims, info = _of_ios(system.emulated().ios)
    boards = [c.board_id for bus in system.emulation.buses for c in bus.controllers]
    return {"axes": dims["axes"], "boards": len(boards)}, {"robots": info["robots"], "boards": boards}


def of_io(system: SystemConfig, name: str) -> Sizes:
    """All robots, inputs and outputs on one bus."""
    io = system.io(name)
    dims, info = _of_ios((io,))
    return dims, info if io.port else {**info, "simulation": "KINEMATIC"}


def of_arm(system: SystemConfig, name: str) -> Sizes:
    """An arm's record, which has room for any arm."""
    arm = system.arm(name)
    return {}, {"type": arm.type, **({"simulation": arm.simulation} if arm.simulation != "NONE" else {})}


def of_cart(system: SystemConfig, name: str) -> Sizes:
    """The setup arms of a patient cart."""
    cart = system.cart(name)
    setups = {arm.name: {"row": row, "count": arm.joints, "carries": arm.carries,
                         "names": [f"{cart.name}_{arm.name}_J{joint}" for joint in range(arm.joints)]}
              for row, arm in enumerate(cart.arms)}
    kinematic = cart.simulation if cart.simulation != "NONE" else "EMULATED" if cart.emulated else ""
    return {"setups": len(cart.arms)}, {"setups": setups, **({"simulation": kinematic} if kinematic else {})}


def of_console(system: SystemConfig, name: str) -> Sizes:
    """The teleoperations of a console."""
    return _counted("teleops", list(system.console(name).teleops))


def of_system(system: SystemConfig, name: str) -> Sizes:
    """All arms and setup joints."""
    return _counted("arms", [row.name for rows in (system.arms, system.carts) for row in rows])


def _counted(what: str, names: list[str]) -> Sizes:
    return {what: len(names)}, {what: names}


def _of_ios(ios: tuple[IoConfig, ...]) -> Sizes:
    robots, first, inputs, outputs, brakes = {}, 0, [], [], 0
    for io in ios:
        names = {pid.robot: [axis.name for axis in pid.axes] for pid in io.pids}
        for robot in io.robots:
            count = len(robot.actuators)
            labels = names.get(robot.name) or [f"actuator_{i}" for i in range(count)]
            robots[robot.name] = {"first": first, "count": count, "names": labels, "io": io.name}
            first += count
            brakes += len(robot.brakes)
        inputs += [i.name for i in io.digital_inputs]
        outputs += [o.name for o in io.digital_outputs]
    dims = {"axes": first, "drives": first + brakes, "robots": len(robots), "inputs": len(inputs),
            "outputs": len(outputs), "readers": sum(len(io.instrument_readers) for io in ios)}
    return dims, {"robots": robots, "inputs": inputs, "outputs": outputs}
