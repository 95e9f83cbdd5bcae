"""The emulated arms: motors' efforts in, actuators' positions and velocities out, one step at a time.

Arrays run over every actuator of every robot, in document order (each io, each robot, each actuator), in actuator
space and SI. MuJoCo moves the joints; the coupling between actuators and joints is two matrix products outside it.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from procs.boards.mechanics import MARGIN, MARGIN_SLIDE, Mechanism, compile_model, description, mechanism
from procs.lib.coupling import Coupling, coupling
from procs.lib.document import Emulation, Robot, System, Tool

Array = NDArray[np.float64]

SCATTER = 0.02  # rad or, times 0.2, m: how far the seed may move an arm from its usual place at switch-on


class Plant:
    """All robots of a system's emulated boards."""

    def __init__(self, system: System) -> None:
        """ValueError when the system has no emulation, or an arm's files do not fit its robot."""
        if system.emulation is None:
            raise ValueError(f"{system.name}: a plant needs the system's emulation settings")
        self.period_s = system.emulation.period_s
        self._robots = tuple(robot for io in system.ios for robot in io.robots)
        self._arms = {arm.robot: arm for arm in system.arms if arm.robot and arm.simulation != "KINEMATIC"}
        self._by_name = {arm.name: arm for arm in system.arms}
        self._tools = {name: tool for name, tool in _instruments(system).items() if name in self._by_name}
        self._slices = _slices(self._robots)
        self.axes = sum(len(robot.actuators) for robot in self._robots)
        self.position = np.zeros(self.axes)
        self.velocity = np.zeros(self.axes)
        self.pot_position = np.zeros(self.axes)  # what the potentiometers sit on: see Robot.joint_to_actuator_position
        self._current_effort = np.zeros(self.axes)
        self._effort_per_current = _effort_per_current(self._robots)
        self._external = np.zeros(self.axes)  # joint space
        self._switch_on(system.emulation)
        self._assemble()
        self._come_off_stops()

    def step(self, effort_actuator: Array) -> None:
        """One period under motor efforts (axes,) at the actuators, N·m or N."""
        self._to_joint_effort.dot(effort_actuator, self._applied)  # half the price of np.matmul at this size
        np.add(self._applied, self._external, self._applied)
        mujoco.mj_step(self.model, self.data)
        self._to_actuator.dot(self._joint_position, self.position)
        self._to_actuator.dot(self._joint_velocity, self.velocity)
        self._to_pot.dot(self._joint_position, self.pot_position)

    def step_current(self, current: Array) -> None:
        """One period under motor currents (axes,), A; 0 where the amplifier is off."""
        self.step(np.multiply(current, self._effort_per_current, self._current_effort))

    def slice_of(self, robot: str) -> slice:
        """Where the actuators of a robot lie in the arrays; KeyError when there is none of that name."""
        return self._slices[robot]

    def push(self, robot: str, joint_efforts: Array) -> None:
        """Efforts from outside (n,) on a robot's joints, N·m or N, from the next step until changed."""
        self._external[self._slices[robot]] = joint_efforts

    def place(self, robot: str, actuator_position: Array) -> None:
        """Put a robot's actuators (n,) somewhere, at rest."""
        part = self._slices[robot]
        self.position[part] = actuator_position
        self.velocity[part] = 0.0
        self._take_state()

    def tip(self, robot: str) -> Array:
        """Pose (4, 4) of a robot's tip in its base frame with base offset, as its joints are now."""
        mujoco.mj_kinematics(self.model, self.data)
        base, tip = (self._site(f"{robot}/{name}") for name in ("base", "tip"))
        return np.linalg.inv(base) @ tip

    def instrument(self, arm: str) -> str:
        """Name of the instrument an arm holds; empty when none."""
        tool = self._tools.get(arm)
        return tool.name if tool is not None else ""

    def insert_tool(self, arm: str, tool: Tool) -> None:
        """Put an instrument on an arm: other joints and limits, the actuators stay where they are."""
        if arm not in self._by_name:
            raise KeyError(f"{arm}: not an arm of this system; it has {', '.join(self._by_name)}")
        self._tools[arm] = tool
        self._assemble()

    def remove_tool(self, arm: str) -> None:
        """Take an arm's instrument away; its discs turn freely from where they are."""
        self._tools.pop(arm, None)
        self._assemble()

    def _assemble(self) -> None:
        """Build model and matrices for the instruments now held, keeping the actuators' state. About 1 ms."""
        mechanisms = tuple(self._mechanism(robot) for robot in self._robots)
        self.model = compile_model(mechanisms, self.period_s)
        self.data = mujoco.MjData(self.model)
        if self.model.nv != self.axes:
            raise ValueError(f"the model has {self.model.nv} joints for {self.axes} actuators")
        self._to_joint = np.zeros((self.axes, self.axes))
        self._to_actuator = np.zeros((self.axes, self.axes))
        self._to_joint_effort = np.zeros((self.axes, self.axes))
        self._to_pot = np.zeros((self.axes, self.axes))
        for robot in self._robots:
            part = self._slices[robot.name]
            pair = self._coupling(robot)
            self._to_joint[part, part] = pair.actuator_to_joint
            self._to_actuator[part, part] = pair.joint_to_actuator
            self._to_joint_effort[part, part] = pair.actuator_to_joint_effort
            self._to_pot[part, part] = _pot_matrix(robot) @ pair.joint_to_actuator
        self._joint_position = self.data.qpos
        self._joint_velocity = self.data.qvel
        self._applied = self.data.qfrc_applied
        self._take_state()

    def _mechanism(self, robot: Robot) -> Mechanism:
        arm = self._arms.get(robot.name)
        return mechanism(robot, arm, self._tools.get(arm.name) if arm is not None else None)

    def _coupling(self, robot: Robot) -> Coupling:
        arm = self._arms.get(robot.name)
        count = len(robot.actuators)
        if arm is None or description(arm, count) is None:
            return Coupling(np.eye(count))
        return coupling(count, arm.chain, self._tools.get(arm.name))

    def _take_state(self) -> None:
        """Joints from the actuators' position and velocity."""
        np.matmul(self._to_joint, self.position, out=self._joint_position)
        np.matmul(self._to_joint, self.velocity, out=self._joint_velocity)
        np.matmul(self._to_pot, self._joint_position, out=self.pot_position)

    def _switch_on(self, emulation: Emulation) -> None:
        """Where arms stand at switch-on: the table's place, moved a little by the seed; loose axes in mid-range."""
        scatter = np.random.default_rng(emulation.seed).uniform(-SCATTER, SCATTER, self.axes)
        for robot in self._robots:
            part = self._slices[robot.name]
            arm = self._arms.get(robot.name)
            row = description(arm, len(robot.actuators))
            middle = row.initial if row is not None else tuple(_middle(robot))
            scale = [MARGIN_SLIDE / MARGIN if a.joint_type == "PRISMATIC" else 1.0 for a in robot.actuators]
            self.position[part] = np.array(middle) + scatter[part] * np.array(scale)

    def _come_off_stops(self) -> None:
        """An instrument held at switch-on may not allow where the table puts the discs: move to its nearest stop."""
        limited = self.model.jnt_limited.astype(bool)
        lower, upper = np.where(limited, self.model.jnt_range.T, ((-np.inf,), (np.inf,)))
        np.clip(self._joint_position, lower, upper, out=self._joint_position)
        np.matmul(self._to_actuator, self._joint_position, out=self.position)
        np.matmul(self._to_pot, self._joint_position, out=self.pot_position)

    def _site(self, name: str) -> Array:
        site = self.data.site(name)
        matrix = np.eye(4)
        matrix[:3, :3] = site.xmat.reshape(3, 3)
        matrix[:3, 3] = site.xpos
        return matrix


def _instruments(system: System) -> dict[str, Tool]:
    """Instruments inserted at start: those the emulation names, else those that are fixed on their arm."""
    tools = {arm.name: arm.tool for arm in system.arms if arm.tool is not None}
    for arm_name, tool_name in system.emulation.instruments if system.emulation is not None else ():
        arm = system.arm(arm_name)
        known = {tool.name: tool for tool in (*arm.tools, *((arm.tool,) if arm.tool is not None else ()))}
        if tool_name not in known:
            raise ValueError(f"{arm_name}: instrument {tool_name} is not known; there are {', '.join(sorted(known))}")
        tools[arm_name] = known[tool_name]
    return tools


def _slices(robots: tuple[Robot, ...]) -> dict[str, slice]:
    slices: dict[str, slice] = {}
    at = 0
    for robot in robots:
        if robot.name in slices:
            raise ValueError(f"{robot.name}: two robots of this name")
        slices[robot.name] = slice(at, at + len(robot.actuators))
        at += len(robot.actuators)
    return slices


def _effort_per_current(robots: tuple[Robot, ...]) -> Array:
    """N·m/A (or N/A) of every actuator; 0 where the file gives no motor (grippers)."""
    scales = np.array([a.effort_to_current for robot in robots for a in robot.actuators])
    efforts: Array = np.divide(1.0, scales, out=np.zeros_like(scales), where=scales != 0.0)
    return efforts


def _middle(robot: Robot) -> list[float]:
    """The middle of each actuator's encoder range, 0 where it has none."""
    encoders = [actuator.encoder for actuator in robot.actuators]
    return [0.5 * (e.lower + e.upper) if e is not None else 0.0 for e in encoders]


def _pot_matrix(robot: Robot) -> Array:
    """Actuator positions to what the potentiometers measure (joints, where the file gives a matrix between)."""
    if robot.joint_to_actuator_position is None:
        return np.eye(len(robot.actuators))
    actuator_to_pot: Array = np.linalg.inv(np.array(robot.joint_to_actuator_position))
    return actuator_to_pot
