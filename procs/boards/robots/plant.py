"""The emulated arms: motors' efforts in, actuators' positions and velocities out, one step at a time.

Arrays run over every actuator of every robot, in document order (each io, each robot, each actuator), in actuator
space and SI. MuJoCo moves the joints; the coupling between actuators and joints is two matrix products outside it, and
so are friction, play, brakes and links that follow others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from trocar.procs.boards.robots.assembly import Tips, assemble
from trocar.procs.boards.robots.constraint import Block, Projection
from trocar.procs.boards.robots.friction import SHARE, Friction, Play
from trocar.procs.boards.robots.mechanics import (
    GRIPPER_INITIAL,
    MARGIN,
    MARGIN_SLIDE,
    Mechanism,
    description,
    has_play,
    is_gripper,
    laden,
    mechanism,
    parallelogram,
)
from trocar.procs.boards.robots.weight import weights_of
from trocar.procs.boards.wiring import slices_of
from trocar.procs.document.system import Chain, EmulationConfig, ModelVariation, Robot, SystemConfig, Tool
from trocar.procs.kinematics.coupling import Coupling, coupling
from trocar.procs.kinematics.poses import Array
from trocar.procs.native import library
from trocar.procs.native.boards_fields import PLANT

HEAVY, PUSHED = 1, 2  # tasks of `apply` besides friction
SCATTER = 0.02  # rad or, times 0.2, m: how far the seed may move an arm from its usual place at switch-on


class Plant:
    """All robots of a system's emulated boards."""

    def __init__(self, system: SystemConfig, links: Mapping[str, Chain] | None = None) -> None:
        """ValueError when the system has no emulation, or an arm's files do not fit its robot.

        `links`: by arm, the links of an Si arm as they really are, with masses (its file for gravity compensation).
        """
        if system.emulation is None:
            raise ValueError(f"{system.name}: a plant needs the system's emulation settings")
        self.period_s = system.emulation.period_s
        self.before_step: list[Callable[[], None]] = []  # called at the beginning of every step
        self._robots = tuple(robot for io in system.ios for robot in io.robots)
        arms = tuple(laden(arm) for arm in system.arms)
        self._arms = {arm.robot: arm for arm in arms if arm.robot}
        self._by_name = {arm.name: arm for arm in arms}
        self._links = {arm.name: chain for arm in arms if (chain := parallelogram(arm))} | dict(links or {})
        self._tools = {name: tool for name, tool in _instruments(system).items() if name in self._by_name}
        self.slices = slices_of(self._robots)
        """Positions of each robot's actuators in the arrays."""
        self._like = _model_variations(system.emulation, self._robots)
        self.axes = sum(len(robot.actuators) for robot in self._robots)
        self.position = np.zeros(self.axes)
        self.velocity = np.zeros(self.axes)
        self.pot_position = np.zeros(self.axes)  # inputs of the potentiometers: see Robot.joint_to_actuator_position
        self._effort_per_current = _effort_per_current(self._robots)
        self._pushed = np.zeros(self.axes)  # robots' joint space
        self._supported: set[str] = set()
        self._is_pulled = False
        self._is_braked = np.zeros(self.axes, dtype=np.bool_)
        self._is_jammed = np.zeros(self.axes, dtype=np.bool_)
        self._pots_on_motors = np.ones(self.axes, dtype=np.bool_)
        self._pot_offset = np.zeros(self.axes)
        for robot in self._robots:
            part = self.slices[robot.name]
            self._pots_on_motors[part] = robot.joint_to_actuator_position is None
            self._pot_offset[part] = self._like[robot.name].pot_offset or 0.0
        self._has_pots = not self._pots_on_motors.all() or bool(self._pot_offset.any())
        if not self._has_pots:
            self.pot_position = self.position
        self._play: Play | None = None
        self._switch_on(system.emulation)
        self._assemble()
        self._come_off_stops()

    # -- time ----------------------------------------------------------------------------------------------------------

    def step(self, effort_actuator: Array) -> None:
        """One period under motor efforts (axes,) at the actuators, N·m or N."""
        for hook in self.before_step:
            hook()
        if self._play is not None:
            effort_actuator = self._through_play(self._play, effort_actuator)
        self._to_joint_effort.dot(effort_actuator, self.effort)  # half the price of np.matmul at this size
        self._apply(self._is_heavy | self._is_pushed)
        if self._is_pulled:
            np.add(self._applied, self._pull, self._applied)
            self._pull[:] = 0.0
            self._is_pulled = False
        if len(self._carried):
            weight = self.data.qfrc_bias - self.data.qfrc_gravcomp  # of the step before: about the same
            self._applied[self._carried] += weight[self._carried]
        mujoco.mj_step(self.model, self.data)
        if self._projection is not None:
            self._projection.apply()
        self._tips.moved()
        self._read()

    def apply(self, which: int) -> int:
        """Efforts less friction, then the additional efforts of HEAVY and PUSHED robots, as the model takes them."""
        applied = self._applied
        np.subtract(self.effort, self.friction.oppose(self._joint_velocity), applied)
        if which & HEAVY:
            np.subtract(applied, self._weight, applied)
        if which & PUSHED:
            np.add(applied, self._push, applied)
        return 0

    def step_current(self, current: Array) -> None:
        """One period under motor currents (axes,), A; 0 where the amplifier is off."""
        if self._weights is not None:
            self._weights.step(current, self._joint_position)
        self.step(current * self._effort_per_current)

    def _through_play(self, play: Play, effort: Array) -> Array:
        transmitted = effort.copy()
        self._to_actuator.dot(self._joint_velocity, self.velocity)
        play.transmit(transmitted, self.velocity)
        return transmitted

    def _read(self) -> None:
        """Actuators and potentiometers from the joints."""
        self._to_actuator.dot(self._joint_position, self.position)
        self._to_actuator.dot(self._joint_velocity, self.velocity)
        if self._play is not None:
            self._play.follow(self.position, self.velocity)
        if self._has_pots:
            self._read_pots()

    def _read_pots(self) -> None:
        self._to_pot.dot(self._joint_position, self.pot_position)
        np.copyto(self.pot_position, self.position, where=self._pots_on_motors)
        np.add(self.pot_position, self._pot_offset, self.pot_position)

    # -- actions of a person or a test on robots -------------------------------------------------------------------

    def push(self, robot: str, joint_efforts: Array) -> None:
        """Efforts from outside (n,) on a robot's joints, N·m or N, from the next step until changed."""
        self._pushed[self.slices[robot]] = joint_efforts
        self._take_push()

    def pull(self, robot: str, wrench: Array) -> None:
        """Force and torque (6,) at a robot's tip, in the axes of its base frame, for the next step; pulls add up."""
        self._tips.add_pull(robot, wrench, self._pull)
        self._is_pulled = True

    def support(self, robot: str, supported: bool) -> None:
        """Carry a robot's weight by hand in any position, or let it act again."""
        (self._supported.add if supported else self._supported.discard)(robot)
        self._carry()

    def _carry(self) -> None:
        self._carried = np.concatenate([np.zeros(0, dtype=np.intp),
                                        *(self._assembly.joints[robot] for robot in sorted(self._supported))])

    def place(self, robot: str, actuator_position: Array, by_hand: bool = False) -> None:
        """Set a robot's actuators (n,) to a position, at rest; brakes hold it there, or `by_hand` where they are."""
        part, joints = self.slices[robot], self._assembly.joints[robot]
        still = self._is_jammed[part] | (self._is_braked[part] & by_hand)
        wanted = np.where(still, self.position[part], actuator_position)
        self._joint_position[joints] = self._to_joint[joints, part] @ wanted
        self._joint_velocity[joints] = 0.0
        self.friction.relax(joints)
        if self._play is not None:
            self._play.place(part)
        self._constrain()
        self._tips.moved()
        self._read()

    def brake(self, robot: str, actuators: NDArray[np.bool_], engaged: bool) -> None:
        """Engage or release the brakes of the actuators (n,) that are true; engaged ones do not move under any effort.

        A new plant has all brakes released.
        """
        self._is_braked[self.slices[robot]][actuators] = engaged
        self._constrain()

    def jam(self, robot: str, actuator: int, jammed: bool) -> None:
        """Lock an actuator against any effort, or free it: jammed, or held by a brake that does not release."""
        self._is_jammed[self.slices[robot].start + actuator] = jammed
        self._constrain()

    def tip(self, robot: str) -> Array:
        """Pose (4, 4) of a robot's tip in its base frame with base offset, as its joints are now."""
        return self._tips.pose(robot)

    def tip_twist(self, robot: str) -> Array:
        """Velocity (6,) of a robot's tip, linear then angular, in the axes of its base frame."""
        return self._tips.twist(robot)

    def motor_inertia(self) -> Array:
        """The joints' armature as the motors feel it, (axes, axes)."""
        inertia: Array = self._to_joint.T @ np.diag(self.model.dof_armature) @ self._to_joint
        return inertia

    def instrument(self, arm: str) -> str:
        """Name of the instrument an arm holds; empty when none."""
        tool = self._tools.get(arm)
        return tool.name if tool is not None else ""

    def insert_tool(self, arm: str, tool: Tool) -> None:
        """Insert an instrument on an arm: new joints and limits, unchanged actuator positions."""
        if arm not in self._by_name:
            raise KeyError(f"{arm}: not an arm of this system; it has {', '.join(self._by_name)}")
        self._tools[arm] = tool
        self._assemble()

    def remove_tool(self, arm: str) -> None:
        """Remove an arm's instrument; its discs turn freely from their positions."""
        self._tools.pop(arm, None)
        self._assemble()

    # -- the model -----------------------------------------------------------------------------------------------------

    def _assemble(self) -> None:
        """Build model and matrices for the instruments now held, keeping the actuators' state. A few ms."""
        mechanisms = tuple(self._mechanism(robot) for robot in self._robots)
        self._assembly = assembly = assemble(mechanisms, self.period_s)
        self.model, self.data = assembly.model, mujoco.MjData(assembly.model)
        if len(assembly.gather) != self.axes:
            raise ValueError(f"the model has {len(assembly.gather)} joints for {self.axes} actuators")
        to_joint, to_actuator, to_pot = (np.zeros((self.axes, self.axes)) for _ in range(3))
        for robot in self._robots:
            part = self.slices[robot.name]
            pair = self._coupling(robot)
            to_joint[part, part] = pair.actuator_to_joint
            to_actuator[part, part] = pair.joint_to_actuator
            to_pot[part, part] = _pot_matrix(robot) @ pair.joint_to_actuator
        self._to_joint = assembly.spread @ to_joint
        self._to_actuator = to_actuator @ assembly.gather
        self._to_joint_effort = np.ascontiguousarray(self._to_actuator.T)
        self._to_pot = to_pot @ assembly.gather
        self._joint_position, self._joint_velocity = self.data.qpos, self.data.qvel
        self._applied = self.data.qfrc_applied
        self.effort, self._push, self._pull = (np.zeros(self.model.nv) for _ in range(3))  # on the model's joints
        self._is_pulled = False
        self.friction: Friction = Friction(assembly.coulomb, self.model.dof_armature, self.period_s)
        self._tips: Tips = Tips(assembly, self.data, mechanisms)
        self._play = self._drives(self._play)
        self._weights = weights_of(self._arms, self.slices, assembly.joints,
                                   {robot: like.mass for robot, like in self._like.items()}, self.model.nv,
                                   self.period_s, self._supported)
        self._weight = np.zeros(self.model.nv) if self._weights is None else self._weights.effort
        self._is_heavy = 0 if self._weights is None else HEAVY
        (self._apply,) = library.chosen(PLANT, self)
        self._take_push()
        self._carry()
        self._take_state()
        self._constrain()

    def _mechanism(self, robot: Robot) -> Mechanism:
        arm = self._arms.get(robot.name)
        name = arm.name if arm is not None else ""
        return mechanism(robot, arm, self._tools.get(name), self._links.get(name), self._like[robot.name])

    def _coupling(self, robot: Robot) -> Coupling:
        arm = self._arms.get(robot.name)
        count = len(robot.actuators)
        if arm is None or description(arm, count) is None:
            return Coupling(np.eye(count))
        return coupling(count, arm.chain, self._tools.get(arm.name))

    def _drives(self, earlier: Play | None) -> Play | None:
        """Motors that are masses of their own: those of robots with play."""
        gaps = np.zeros(self.axes)
        parts = [self.slices[robot.name] for robot in self._robots if has_play(self._like[robot.name])]
        if not parts:
            return None
        for robot in self._robots:
            gaps[self.slices[robot.name]] = self._like[robot.name].backlash or 0.0
        places = np.concatenate([np.arange(part.start, part.stop) for part in parts])
        inertia = self.motor_inertia()
        friction = np.abs(self._to_joint).T @ self.friction.limit
        motors = SHARE / (1.0 - SHARE)
        play = Play(places, gaps[places], motors * np.diag(inertia)[places], motors * friction[places],
                    np.linalg.inv(inertia)[np.ix_(places, places)], self.period_s)
        if earlier is not None:
            play.resume(earlier)
        return play

    def _constrain(self) -> None:
        """Followers and braked joints, from the current joint positions."""
        blocks = []
        for robot in self._robots:
            part, joints = self.slices[robot.name], self._assembly.joints[robot.name]
            ties = self._assembly.ties.get(robot.name, np.zeros((0, self.model.nv)))
            held = self._to_actuator[part][self._is_braked[part] | self._is_jammed[part]]
            if len(ties) + len(held):
                values = np.concatenate((np.zeros(len(ties)), held @ self._joint_position))
                blocks.append(Block(joints, np.concatenate((ties, held)), values))
        self._projection = Projection(self.model, self.data, blocks) if blocks else None

    def _take_push(self) -> None:
        self._assembly.gather.T.dot(self._pushed, self._push)
        self._is_pushed = PUSHED if self._pushed.any() else 0

    def _take_state(self) -> None:
        """Joints from the actuators' position and velocity."""
        position = self.position.copy()
        if self._play is not None:
            self._play.take_off(position)
        np.matmul(self._to_joint, position, out=self._joint_position)
        np.matmul(self._to_joint, self.velocity, out=self._joint_velocity)
        if self._has_pots:
            self._read_pots()

    def _switch_on(self, emulation: EmulationConfig) -> None:
        """Arm positions at switch-on: those of the table, varied a little by the seed; loose axes in mid-range."""
        scatter = np.random.default_rng(emulation.seed).uniform(-SCATTER, SCATTER, self.axes)
        for robot in self._robots:
            part = self.slices[robot.name]
            arm = self._arms.get(robot.name)
            row = description(arm, len(robot.actuators))
            middle = row.initial if row is not None else tuple(_middle(robot))
            scale = [MARGIN_SLIDE / MARGIN if a.joint_type == "PRISMATIC" else 1.0 for a in robot.actuators]
            self.position[part] = np.array(middle) + scatter[part] * np.array(scale)

    def _come_off_stops(self) -> None:
        """An instrument held at switch-on may not allow where the table puts the discs: move to its nearest stop."""
        limited = self.model.jnt_limited.astype(bool)
        lower, upper = np.where(limited, self.model.jnt_range.T, ((-np.inf,), (np.inf,)))
        np.matmul(self._to_actuator, np.clip(self._joint_position, lower, upper), out=self.position)
        self._take_state()


def _model_variations(emulation: EmulationConfig, robots: tuple[Robot, ...]) -> dict[str, ModelVariation]:
    """Deviations of every robot from its files; ValueError names invalid ones."""
    like = {robot.name: ModelVariation(robot.name) for robot in robots}
    counts = {robot.name: (len(robot.actuators), len(robot.brakes)) for robot in robots}
    for one in emulation.model_variations:
        if one.robot not in like:
            raise ValueError(f"{one.robot}: no such robot to vary; there are {', '.join(like) or 'none'}")
        for what, given, allowed in one.wrong_sizes(*counts[one.robot]):
            raise ValueError(f"{one.robot}: {given} numbers of {what}; allowed: {allowed}")
        like[one.robot] = one
    return like


def _instruments(system: SystemConfig) -> dict[str, Tool]:
    """Instruments inserted at start: those the emulation names, else those that are fixed on their arm."""
    tools = {arm.name: arm.tool for arm in system.arms if arm.tool is not None}
    for arm_name, tool_name in system.emulation.instruments if system.emulation is not None else ():
        arm = system.arm(arm_name)
        known = {tool.name: tool for tool in (*arm.tools, *((arm.tool,) if arm.tool is not None else ()))}
        if tool_name not in known:
            raise ValueError(f"{arm_name}: instrument {tool_name} is not known; there are {', '.join(sorted(known))}")
        tools[arm_name] = known[tool_name]
    return tools


def _effort_per_current(robots: tuple[Robot, ...]) -> Array:
    """N·m/A (or N/A) of every actuator; 0 without a motor in the file (grippers)."""
    scales = np.array([a.effort_to_current for robot in robots for a in robot.actuators])
    efforts: Array = np.divide(1.0, scales, out=np.zeros_like(scales), where=scales != 0.0)
    return efforts


def _middle(robot: Robot) -> list[float]:
    """The middle of each actuator's encoder range; 0 where it has none, and half open for a gripper."""
    encoders = [actuator.encoder for actuator in robot.actuators]
    other = GRIPPER_INITIAL if is_gripper(robot.name) else 0.0
    return [0.5 * (e.lower + e.upper) if e is not None and e.lower < e.upper else other for e in encoders]


def _pot_matrix(robot: Robot) -> Array:
    """Matrix from actuator positions to the potentiometers' quantity (joints, if the file has a matrix between)."""
    if robot.joint_to_actuator_position is None:
        return np.eye(len(robot.actuators))
    actuator_to_pot: Array = np.linalg.inv(np.array(robot.joint_to_actuator_position))
    return actuator_to_pot
