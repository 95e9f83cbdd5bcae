"""`trocar bench arm`: the CPU time that an arm's cycle and its kinematics take.

KINEMATIC arms with their io, both in this process, on rings and mailboxes of a system of their own and on a clock that
is stepped. The timed part (thread CPU time) is an arm's whole cycle: io's record and the commands in, the setpoints and
the arm's state out. A PSM with a large needle driver; MTM and ECM beside it. All of it is measured with the native
library and then without, arm by arm; keys that end in _numpy are without.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.host.stepped_arm import SteppedArm
from trocar.procs.kinematics.poses import matrix_from_pose, pose_from_matrix
from trocar.procs.native.library import native
from trocar.shm.system.subscriptions import Subscriber
from trocar.tools.bench.measuring import percentiles, without_native
from trocar.tools.output.errors import Problem
from trocar.tools.systems.cleanup import Keeper

Array = NDArray[np.float64]

CYCLES = 20_000
POSES = 20_000
SLOWER = 4  # this many times fewer without the native library
STEPS = 40_000  # of the clock until homed
FILES = {"": "kinematic", "_ecm": "kinematic-ecm", "_mtm": "kinematic-mtm"}
AMPLITUDE = 0.3  # rad, and a tenth of this in m
SWAY = 1e-6
US = 1e-3  # of ns
NEAR = 0.002  # rad and m from one pose to the next: a master moved fast


def run(cycles: int = CYCLES, poses: int = POSES) -> dict[str, Any]:
    """Measure."""
    figures: dict[str, float] = {}
    for suffix, file in FILES.items():
        figures |= _figures(file, suffix, cycles, poses)
        if native().library is not None:
            with without_native():
                slow = _figures(file, suffix, cycles // SLOWER, poses // SLOWER)
            figures |= {f"{key}_numpy": value for key, value in slow.items()}
    if native().library is not None:
        figures["native_ratio"] = figures["cycle_following_cpu_us_p50_numpy"] / figures["cycle_following_cpu_us_p50"]
    conditions = {"cycles": cycles, "poses": poses, "time": "thread CPU time",
                  "arms": {suffix or "(none)": file for suffix, file in FILES.items()}}
    return {"figures": figures, "conditions": conditions}


def _figures(file: str, suffix: str, cycles: int, poses: int) -> dict[str, float]:
    with arm_bench(file) as bench:
        home(bench)
        figures = {f"{key}{suffix}": value for key, value in _measure(bench, cycles).items()}
        return figures if suffix else figures | kinematics(bench, poses)


@contextlib.contextmanager
def arm_bench(file: str) -> Iterator[SteppedArm]:
    """The arm of a system file, and the io that plays its robot; both are removed at any end."""
    name = f"bench-arm-{os.getpid()}"
    loaded = load_system(PROJECT_CONFIGS / "systems" / f"{file}.yaml", name=name, sets=["clock=wall"])
    if loaded.errors or loaded.system is None:
        raise Problem(f"{file}.yaml cannot be read: {loaded.errors}")
    with Keeper(name), SteppedArm(loaded.system) as bench:
        yield bench


def home(bench: SteppedArm) -> None:
    """Power on, home, bend the arm into its workspace."""
    for word, state in (("enable", "ENABLED"), ("home", "HOMED")):
        bench.step()
        bench.send("state_command", (), word)
        for _ in range(STEPS):
            bench.step()
            if bench.arm.state == state:
                break
        else:
            raise Problem(f"{bench.arm_name} did not get beyond {bench.arm.state}")
    for _ in range(2000):  # instruments engage
        bench.step()


def _measure(bench: SteppedArm, cycles: int) -> dict[str, float]:
    holding = [bench.step() for _ in range(cycles)]
    measuring = [bench.step(SWAY if cycle % 2 else -SWAY) for cycle in range(cycles)]
    with contextlib.closing(Subscriber(bench.name, bench.arm_name, "bench")) as subscriber:
        subscriber.want("state", "wrench", "spatial_jacobian")
        wanted = [bench.step(SWAY if cycle % 2 else -SWAY) for cycle in range(cycles)]
    n = bench.arm.joints.count
    wave = np.full(n, AMPLITUDE)
    centre = bench.arm.io.setpoint[:n].copy()
    prismatic = bench.arm.joints.v_max[:n] < 0.3  # m/s
    wave[prismatic] = 0.1 * AMPLITUDE
    moving = []
    for cycle in range(cycles):
        if cycle % 2000 == 0:
            bench.send("move_jp", centre + wave * (1.0 if cycle // 2000 % 2 else -1.0))
        moving.append(bench.step())
    for _ in range(4000):
        bench.step()
    pose = pose_from_matrix(bench.arm.control.cartesian.to_reference(bench.arm.control.cartesian.tip))
    following = []
    for cycle in range(cycles):
        angle = 2.0 * np.pi * cycle / 1500.0
        goal = pose.copy()
        goal[:3] += 0.01 * np.array((np.cos(angle) - 1.0, np.sin(angle), 0.3 * np.sin(angle)))
        bench.send("servo_cp", goal)
        following.append(bench.step())
    if bench.arm.control.motion.space != 2:
        raise Problem("the arm does not follow poses")
    return {
        **percentiles("cycle_cpu_us", moving, 50, 99, unit=US),
        **percentiles("cycle_holding_cpu_us", holding, 50, unit=US),
        **percentiles("cycle_measuring_cpu_us", measuring, 50, unit=US),
        **percentiles("cycle_wanted_cpu_us", wanted, 50, unit=US),
        **percentiles("cycle_following_cpu_us", following, 50, 99, unit=US),
    }


def kinematics(bench: SteppedArm, poses: int) -> dict[str, float]:
    """Forward and inverse kinematics of an arm by themselves."""
    joints = bench.arm.joints
    forward, inverse = joints.kinematics, joints.inverse
    if forward is None or inverse is None:
        raise Problem("the arm has no instrument")
    random = np.random.default_rng(1)
    n = joints.count
    low, high = joints.lower[:n], joints.upper[:n]
    middle, reach = 0.5 * (low + high), 0.35 * (high - low)
    seeds = middle + reach * random.uniform(-1.0, 1.0, (poses, n))
    seeds[:, 2] = np.maximum(seeds[:, 2], 0.08)
    goals = [forward.fk(q + NEAR * random.uniform(-1.0, 1.0, n), np.eye(4)) for q in seeds]
    near = [_timed(inverse.solve, goal, q) for goal, q in zip(goals, seeds, strict=True)]
    away = []
    for q in seeds:
        pose = np.zeros(7)
        pose[:3] = random.uniform(-1.0, 1.0, 3) * 0.6
        turn = random.normal(size=4)
        pose[3:] = turn / np.linalg.norm(turn)
        goal = matrix_from_pose(pose)
        took = _timed(inverse.solve, goal, q)
        if inverse.reason:
            away.append(took)
    forward_ns = [_timed(forward.update, q) for q in seeds]
    return {
        **percentiles("fk_jacobian_us", forward_ns, 50, unit=US), **percentiles("ik_near_us", near, 50, 99, unit=US),
        **percentiles("ik_unreachable_us", away, 50, 99.9, unit=US), "ik_unreachable_poses": float(len(away)),
    }


def _timed(what: Callable[..., Any], *arguments: Any) -> int:
    begin = time.thread_time_ns()
    what(*arguments)
    return time.thread_time_ns() - begin
