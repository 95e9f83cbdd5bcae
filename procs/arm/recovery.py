"""Recovery: this process may have died and been restarted while io held the arm.

A held arm must neither drop nor jump because its process is new: its previous state is in its own last record, its
present condition in io's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.readings import ArmReadings
from trocar.procs.arm.states import ArmState
from trocar.procs.arm.supervision import problem
from trocar.procs.kinematics.poses import Array, matrix_from_pose, normalised
from trocar.procs.node.fault_report import NO_FAULT, FaultReport
from trocar.procs.node.inputs import Fields


@dataclass(frozen=True)
class PreviousState:
    """The last record of this arm; `base` is None if its base frame was not known."""

    stamp_ns: int
    sub_state: str
    reason: str
    bias_generation: int
    tool: str
    base: Array | None
    reference_frame: str
    ratio_v: float
    ratio_a: float
    bore_weight: bool


def previous_state(field: Fields) -> PreviousState | None:
    """Read the record before it is overwritten; None if no arm has written it yet."""
    sub_state = _text(field("sub_state"))
    if not sub_state:
        return None
    is_base_known = bool(field("reference_valid").item()) or not bool(field("cartesian_valid").item())
    try:
        base = matrix_from_pose(normalised(field("base_frame"))) if is_base_known else None
    except ValueError:
        base = np.eye(4)
    return PreviousState(
        int(field("stamp_ns").item()),
        sub_state,
        _text(field("reason")),
        int(field("bias_generation").item()),
        _text(field("tool")),
        base,
        _text(field("reference_frame")),
        _ratio(float(field("trajectory_ratio_v").item())),
        _ratio(float(field("trajectory_ratio_a").item())),
        bool(field("gravity_effort").any()),
    )


def _text(cell: NDArray[np.bytes_]) -> str:
    return bytes(cell.item()).rstrip(b"\0").decode(errors="replace")


def _ratio(value: float) -> float:
    return value if 0.0 < value <= 1.0 else 1.0


@dataclass(frozen=True, slots=True)
class Beginning:
    """The initial state; `paused` is the state to resume from PAUSED, `found` the cause of FAULT."""

    state: ArmState
    paused: ArmState = ArmState.ENABLED
    found: FaultReport = NO_FAULT


def beginning(before: PreviousState | None, io: ArmReadings, around: ArmContext, restart: str) -> Beginning:
    """The initial state, from the last record of the previous process and the first fresh one of io.

    A FAULT of the previous process keeps its cause, and is not reported again; a new one also names the `restart`.
    """
    if io.has_power and not io.problem:
        if before is None or not _is_still_homed(before, io):
            return Beginning(ArmState.ENABLED)  # powered, without a known state: the joint controller continues
        if before.sub_state == ArmState.PAUSED:
            return Beginning(ArmState.PAUSED, ArmState.HOMED)
        return Beginning(ArmState.HOMED)
    if before is None or before.sub_state == ArmState.DISABLED:
        return Beginning(ArmState.DISABLED)
    if before.sub_state == ArmState.POWERING and not io.problem:
        return Beginning(ArmState.POWERING if io.power_requested.item() else ArmState.DISABLED)
    if before.sub_state == ArmState.FAULT:
        return Beginning(ArmState.FAULT, found=FaultReport(text=before.reason))
    stall = around.io_stall(before.stamp_ns)
    found = problem(ArmState.HOMED, io, -1 if stall else io.epoch, None, around.fault_report, around.power_report,
                    lambda since_ns: stall)
    return Beginning(ArmState.FAULT, found=replace(found, text=f"{found.text}; {restart}"))


def _is_still_homed(before: PreviousState, io: ArmReadings) -> bool:
    generation = int(io.bias_generation.item())
    same = generation > 0 and before.bias_generation == generation  # 0 unless it was homed
    return bool(same and io.biased.item() and io.pid_enabled.item())
