"""Programs of a user, as processes of their own that may be killed and held up: what they ask for is in `asked`.

    python -m tests.soak.puppets KIND SYSTEM ARM SEED

`move` sends moves one after the other, `pose` streams poses of the tip, `effort` joint efforts, `wrench` a force at the
tip. A program prints a line when it begins; one that is refused, or was held up itself, ends. `joints`, a stream of
joint positions, is `trocar stream`.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procs.arm_types import ARM_TYPES
from shm.clock import monotonic_ns, pause
from tools.errors import Problem
from tools.examples.operator_sim import SeenRecord
from tools.remote import Remote

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
KINDS = ("move", "joints", "pose", "effort", "wrench")
ROWS = 3000


def asked(kind: str) -> tuple[Sequence[float], Sequence[float]]:
    """How fast a puppet that does not push asks the joints of a PSM, or its tip, to go."""
    top = RATIO * np.array(ARM_TYPES["PSM"].moves.velocity)
    if kind == "move":
        return top.tolist(), ()
    if kind == "joints":  # the way to the first row is a move
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
    with Remote(system, name) as arm:
        try:
            print("begins", flush=True)
            PLAYS[kind](arm, SeenRecord(system, name, "arm"), random.Random(seed))
        except Problem as problem:
            sys.exit(f"{kind}: {problem}")


def _move(arm: Remote, seen: SeenRecord, chance: random.Random) -> None:
    while True:
        goal = PLACE + REACH * [chance.uniform(-1.0, 1.0) for _ in REACH]
        reply = arm.settled("move_jp", goal)
        if reply.outcome != "done":
            raise Problem(f"the move was {reply.outcome}: {reply.text}")


def _beat(arm: Remote, command: str, values: Callable[[float], Array]) -> None:
    begin_ns = last_ns = monotonic_ns()
    while True:
        now_ns = monotonic_ns()
        if now_ns - last_ns > HELD_UP_NS:
            raise Problem(f"held up for {(now_ns - last_ns) * 1e-9:.2f} s")
        last_ns = now_ns
        arm.post(command, values((now_ns - begin_ns) * 1e-9))
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

    _beat(arm, "servo_cp", pose)


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
    "move": _move, "pose": _pose, "effort": _effort, "wrench": _wrench}


if __name__ == "__main__":
    main()
