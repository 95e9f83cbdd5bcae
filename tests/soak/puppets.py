"""Programs of a user, as processes of their own that may be killed and held up: what they ask for is in `asked`.

    python -m tests.soak.puppets KIND SYSTEM ARM SEED

`move` sends moves one after the other, `pose` streams poses of the tip, `servo` joint positions, `velocity` joint
velocities, `effort` joint efforts, `wrench` a force at the tip, `lift` lifts a cart's column. A program prints a line
when it begins; one that is refused, or was held up itself, ends. On SIGUSR1 the next few poses, positions or velocities
are wrong ones (WRONG), and it prints which. `joints`, a stream of joint positions, is `trocar stream`.
"""

from __future__ import annotations

import random
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

import numpy as np
from numpy.typing import NDArray

from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.remote import Remote
from trocar.tools.examples.operator_sim import SeenRecord
from trocar.tools.output.errors import Problem

Array = NDArray[np.float64]

RATIO = 0.25  # of moves, set by the person
STEP_S = 0.01
HELD_UP_NS = 60_000_000
PLACE = np.array((0.1, -0.1, 0.12, 0.0, 0.0, 0.0))
REACH = np.array((0.35, 0.3, 0.03, 0.5, 0.3, 0.3))
SWING = np.array((0.08, 0.08, 0.01, 0.2, 0.1, 0.1))
TURN_S = 4.0
POSE_M, POSE_M_S = 0.012, 0.04
EFFORT = np.array((0.35, 0.35, 1.0, 0.02, 0.0, 0.0))
FORCE_N = 2.0
STREAMS = ("pose", "servo", "velocity")
WRONG: dict[str, Callable[[Array], Array]] = {  # what becomes of a goal
    "1 rad or m off": lambda goal: goal + np.eye(len(goal))[0],
    "1e6": lambda goal: goal + 1e6,
    "degrees": lambda goal: np.degrees(goal),
    "mm": lambda goal: np.concatenate((goal[:3] * 1000.0, goal[3:])),
    "100 rad/s": lambda goal: np.full(len(goal), 100.0),
    "not a number": lambda goal: np.where(np.arange(len(goal)) == 1, np.nan, goal),
}
MAX_WRONG = 5  # goals
asked_for: list[int] = []
ROWS = 3000


def asked(kind: str) -> tuple[Sequence[float], Sequence[float]]:
    """How fast a puppet that does not push asks the joints of a PSM, or its tip, to go."""
    top = RATIO * np.array(ARM_TYPES["PSM"].moves.velocity)
    if kind == "move":
        return top.tolist(), ()
    if kind in ("joints", "servo", "velocity"):  # the way to the first row is a move
        return np.maximum(top, [*SWING * 2.0 * np.pi / TURN_S, 0.0]).tolist(), ()
    return (), (POSE_M_S, 0.0)


def stream_file(path: Path, first: Array) -> None:
    """Rows for `trocar stream`, at 100 Hz, from where the joints are (6,)."""
    time = np.arange(ROWS) * STEP_S
    angle = 2.0 * np.pi * time / TURN_S
    rows = first + SWING * np.sin(angle)[:, None] * np.minimum(1.0, time)[:, None]
    path.write_text("".join(",".join(f"{value:.8f}" for value in row) + "\n" for row in rows))


def main() -> None:
    """Play one puppet until killed."""
    kind, system, name, seed = sys.argv[1:5]
    signal.signal(signal.SIGUSR1, _be_wrong)
    with Remote(system, name) as arm:
        try:
            print("begins", flush=True)
            PLAYS[kind](arm, SeenRecord(system, name, "suj" if kind == "lift" else "arm"), random.Random(seed))
        except Problem as problem:
            sys.exit(f"{kind}: {problem}")


def _be_wrong(number: int, frame: FrameType | None) -> None:
    asked_for.append(number)


def _move(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    while True:
        goal = PLACE + REACH * [chance.uniform(-1.0, 1.0) for _ in REACH]
        reply = arm.settled("move_jp", goal)
        if reply.outcome != "done":
            raise Problem(f"the move was {reply.outcome}: {reply.text}")


def _beat(arm: Remote, command: str, values: Callable[[float], Array], chance: random.Random | None = None) -> None:
    begin_ns = last_ns = monotonic_ns()
    wrong, left = "", 0
    while True:
        now_ns = monotonic_ns()
        if now_ns - last_ns > HELD_UP_NS:
            raise Problem(f"stalled for {(now_ns - last_ns) * 1e-9:.2f} s")
        last_ns = now_ns
        goal = values((now_ns - begin_ns) * 1e-9)
        if asked_for and chance is not None:
            asked_for.clear()
            wrong, left = chance.choice(list(WRONG)), chance.randint(1, MAX_WRONG)
            print(f"{left} × {wrong}", flush=True)
        arm.send(command, WRONG[wrong](goal) if left else goal)
        left = max(0, left - 1)
        for reply in arm.replies():
            if reply.outcome in ("refused", "failed"):
                raise Problem(f"{command} was {reply.outcome}: {reply.text}")
        pause(STEP_S)


def _pose(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    first = np.array(seen.value("setpoint_cp"))

    def pose(time_s: float) -> Array:
        goal = first.copy()
        angle, size = 2.0 * np.pi * time_s / TURN_S, POSE_M * min(1.0, time_s)
        goal[:3] += size * np.array((np.sin(angle), np.cos(angle) - 1.0, 0.5 * np.sin(angle)))
        return goal

    _beat(arm, "servo_cp", pose, chance)


def _servo(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    first, rate = np.array(seen.value("setpoint_position")[:6]), 2.0 * np.pi / TURN_S
    _beat(arm, "servo_jp", lambda time_s: first + min(1.0, time_s) * SWING * np.sin(rate * time_s), chance)


def _velocity(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    rate = 2.0 * np.pi / TURN_S
    _beat(arm, "servo_jv", lambda time_s: SWING * rate * np.sin(rate * time_s), chance)


def _lift(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    _beat(arm, "set_lift_velocity", lambda time_s: np.array((1.0 if time_s % 4.0 < 2.0 else -1.0,)))


def _effort(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    phases = np.array([chance.uniform(0.0, 2.0 * np.pi) for _ in EFFORT])
    _beat(arm, "servo_jf", lambda time_s: EFFORT * np.sin(2.0 * np.pi * time_s / TURN_S + phases))


def _wrench(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    phase = chance.uniform(0.0, 2.0 * np.pi)

    def wrench(time_s: float) -> Array:
        angle = 2.0 * np.pi * time_s / TURN_S + phase
        return np.array((FORCE_N * np.sin(angle), FORCE_N * np.cos(angle), 0.0, 0.0, 0.0, 0.0))

    _beat(arm, "body/servo_cf", wrench)


PLAYS: dict[str, Callable[[Remote, SeenRecord, random.Random], None]] = {
    "move": _move, "pose": _pose, "servo": _servo, "velocity": _velocity, "effort": _effort, "wrench": _wrench,
    "lift": _lift}


if __name__ == "__main__":
    main()
