"""`trocar bench teleop`: latency from an edge of a master's encoder to the slave's setpoint.

The system of `trocar demo` on emulated boards, but at the usual periods, following; the master has no weight and no
hand on it. At random moments, about twenty a second, its first actuator is displaced by NUDGE_RAD, or back: its encoder
runs there within one physics step (1 ms), which the boards' record shows with its time. The end is the first setpoint
of the slave at PART of the resulting way; the start is the edge at PART of the encoder's way.

- `master_to_slave_ms`: to the slave's setpoint as io has taken it (`PSM1/setpoint_js` shows it): the time is when the
  boards' reply was in (`recv_ns`), after which io takes setpoints.
- `master_to_write_ms`: until the write to the slave's boards had been sent that carries the answer to it (`write_ns`).
- `master_to_setpoint_ms`: to the setpoint record that the slave's arm process published, by the begin of the cycle
  that made it.
- `sample_to_write_ms`: the same way of every goal, nudged or not, by stamps only and without the wait for a sample.
"""

from __future__ import annotations

import contextlib
import os
import random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.tables.bring_up import DISABLED
from trocar.shm.system import directory
from trocar.shm.system.events import ERROR
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.bench.measuring import home_all, percentiles
from trocar.tools.bench.system import SystemReport
from trocar.tools.client.bring_up import bring_all
from trocar.tools.examples.hand import Hand
from trocar.tools.examples.operator_sim import OperatorSim, SimTeleop
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.tracing import Column, Trace
from trocar.tools.inspect.watch import arm_document
from trocar.tools.output.errors import Problem
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

SYSTEM = PROJECT_CONFIGS / "systems" / "demo-teleop.yaml"
SETS = ("io.period_s=0.000666667", "arm.period_s=0.000666667")  # the usual ones; the demo's are longer
SECONDS = 20.0
NUDGE_RAD = 0.002
EVERY_S = (0.04, 0.06)
PART = 0.1
STEP_NS = 1_000_000
COLLECT_NS = 500_000_000
SETTLED_S = 1.0
MAX_NS = 30_000_000  # until the next nudge
QUIET_NS = 5_000_000
SEED = 1

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


def run(seconds: float = SECONDS, sets: tuple[str, ...] = ()) -> dict[str, Any]:
    """Measure, at the usual periods unless `sets` changes them."""
    name, sets = f"bench-teleop-{os.getpid()}", (*SETS, *sets)
    with up_meanwhile(StartRequest(SYSTEM, name, "emulated", sets=(*sets, "clock=wall"))):
        home_all(name)
        with OperatorSim(name, "console") as seat:
            reported = [SystemReport(name, process.name) for process in statuses(name)
                        if process.kind not in ("supervisor", "system")]
            try:
                found, problems = _measure(name, seat, seconds), []
            except Problem as problem:
                found, problems = {}, [str(problem)]
            problems += [f"it did not follow to the end: {missing}" for missing in _missing(seat)]
            for each in reported:
                problems += each.count(ERROR)[1]
                each.close()
        with contextlib.suppress(Problem):
            bring_all(name, (), DISABLED)
    return {"figures": found, "problems": problems, "conditions": {
        "system": SYSTEM.name, "sets": list(sets), "seconds": seconds, "nudge_rad": NUDGE_RAD, "part": PART,
        "bus": "emulated boards on loopback UDP"}}


def _missing(seat: OperatorSim) -> list[str]:
    return [teleop.reported for teleop in seat.teleops if not teleop.is_following]


def _measure(system: str, seat: OperatorSim, seconds: float) -> dict[str, Any]:
    teleop = seat.teleops[0]
    master, slave = teleop.masters[0], teleop.slave
    io = arm_document(system, slave).io
    at, to = _axes(system, "boards", master), _axes(system, io, slave)
    with contextlib.ExitStack() as stack:
        def kept(instance: str, ring: str, *fields: str) -> Column:
            column = Column(directory.reader(system, instance, ring), fields)
            stack.callback(column.close)
            return column

        hand = stack.enter_context(Hand(system, seat, teleop))
        hand.begin()
        pause(SETTLED_S)
        boards = kept("boards", "state", "board_ns", "position")
        applied = kept(io, "state", "recv_ns", "write_ns", "setpoint_position")
        published = kept(slave, "setpoint", "stamp_ns", "position")
        trace = Trace(system, teleop.name, slave, io)
        stack.callback(trace.close)
        _nudge(hand, teleop, seconds, _place(system, at), (boards, applied, published, trace))
        times, positions = boards.all()
        nudges = edges(times, positions[:, at.start])
        received, written, setpoints = applied.all()
        stamps, own = published.all()
        taken, late = (fault_handler(nudges, times, setpoints[:, to]) * 1e-6 for times in (received, written))
        early = fault_handler(nudges, stamps, own[:, : to.stop - to.start]) * 1e-6
        figures = trace.figures()
    if not (len(taken) and len(late) and len(early)):
        raise Problem(f"no nudge of the master was seen at the slave: {teleop.reported}")
    return {
        **percentiles("master_to_slave_ms", taken, 50, 99), **percentiles("master_to_write_ms", late, 50, 99),
        **percentiles("master_to_setpoint_ms", early, 50, 99),
        "sample_to_write_ms_p50": figures["latency_ms_p50"], "sample_to_write_ms_p99": figures["latency_ms_p99"],
        "nudges": len(nudges), "reactions": len(late),
    }


def _nudge(hand: Hand, teleop: SimTeleop, seconds: float, place: Array, columns: tuple[Any, ...]) -> None:
    """To and fro about `place`, the actuators of the master, at random moments, as long as the slave follows."""
    chance, further = random.Random(SEED), False
    end = collected = monotonic_ns()
    end += round(seconds * 1e9)
    while monotonic_ns() < end and teleop.is_following:
        further = not further
        actuators = place.copy()
        actuators[0] += NUDGE_RAD * further
        hand.nudge(actuators)
        if monotonic_ns() - collected > COLLECT_NS:
            collected = monotonic_ns()
            for column in columns:
                column.collect()
        pause(chance.uniform(*EVERY_S))
    for column in columns:
        column.collect()


def edges(times: Stamps, positions: Array) -> Stamps:
    """ns at which PART of each nudge's edges had occurred; (n,) positions of the nudged actuator at steps' begins."""
    moved = np.flatnonzero(np.abs(np.diff(positions)) > 0.6 * NUDGE_RAD) + 1
    found: Stamps = times[moved] + round(PART * STEP_NS)
    return found


def fault_handler(nudges: Stamps, stamps: Stamps, setpoints: Array) -> Stamps:
    """ns from each nudge to the first of the setpoints (m, k) that has gone PART of its way; nudges without one are
    left out.

    The way is the largest change within MAX_NS, per axis; drift before the nudge does not count.
    """
    found = []
    for nudge in nudges.tolist():
        first, last = np.searchsorted(stamps, (nudge - QUIET_NS, nudge + MAX_NS)).tolist()
        begin = int(np.searchsorted(stamps, nudge))
        if first == begin or last >= len(stamps) or last < begin + 2:
            continue
        change = setpoints[begin:last] - setpoints[begin - 1]
        drift = np.abs(setpoints[first:begin] - setpoints[begin - 1]).max(axis=0)
        axis = int(np.argmax(np.abs(change[: len(change) // 2]).max(axis=0)))
        way = np.abs(change[: len(change) // 2, axis]).max()
        if drift[axis] > 0.5 * PART * way:
            continue  # it was moving already
        place = int(np.argmax(np.abs(change[:, axis]) >= PART * way))
        found.append(int(stamps[begin + place]) - nudge)
    return np.array(found, dtype=np.int64)


def _axes(system: str, instance: str, robot: str) -> slice:
    """Positions of a robot's actuators in a state record."""
    with contextlib.closing(directory.reader(system, instance, "state")) as reader:
        row = reader.info["robots"][robot]
    return slice(row["first"], row["first"] + row["count"])


def _place(system: str, at: slice) -> Array:
    """Where actuators are, as the boards know it."""
    with contextlib.closing(directory.reader(system, "boards", "state")) as reader:
        if not reader.newest():
            raise Problem(f"the boards' state cannot be read: {reader.problem or 'they have shown none'}")
        return np.array(reader.field("position")[at])
