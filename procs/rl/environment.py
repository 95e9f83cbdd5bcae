"""Common parts of all environments: an episode on a robot, with any backend, in the terms of Gymnasium."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any, ClassVar, Final, Self

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle

from trocar.procs.kinematics.poses import Array, turned
from trocar.procs.rl.attached import AttachedRobot, RunningSystem
from trocar.procs.rl.backend import ATTACHED, BACKENDS, BOARDS, KINEMATIC, RobotBackend, RobotStopped, WrongAction
from trocar.procs.rl.hosted import PERIOD_S, HostedRobot, document
from trocar.procs.rl.model import STARTS
from trocar.procs.rl.picture import Picture
from trocar.procs.rl.scene import Drawn, scene_of
from trocar.procs.rl.steering import CARTESIAN, CONTROLS, Interpolator, Steering
from trocar.shm.mailbox.client import MailboxFull
from trocar.shm.memory.segment import SegmentError

Observation = dict[str, Array]
Info = dict[str, Any]

DENSE, SPARSE = "dense", "sparse"
POLICY_HZ: Final = (10, 50)
STREAM_HZ: Final = (100, 200)
FURTHEST, QUICKEST = 10.0, 100.0
"""Bounds of the observations: m and rad, m/s and rad/s."""
NS: Final = 1_000_000_000
REFUSED_NS: Final = 100_000_000
"""An arm that does not follow for this long is not ours; a shorter time means a trembling base."""
MAX_PIXELS: Final = 4096
OPTIONS: Final = ("start", "goal")
"""Of reset."""


class RobotEnv(gymnasium.Env[Observation, Array], EzPickle):
    """A task for arms of the real stack; subclasses define it. Unpickling makes it again from its arguments."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012  # as in Gymnasium
    FILES: ClassVar[Mapping[str, str]] = {}
    """The system file of each backend in this process."""
    TYPE: ClassVar[str] = "PSM"
    ARMS: ClassVar[tuple[str, ...]] = ()
    JAWS: ClassVar[tuple[float, ...]] = ()
    """Start position of each arm, rad."""
    GOAL: ClassVar[int] = 3
    """Numbers of a goal."""
    FLOOR_M: ClassVar[float] = 0.05
    VIEW_M: ClassVar[float] = 0.12
    """Pictures show this much below and above the tips at the centre of the starts; the floor is below."""
    EXTRA: ClassVar[tuple[str, ...]] = ()
    """The task's additions to the observation."""
    IS_GIVEN: ClassVar[bool] = True
    """`reset` accepts a goal; False: the goal moves by itself."""

    def __new__(cls, *args: Any, **options: Any) -> Self:
        """Stores the arguments, including those of subclasses; TypeError for one that the class does not take."""
        allowed = _options_of(cls)
        if wrong := next((name for name in options if name not in allowed), ""):
            raise TypeError(f"{cls.__name__} has no option {wrong}; allowed: {', '.join(allowed)}")
        env = super().__new__(cls)
        EzPickle.__init__(env, *args, **options)
        return env

    def __init__(self, *, backend: str | RunningSystem = KINEMATIC, control: str = CARTESIAN, reward: str = DENSE,
                 policy_hz: int = 20, stream_hz: int = 100, horizon: int = 100, speed: float = 0.2,
                 tolerance_m: float = 0.005, noise_m: float = 0.0, starts: int = STARTS, period_s: float = PERIOD_S,
                 physics_s: float = PERIOD_S, walls: Sequence[Mapping[str, Any]] = (),
                 render_mode: str | None = None, width: int = 480, height: int = 360) -> None:
        """ValueError names invalid arguments. `backend`: "kinematic", "boards", "attached" or a `RunningSystem`.

        `horizon`: steps of an episode; `speed`: fraction of the arm's own velocity limits; `noise_m`: standard
        deviation of the noise on observed positions; `starts`: number of start poses; `walls`: with the keys of a
        system file.
        """
        _one_of("control", control, CONTROLS)
        _one_of("reward", reward, (DENSE, SPARSE))
        _one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        for name, value, least, most in (
                ("policy_hz", policy_hz, *POLICY_HZ), ("stream_hz", stream_hz, *STREAM_HZ), ("speed", speed, 0.01, 1.0),
                ("horizon", horizon, 1, 1_000_000), ("starts", starts, 1, STARTS), ("noise_m", noise_m, 0.0, 0.1),
                ("tolerance_m", tolerance_m, 1e-4, 0.1), ("width", width, 16, MAX_PIXELS),
                ("height", height, 16, MAX_PIXELS)):
            _within(name, value, least, most)
        if stream_hz % policy_hz:
            raise ValueError(f"stream_hz is {stream_hz}; it has to be a multiple of policy_hz, {policy_hz}")
        self.metadata = {**self.metadata, "render_fps": policy_hz}
        self.render_mode, self.horizon, self.tolerance_m, self.noise_m = render_mode, horizon, tolerance_m, noise_m
        self.period_s, self._tick_ns = 1.0 / policy_hz, NS // stream_hz
        self._is_sparse, self._size, self._starts_count = reward == SPARSE, (width, height), starts
        self.robot = self._robot(backend, period_s, physics_s, walls)
        models = self.robot.models
        self._steering = [Steering(model, control, speed, self.period_s) for model in models]
        self._lines = [Interpolator(steering, stream_hz // policy_hz) for steering in self._steering]
        self._parts = stream_hz // policy_hz
        self._starts = [model.starts() for model in models]
        self.contents = self._named()
        """Meanings of the numbers in `observation`, with units."""
        self._actions = sum(each.size for each in self._steering)
        self._most = np.array([QUICKEST if "/s" in name else FURTHEST for name in self.contents])
        goals = np.full(self.GOAL, FURTHEST)
        # typed as spaces of any numbers there: actions are float32, as learners have them
        self.action_space: Any = spaces.Box(-1.0, 1.0, (self._actions,), np.float32)
        self.observation_space: Any = spaces.Dict({
            "observation": _bounded(self._most), "achieved_goal": _bounded(goals), "desired_goal": _bounded(goals)})
        self._seen = [np.zeros(2 * model.count + 1 + 7) for model in models]
        self.tips = np.zeros((len(models), 3))
        """Last observed tip positions, m; with noise, if any."""
        self.steps, self._grid_ns, self._fault = 0, 0, ""
        self.goal = np.zeros(self.GOAL)
        self._has_begun = self._is_closed = False
        self._picture: Picture | None = None

    def _robot(self, backend: str | RunningSystem, period_s: float, physics_s: float,
               walls: Sequence[Mapping[str, Any]]) -> RobotBackend:
        if walls and backend not in (KINEMATIC, BOARDS):
            raise ValueError("walls: those of a running system are its own, of its file or added by commands")
        if isinstance(backend, RunningSystem):
            return AttachedRobot(backend, self.TYPE, self.ARMS, self.JAWS)
        _one_of("backend", backend, BACKENDS)
        if backend == ATTACHED:
            return AttachedRobot(RunningSystem(), self.TYPE, self.ARMS, self.JAWS)
        if backend not in self.FILES:
            raise ValueError(f"{type(self).__name__} has no backend {backend}; it has {', '.join(self.FILES)}")
        return HostedRobot(document(self.FILES[backend], backend, period_s, physics_s,
                                     json.dumps(list(walls)) if walls else ""), self.ARMS, self.JAWS)

    def _named(self) -> tuple[str, ...]:
        names: list[str] = []
        for model in self.robot.models:
            space = model.space
            units = [space.unit(axis) for axis in range(model.count)]
            joints = [f"{model.name} {space.name(axis)}" for axis in range(model.count)]
            names += [f"{joint} [{unit}]" for joint, unit in zip(joints, units, strict=True)]
            names += [f"{joint} velocity [{unit}/s]" for joint, unit in zip(joints, units, strict=True)]
            names += [f"{model.name} jaw [rad]"] if model.has_jaw else []
            names += [f"{model.name} tip {axis} [m]" for axis in "xyz"]
            names += [f"{model.name} tip's {own} axis, {axis}" for own in "xz" for axis in "xyz"]
        return (*names, *self.EXTRA)

    # episodes

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Start an episode. `options`: "start", number of a start pose; "goal", the goal (GOAL,).

        With a running system the arms move there slowly; RobotStopped if an operator must check them first.
        """
        self._check_open()
        super().reset(seed=seed)
        options = options or {}
        if unknown := sorted(options.keys() - OPTIONS):
            raise ValueError(f"options have {', '.join(unknown)}; allowed: {', '.join(OPTIONS)}")
        goal = self._given_goal(options.get("goal"))
        number = int(self.np_random.integers(self._starts_count))
        noise = int(self.np_random.integers(1 << 31))
        number = _given_start(options.get("start", number))
        self._has_begun = False
        self.robot.begin(number, [starts[number] for starts in self._starts], noise)
        self.steps, self._grid_ns, self._fault = 0, self.robot.now_ns(), ""
        for link, steering, line in zip(self.robot.links, self._steering, self._lines, strict=True):
            link.look()
            link.hear()
            link.forget()
            steering.begin(*link.setpoint(steering.model.count))
            line.begin()
        self._look()
        if self._fault:
            raise RobotStopped(self._fault)
        self.begin_task(self.np_random)
        if goal is not None:
            self.goal = goal
        self._has_begun = True
        return self._observation(), self._info()

    def _check_open(self) -> None:
        if self._is_closed:
            raise gymnasium.error.ClosedEnvironmentError("this environment is closed; make a new one")

    def _given_goal(self, goal: object) -> Array | None:
        if goal is None:
            return None
        if not self.IS_GIVEN:
            raise ValueError(f"the goal of {type(self).__name__} is chosen by the environment; none can be given")
        found = np.asarray(goal, dtype=np.float64)
        if found.shape != (self.GOAL,) or not (np.abs(found) <= FURTHEST).all():
            raise ValueError(f"a goal is {self.GOAL} numbers from {-FURTHEST:g} to {FURTHEST:g}, not {goal!r}")
        return found.copy()

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, Info]:
        """Act for one period of the policy. Terminated: a fault; truncated: `horizon` steps have passed."""
        if not self._has_begun:
            self._check_open()
            self.robot.check()
            raise gymnasium.error.ResetNeeded("an episode begins with reset")
        given = self._given_action(action)
        first = 0
        for number, steering in enumerate(self._steering):
            steering.take(given[first : first + steering.size])
            self.robot.heads_for(number, steering.joints, steering.jaw)
            first += steering.size
        try:
            self._stream()
        except (RobotStopped, MailboxFull, SegmentError) as error:
            if self._fault:
                raise
            self._fail(str(error))
        self.steps += 1
        self._look()
        self.go_on()
        observation, info = self._observation(), self._info()
        reward = float(self.compute_reward(observation["achieved_goal"], observation["desired_goal"], info))
        return observation, reward, bool(self._fault), self.steps >= self.horizon, info

    def _given_action(self, action: object) -> Array:
        try:
            given = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):  # texts, rows of different lengths
            given = np.zeros(0)
        if given.shape != (self._actions,) or not np.isfinite(given).all():
            raise WrongAction(f"an action is {self._actions} finite numbers, not {action!r}")
        return given

    def _stream(self) -> None:
        """Send setpoints at equal times; a step begins at the end of the previous one, unless we are late."""
        robot, tick_ns = self.robot, self._tick_ns
        now_ns = robot.now_ns()
        start_ns = self._grid_ns if now_ns - self._grid_ns < tick_ns else now_ns
        for link in robot.links:
            link.forget()
        for part, setpoints in enumerate(zip(*(line.setpoints() for line in self._lines), strict=True), 1):
            robot.keeps_pace(tick_ns)
            for link, commands in zip(robot.links, setpoints, strict=True):
                for command, values in commands:
                    link.send(command, values)
            robot.wait_until(start_ns + part * tick_ns)
            for number, link in enumerate(robot.links):
                link.hear()
                if link.refusals * tick_ns > REFUSED_NS:
                    raise RobotStopped(robot.look(number) or f"{link.name} refuses: {link.refusal}")
        self._grid_ns = start_ns + self._parts * tick_ns

    def _look(self) -> None:
        """Read all arms; a failed one keeps its last values."""
        noise = self.np_random.normal(0.0, self.noise_m, self.tips.shape) if self.noise_m else np.zeros(self.tips.shape)
        for number, (link, model, seen) in enumerate(zip(self.robot.links, self.robot.models, self._seen, strict=True)):
            if why := self.robot.look(number):
                self._fail(why)
                continue
            n = model.count
            seen[:n], seen[n : 2 * n], seen[2 * n] = link.joints(n)
            seen[2 * n + 1 :] = link.pose()
            self.tips[number] = seen[2 * n + 1 : 2 * n + 4] + noise[number]

    def _fail(self, why: str) -> None:
        if not self._fault:
            self._fault = why
            self.robot.stop(why)

    def _observation(self) -> Observation:
        parts: list[Array] = []
        for tip, model, seen in zip(self.tips, self.robot.models, self._seen, strict=True):
            n = model.count
            parts += [seen[: 2 * n + int(model.has_jaw)], tip, axes_of(seen[2 * n + 4 :])]
        numbers = np.concatenate((*parts, self.extra()))
        return {"observation": np.clip(numbers, -self._most, self._most), "achieved_goal": self.achieved(),
                "desired_goal": self.goal.copy()}

    def _info(self) -> Info:
        refused = "; ".join(f"{link.name}: {link.refusal}" for link in self.robot.links if link.refusal)
        walls = "; ".join(f"{link.name}: {link.wall}" for link in self.robot.links if link.wall)
        distance = float(self.distance(self.truly_achieved(), self.goal))
        return {"is_success": distance < self.tolerance_m and not self._fault, "distance_m": distance,
                "state": ", ".join(link.state for link in self.robot.links), "fault": self._fault, "refused": refused,
                "at_wall": walls, "time_s": self.steps * self.period_s}

    def compute_reward(self, achieved_goal: Array, desired_goal: Array, info: object) -> Any:
        """Rewards (...) of goals (..., GOAL): minus their distance in m, or, sparse, 0 where it is reached, else −1."""
        distance = self.distance(achieved_goal, desired_goal)
        return np.where(distance < self.tolerance_m, 0.0, -1.0)[()] if self._is_sparse else -distance

    def distance(self, achieved_goal: Array, desired_goal: Array) -> Array:
        """Distance between goals (..., GOAL): (...), m."""
        return np.asarray(np.linalg.norm(np.asarray(achieved_goal) - np.asarray(desired_goal), axis=-1))

    # the task

    def begin_task(self, random: np.random.Generator) -> None:
        """Called when an episode begins, after reading the arms: draw `goal`, only from this generator."""
        raise NotImplementedError

    def go_on(self) -> None:
        """Called after each step and after reading the arms: update goals and objects."""

    def achieved(self) -> Array:
        """The achieved goal (GOAL,), as observed."""
        return np.array(self.tips[0])

    def truly_achieved(self) -> Array:
        """The same without noise."""
        return np.array(self.seen_pose(0)[:3])

    def extra(self) -> Array:
        """The values that EXTRA names."""
        return np.zeros(0)

    def seen_pose(self, number: int) -> Array:
        """Pose (7,) of the tip of an arm, without noise."""
        return np.array(self._seen[number][2 * self.robot.models[number].count + 1 :])

    def seen_joints(self, number: int) -> tuple[Array, float]:
        """Measured joints (count,) and jaw of an arm."""
        n = self.robot.models[number].count
        return self._seen[number][:n].copy(), float(self._seen[number][2 * n])

    # pictures

    def render(self) -> Any:
        """A picture (height, width, 3) where render_mode is "rgb_array"; PictureError where none can be drawn."""
        self._check_open()
        if self.render_mode is None:
            return None
        if self._picture is None:
            self._picture = Picture(*self._size)
        arms = [(model, *self.seen_joints(number)) for number, model in enumerate(self.robot.models)]
        middle = np.mean([model.middle for model in self.robot.models], axis=0)
        middle[2] += 0.5 * (self.VIEW_M - self.FLOOR_M)
        floor_m = float(middle[2]) - 0.5 * (self.VIEW_M + self.FLOOR_M)
        return self._picture.draw(scene_of(arms, self.things()), middle, floor_m, 2.4 * (self.VIEW_M + self.FLOOR_M))

    def things(self) -> list[Drawn]:
        """Objects to draw beside the arms."""
        return []

    def close(self) -> None:
        """Close it; with a running system, the arms hold."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None
        self._has_begun, self._is_closed = False, True
        self.robot.close()


def _options_of(made: type) -> list[str]:
    """The options that a class takes by name, with those that it passes on to the classes below."""
    names: list[str] = []
    for each in made.__mro__:
        if "__init__" in vars(each):
            given = list(inspect.signature(vars(each)["__init__"]).parameters.values())[1:]
            names += [row.name for row in given if row.kind in (row.KEYWORD_ONLY, row.POSITIONAL_OR_KEYWORD)]
            if not any(row.kind is row.VAR_KEYWORD for row in given):
                break  # the others receive none of it
    return names


def _one_of(name: str, given: object, allowed: tuple[object, ...]) -> None:
    if given not in allowed:
        raise ValueError(f"{name} is {given!r}; allowed: {', '.join(map(repr, allowed))}")


def _within(name: str, given: Any, least: float, most: float) -> None:
    """Bounds that are whole numbers are those of one."""
    is_whole = isinstance(least, int)
    kind: Any = Integral if is_whole else Real
    if not isinstance(given, kind) or not least <= given <= most:
        raise ValueError(f"{name} is {given!r}; allowed: {least} to {most}{', a whole number' if is_whole else ''}")


def _bounded(most: Array) -> spaces.Box:
    return spaces.Box(-most, most, dtype=np.float64)


def _given_start(number: object) -> int:
    if not isinstance(number, int | np.integer) or not 0 <= number < STARTS:
        raise ValueError(f"start is {number!r}; allowed: 0 to {STARTS - 1}")
    return int(number)


def axes_of(quaternion: Array) -> Array:
    """The x and the z axis (6,) of a rotation given as x y z w (4,)."""
    turn = quaternion.tolist()
    return np.array((*turned(turn, (1.0, 0.0, 0.0)), *turned(turn, (0.0, 0.0, 1.0))))
