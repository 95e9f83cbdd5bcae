"""Stage `gravity`: a master's weight, from the efforts that hold it in a set of poses, into a gravity file (2.0)."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np

from trocar.procs.document.arms import MODELLED_JOINTS, ArmConfig, MasterGravityParameters
from trocar.procs.document.keys import keys_in
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.kinematics.master_gravity import GRAVITY
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.client.arm import Arm
from trocar.tools.client.shared import SharedWays
from trocar.tools.commission import gravity_fit, home, io_file
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.gravity_fit import HeldPoses
from trocar.tools.commission.move import end, limits, steady
from trocar.tools.commission.subject import Subject
from trocar.tools.commission.window import Floats, Window
from trocar.tools.inspect.watch import arm_document
from trocar.tools.output.printing import span

RATIO, PREVIEW_RATIO = 0.4, 0.15  # of the usual speed
TIMEOUT_S: Final = 60.0
SETTLE_S, LOOK_S = 0.4, 0.1
STILL_RAD: Final = 0.02
"""Motion of a joint while its effort is measured, at most."""
REHEARSED: Final = 2
"""Of so many poses, a rehearsal takes one."""
START: Final = (0.0, 0.0, 0.0, 0.0, math.pi / 2, 0.0, 0.0)
FIELDS: Final = {key.name: field.name for field, _, key in keys_in(MasterGravityParameters)}
"""Of the parameters, by their keys in the file."""
Goes = Callable[[Floats, float], Window]
"""Moves all joints to a position (7,) at a share of the usual speed; samples there."""


def run(bench: RunningBench, folder: Path, *, write: bool = False) -> Outcome:
    """One master after the other; its file is written if the model predicts poses that it was not made from."""
    masters = [each for each in bench.subjects if each.kind == home.MASTER]
    outcome = Outcome(notes=[] if masters else ["no master: gravity of other arms is in their kinematic files"])
    for subject in masters:
        bench.person.confirm(
            f"{subject.whole()} homes and then moves through most of its workspace for several minutes, by itself. "
            "Keep 0.5 m around it clear, the other master far away, nothing on its gripper, hands off the arm, one "
            "hand on the emergency stop.", subject.name)
        try:
            if outcome.add(home.homed(bench, subject)) or outcome.add(_one(bench, subject, outcome, folder, write)):
                break
        finally:
            bench.disable(subject)
    return outcome


def _one(bench: RunningBench, subject: Subject, outcome: Outcome, folder: Path, write: bool) -> list[Finding]:
    document, arm = arm_document(bench.system, subject.arm), Arm(SharedWays(bench.system), subject.arm)
    ratio = arm.trajectory_j_get_ratio() or 1.0

    def goes(goal: Floats, share: float) -> Window:
        arm.trajectory_j_set_ratio(share)
        arm.move_jp(goal).wait(TIMEOUT_S)
        bench.sample(subject.io, SETTLE_S)
        return bench.sample(subject.io, LOOK_S)

    try:
        low, high, _ = limits(bench, subject, len(steady(arm.setpoint_jp)))
        poses, found = measured(goes, bench, subject, document, low, high)
    finally:
        end(arm, ratio)
    if poses is None:
        return found
    trial, rest = gravity_fit.halves(poses)
    first, made = gravity_fit.fitted(trial), gravity_fit.fitted(poses)
    off, most = gravity_fit.errors(first, rest), gravity_fit.allowed(rest)
    outcome.figures[subject.name] = {"poses": len(poses.joint), "error_nm": gravity_fit.errors(made, poses).tolist(),
                                     "unseen_error_nm": off.tolist(), "allowed_nm": most.tolist()}
    if found := judge(off, most, subject):
        return found
    _report(bench, subject, document, poses, made)
    _save(bench, outcome, subject, document, made, off, (folder, write))
    return []


def measured(goes: Goes, bench: RunningBench, subject: Subject, document: ArmConfig, low: Floats, high: Floats) -> \
        tuple[HeldPoses | None, list[Finding]]:
    """All poses, within these limits of the joints; None and the problems if it cannot be measured."""
    pair = coupling(len(subject.robot.actuators), document.chain)
    scale = np.array([actuator.effort_to_current for actuator in subject.robot.actuators])
    left = sum(subject.range_of(0)) > 0.0  # a left master's first joint goes further outwards, to positive positions
    plan = gravity_fit.sweeps(left, low, high, REHEARSED if bench.document.emulation is not None else 1)
    start = np.array(START)
    count = Countdown(bench, f"{subject.name}: ends of its motions", 4 * len(plan))
    for sweep in plan:  # once through all ends, slowly, on the ways of the measurement
        for goal in (start, sweep.positions[0], sweep.positions[-1], sweep.positions[0]):
            count.next()
            goes(goal, PREVIEW_RATIO)
    goes(start, PREVIEW_RATIO)
    if not bench.person.agrees(f"{subject.name} has been at all ends of its motions. Did it stay 10 cm away from "
                               "everything, and did its cables stay loose?"):
        return None, [Finding(subject.whole(), "it came too close to something", "10 cm all around",
                              "clear its workspace, or turn the setup, and repeat this stage")]
    rows = []
    count = Countdown(bench, f"{subject.name}: pose", 2 * sum(len(sweep.positions) for sweep in plan))
    for sweep in plan:
        goes(start, RATIO)
        for upwards in (True, False):
            for turn, goal in enumerate(sweep.positions if upwards else sweep.positions[::-1]):
                count.next()
                window = goes(goal, RATIO)
                if turn == 0:  # reached from either side
                    continue
                position = window.axes("position", subject) @ pair.actuator_to_joint.T
                if not np.ptp(position, axis=0)[:MODELLED_JOINTS].max() <= STILL_RAD:
                    return None, [Finding(subject.whole(), "it does not stand still at a pose", f"{STILL_RAD:g} rad",
                                          "is something touching it? Else its gains are wrong: trocar pid show")]
                current = window.drives("current_request", subject)[:, : len(scale)].mean(axis=0)
                rows.append((sweep.joint, upwards, turn, position.mean(axis=0),
                             pair.joint_to_actuator.T @ (current / scale)))
    goes(start, RATIO)
    return gravity_fit.held(rows), []


class Countdown:
    """Shows how many of `total` steps are left, and for how long at the pace so far (in real time)."""

    def __init__(self, bench: RunningBench, what: str, total: int) -> None:
        self._bench, self._what, self._total = bench, what, total
        self._done, self._begin_ns = 0, monotonic_ns()

    def next(self) -> None:
        """The next step begins."""
        passed_s = (monotonic_ns() - self._begin_ns) * 1e-9
        left = f", about {span(passed_s / self._done * (self._total - self._done))} left" if self._done else ""
        self._done += 1
        self._bench.person.progress(f"{self._what} {self._done} of {self._total}{left}")


def judge(off: Floats, most: Floats, subject: Subject) -> list[Finding]:
    """Errors (6,) in poses that a fit has not seen."""
    return [Finding(f"{subject.name} joint {joint} ({subject.names[joint]})",
                    f"the model misses efforts by {off[joint]:.4f} N·m", f"{most[joint]:.4f} N·m",
                    "was the arm touched, or does a cable pull? Is friction high, or a current offset wrong (stage "
                    "currents)? Repeat this stage")
            for joint in range(MODELLED_JOINTS) if not off[joint] <= most[joint]]


def _report(bench: RunningBench, subject: Subject, document: ArmConfig, poses: HeldPoses,
            made: MasterGravityParameters) -> None:
    """Show the residuals of the new file, and of the old one."""
    bench.person.report(f"{subject.name}: residual in its {len(poses.joint)} poses, N·m rms (joints 0 to 5)")
    for what, model in (("old file", document.master_gravity), ("new file", made)):
        if model is not None:
            values = " ".join(f"{value:.4f}" for value in gravity_fit.errors(model, poses))
            bench.person.report(f"  {what}: {values}")


def _save(bench: RunningBench, outcome: Outcome, subject: Subject, document: ArmConfig, made: MasterGravityParameters,
          off: Floats, into: tuple[Path, bool]) -> None:
    folder, write = into
    source = Path(document.source)
    serial = document.serial or subject.robot.serial
    name = f"gc-{document.name}-{serial or 'unknown'}.json"
    content = {"ARM_NAME": document.name, "SN": serial, "version": "2.0",
               "date_time": datetime.now().astimezone().isoformat(timespec="seconds"),
               "lse": {"g_constant": GRAVITY, "unseen_error_nm": [float(f"{value:.4g}") for value in off]},
               "GC_controller": {key: list(getattr(made, field)) for key, field in FIELDS.items()}
               | {"GC_init_pos": [math.degrees(value) for value in START]}}
    io_file.save_new(bench, outcome, (source.parent if write else folder) / name, content,
                     f"the gravity file of {document.name} (gravity_compensation in {source.name})", source)
