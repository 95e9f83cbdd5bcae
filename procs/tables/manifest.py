"""THE TABLE of processes: one row per kind, the only source of a kind's properties."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from trocar.procs.document.process import ELSEWHERE, Process
from trocar.procs.tables import sizes
from trocar.procs.tables.sizes import Sizes

if TYPE_CHECKING:
    from trocar.procs.document.system import SystemConfig

LATE_S: Final = 0.03
"""Silence after which a process of a control loop counts as gone."""
FILTERS: Final = "filters"
"""The kind that calls several users' processes in one."""
ROBOTS: Final = ("io", "arm", "above arms")
"""Priorities of processes that move robots; an io without boards needs no core of its own."""
SIMULATED_LOST: Final = 10  # factor on `supervisor_lost_s` in simulated time: nothing is at risk, CPUs may be busy
SIMULATED_HUNG_S: Final = 5.0  # default in simulated time: on a busy machine 0.7 s without CPU time were seen


@dataclass(frozen=True, slots=True)
class ProcessInstance:
    """One instance in a system; period 0 means that of its kind. It starts after the existing instances in `after`.

    With `listen` addresses it starts when a client connects, unless the system file has another `start`.
    """

    name: str
    period_s: float = 0.0
    after: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    start: str = ""
    """Empty: as usual for its kind; else ELSEWHERE."""


def _none(system: SystemConfig) -> Iterable[ProcessInstance]:
    return ()


def _third_parties(system: SystemConfig) -> Iterable[ProcessInstance]:
    """Third-party programs: those that the system file declares are its processes; others are started elsewhere."""
    declared = {row.name: row.period_s for row in system.users}
    return [ProcessInstance(row.name, declared.get(row.name, 0.0), start="" if row.name in declared else ELSEWHERE)
            for row in system.third_parties]


def _users(system: SystemConfig, rows: Mapping[str, tuple[float, str]]) -> Iterable[ProcessInstance]:
    """Users' processes with period and start; they start after all processes that drive the robot."""
    robot = tuple(row.name for rows in (system.ios, system.arms, system.carts, system.consoles) for row in rows)
    return [ProcessInstance(name, period_s, robot, start=start) for name, (period_s, start) in rows.items()]


@dataclass(frozen=True, slots=True)
class Proc:
    """One kind of process: default period, allowed silence, and consequences of its end.

    Its module is procs/KIND/loop.py; filters use that of users' processes. A kind that is not `ours` is a third-party
    program, for which only shared memory is made here.

    `topics`: rings of its instances besides `events`; `events`: names of events besides status, warning and error.
    `instances`: those of a system, in order; `sizes`: named sizes of their records.
    `woken`: a command wakes it between cycles. `rest_s`: longest sleep while it has nothing to do, see `rest_periods`.
    `phase`: position of its cycle in the period in lock-step.
    Silence is reported after `late_s` (see `silence_s`); after `hung_s` the process is killed, and restarted by the
    restart policy. If `pause_ends`, a process that was stalled for `late_s` restarts as if it had been killed.
    `stop_s`: time limit to end on request; `on_exit`: consequences of the end, in the words of `trocar stop`.
    `on_kill`: further consequences if it is killed.
    `priority`: that of a section of `trocar:`, slightly above that of arms, or below all that move robots; without
    priority the kind is not `realtime`. `reserved`: share of its period guaranteed with priority (SCHED_DEADLINE).
    `start` "on-demand": it runs only while it has clients, unless the system file has another `start`.
    `is_first`: it starts first and ends last.
    `declared`: the system file declares topics and commands of each instance.
    `in_time`: simulated time waits for it; others run in real time, or read the system's time.
    `budget_us`: CPU time of its cycle at the default period (median), for `trocar bench`.
    """

    kind: str
    period_s: float
    late_s: float
    stop_s: float
    on_exit: str
    topics: tuple[str, ...] = ("state",)
    events: tuple[str, ...] = ()
    instances: Callable[[SystemConfig], Iterable[ProcessInstance]] = _none
    sizes: Callable[[SystemConfig, str], Sizes] = sizes.fixed
    priority: Literal["", "emulation", "io", "above arms", "arm", "least"] = ""
    woken: bool = False
    phase: float = 0.0
    ours: bool = True
    restart: bool = True
    pause_ends: bool = True
    reserved: float = 0.0
    budget_us: float = 0.0
    hung_s: float = 1.0
    rest_s: float = 0.0
    start: Literal["always", "on-demand"] = "always"
    is_first: bool = False
    declared: bool = False
    in_time: bool = True
    on_kill: str = ""

    @property
    def module(self) -> str:
        """The module that runs its instances; for third parties and filters, that of users' processes."""
        return f"trocar.procs.{self.kind if self.ours and self.kind != FILTERS else 'user'}.loop"

    @property
    def realtime(self) -> bool:
        """Whether its processes also lock their memory and disable garbage collection."""
        return bool(self.priority)

    @property
    def is_forked(self) -> bool:
        """Whether it is forked off the template; others get a new interpreter."""
        return self.realtime or self.is_first


PROCS: tuple[Proc, ...] = (
    Proc("supervisor", 0.02, 1.0, 20.0, "io powers off, and every process ends",
         sizes=sizes.of_supervisor, restart=False, budget_us=2000),
    Proc("third_party", 0.005, LATE_S, 3.0, "teleoperations that use it stop; its own program restarts it",
         ours=False, instances=_third_parties, sizes=sizes.of_third_party, declared=True),
    Proc("boards", 0.001, 0.1, 3.0, "the emulated robots lose power and restart from their initial state",
         instances=lambda system: [ProcessInstance("boards", system.emulation.period_s)] if system.emulation else [],
         sizes=sizes.of_boards, priority="emulation", pause_ends=False, reserved=0.7, budget_us=500),
    Proc("io", 1 / 1500, LATE_S, 5.0, "its robots lose power; they have none after a restart",
         ("state", "gains", "instruments"), ("button", "tool_type", "operating_state"),
         lambda system: [ProcessInstance(io.name, io.period_s, ("boards",) if io.port else ()) for io in system.ios],
         sizes.of_io, "io", reserved=0.6, budget_us=300,
         on_kill="boards whose watchdog is on have switched its amplifiers off"),
    Proc("arm", 1 / 1500, LATE_S, 3.0, "io holds its position; a restart recovers its state",
         ("state", "setpoint", "walls"), ("operating_state", "goal_reached"),
         lambda system: [ProcessInstance(arm.name, arm.period_s, (arm.io,)) for arm in system.arms],
         sizes.of_arm, "arm", woken=True, phase=0.5, budget_us=150, rest_s=0.01),
    Proc("suj", 1 / 500, LATE_S, 3.0, "brakes engage and base frames become unknown; a restart recovers its state",
         ("state", "setpoint"), ("operating_state",),
         lambda system: [ProcessInstance(cart.name, cart.period_s, (cart.io,)) for cart in system.carts],
         sizes.of_cart, "arm", woken=True, phase=0.75, budget_us=150, rest_s=0.016),
    Proc("focus", 0.01, LATE_S, 3.0, "the lens may move on; a restart stops it",
         events=("locked", "focusing_in", "focusing_out"),
         instances=lambda system: [ProcessInstance(row.name, row.period_s,
                                                   (row.io, *(pedal.io for pedal in row.pedals)))
                                   for row in system.focuses],
         priority="least", budget_us=300),
    Proc("teleop", 0.001, LATE_S, 3.0, "the slave holds its position; a restart waits until it is enabled again",
         instances=lambda system: [ProcessInstance(row.name, row.period_s, row.arms)
                                   for rows in (system.teleop_ecms, system.teleop_psms) for row in rows],
         priority="arm", woken=True, phase=0.75, budget_us=200, rest_s=0.1),
    # Above the arms: it takes little time, and an operator who is not detected for 30 ms counts as absent.
    Proc("console", 0.01, LATE_S, 3.0, "the operator counts as absent; a restart recovers its state",
         instances=lambda system: [
             ProcessInstance(row.name, row.period_s, (*row.teleops, *(wired.io for wired in row.operator_present)))
             for row in system.consoles],
         sizes=sizes.of_console, priority="above arms", woken=True, phase=0.05, budget_us=300,
         rest_s=0.02),
    Proc("system", 0.01, LATE_S, 3.0, "motion is not affected",
         instances=lambda system: [ProcessInstance("system")],
         sizes=sizes.of_system, priority="least", woken=True, phase=0.06, budget_us=500, rest_s=0.03),
    Proc("socket_bridge", 0.01, 0.3, 3.0, "its clients are disconnected",
         instances=lambda system: [ProcessInstance("socket_bridge", listen=system.socket.listen)]
         if system.socket else [],
         budget_us=500, hung_s=5.0, in_time=False),
    Proc("gui", 0.05, 1.0, 3.0, "browsers get no data; they reconnect after a restart",
         instances=lambda system: [ProcessInstance("gui", listen=system.gui.listen)] if system.gui else [],
         pause_ends=False, budget_us=5000, hung_s=5.0, in_time=False),
    Proc("user", 0.01, 1.0, 3.0, "nothing else changes", topics=(),
         instances=lambda system: _users(system, {row.name: (row.period_s, ELSEWHERE if row.host else "")
                                                  for row in system.users if row.name not in
                                                  {place.name for place in system.third_parties}}),
         woken=True, pause_ends=False, budget_us=500, hung_s=5.0, declared=True, in_time=False),
    Proc(FILTERS, 0.01, 1.0, 3.0, "its filters are silent", topics=(),
         instances=lambda system: _users(system, {row.host: (row.period_s, "") for row in system.users if row.host}),
         woken=True, pause_ends=False, budget_us=500, hung_s=5.0, declared=True, in_time=False),
    Proc("ros_bridge", 0.01, 1.0, 3.0, "ROS clients receive nothing", topics=(),
         instances=lambda system: _users(system, {"ros_bridge": (system.ros.period_s, "")} if system.ros else {}),
         pause_ends=False, budget_us=2500, hung_s=5.0, declared=True, in_time=False),
    # It starts first and ends last, so that start and end of the others are recorded. The start does not wait for it.
    Proc("recorder", 0.02, 1.0, 4.0, "nothing is recorded",
         instances=lambda system: [ProcessInstance("recorder")] if system.recorder else [],
         pause_ends=False, budget_us=2000, hung_s=5.0, is_first=True, declared=True, in_time=False),
    Proc("foxglove", 1 / 30, 1.0, 3.0, "its clients receive nothing", topics=(),
         instances=lambda system: _users(system, {"foxglove": (1.0 / system.foxglove.rate_hz, "")})
         if system.foxglove else [],
         pause_ends=False, budget_us=5000, hung_s=5.0, declared=True, in_time=False),
)

IN_TIME: Final = frozenset(row.kind for row in PROCS if row.ours and row.in_time)
"""Kinds that simulated time waits for."""
THIRD_PARTY: Final = frozenset(row.kind for row in PROCS if not row.ours)
"""Kinds of third-party programs."""


def proc(kind: str) -> Proc:
    """The row of a kind; KeyError lists the existing kinds."""
    for row in PROCS:
        if row.kind == kind:
            return row
    raise KeyError(f"no process of kind {kind}; there are {', '.join(r.kind for r in PROCS)}")


def late_s(row: Process) -> float:
    """Delay of a cycle that counts as a stall, s: as configured, else that of its kind; at least two periods."""
    return max(proc(row.kind).late_s if row.late_s is None else row.late_s, 2.0 * row.period_s)


def silence_s(row: Process) -> float:
    """Silence that is reported, s: at least twice its longest sleep."""
    return max(late_s(row), 2.0 * proc(row.kind).rest_s)


def rest_periods(row: Process, timeout_s: float = math.inf) -> int:
    """Periods of a cycle in which it has nothing to do: at most a third of the `timeout_s` of its readers."""
    return max(1, int(min(proc(row.kind).rest_s, timeout_s / 3) / row.period_s + 1e-6))


def lost_s(system: SystemConfig, *, simulated: bool) -> float:
    """Silence of the supervisor after which its processes end, s; longer in simulated time."""
    return system.supervisor_lost_s * (SIMULATED_LOST if simulated else 1)


def hung_s(row: Process, *, simulated: bool) -> float:
    """Silence in real time after which an instance is killed, s; at least `silence_s`.

    In simulated time nothing is at risk, and the default is longer, for processes that are short of CPU time.
    """
    kind = proc(row.kind)
    usual = max(kind.hung_s, SIMULATED_HUNG_S) if simulated else kind.hung_s
    return max(usual if row.hung_s is None else row.hung_s, silence_s(row))
