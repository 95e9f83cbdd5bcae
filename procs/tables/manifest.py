"""THE TABLE of who runs: one row per kind of process. Whatever asks what a kind is reads it here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from trocar.procs.document.process import ELSEWHERE, Process
from trocar.procs.tables import sizes
from trocar.procs.tables.sizes import Sizes

if TYPE_CHECKING:
    from trocar.procs.document.system import SystemConfig

LATE_S: Final = 0.03
"""A process of a control loop that is silent for so long counts as gone."""
FILTERS: Final = "filters"
"""The kind that calls several users' processes in one."""
SIMULATED_LOST: Final = 10  # times `supervisor_lost_s` in simulated time: nothing is in danger, the machine may be busy
SIMULATED_HUNG_S: Final = 5.0  # as usual in simulated time: on a busy machine 0.7 s without a core were seen


@dataclass(frozen=True, slots=True)
class ProcessInstance:
    """One that a system has; without a period it has that of its kind. It starts after those of `after` there are.

    With addresses to `listen` at it starts when somebody connects, unless the system file says otherwise.
    """

    name: str
    period_s: float = 0.0
    after: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    start: str = ""
    """If not as usual for its kind: ELSEWHERE."""


def _nobody(system: SystemConfig) -> Iterable[ProcessInstance]:
    return ()


def _third_parties(system: SystemConfig) -> Iterable[ProcessInstance]:
    """Those that the system file declares are processes of the system, all others are started by their owners."""
    declared = {row.name: row.period_s for row in system.users}
    return [ProcessInstance(row.name, declared.get(row.name, 0.0), start="" if row.name in declared else ELSEWHERE)
            for row in system.third_parties]


def _users(system: SystemConfig, rows: Mapping[str, tuple[float, str]]) -> Iterable[ProcessInstance]:
    """Users' processes with period and start; they come after all that drives the robot."""
    robot = tuple(row.name for rows in (system.ios, system.arms, system.carts, system.consoles) for row in rows)
    return [ProcessInstance(name, period_s, robot, start=start) for name, (period_s, start) in rows.items()]


@dataclass(frozen=True, slots=True)
class Proc:
    """One kind: default period, how long it may be silent, and what happens after it died.

    Its module is procs/KIND/loop.py; filters are users' processes. One that is not `ours` is a third-party program, of
    which only the places in shared memory are made here.

    `topics` are the rings its instances write besides `events`, where they say `events` besides status, warning and
    error; `instances` are those that a system has, in this order, `sizes` the named sizes of their records; `woken`: a
    command wakes it between its cycles. `phase` is where in the period its cycle lies in
    lock-step; it may sleep through `rest` periods. Silent for `late_s` it is reported, for `hung_s` killed, and started
    again by the policy for deaths; held up for `late_s` it restarts as if it had been killed, where `pause_ends` it.
    `stop_s`: how long it may take to end when asked; `on_exit`: what happens then, as `trocar stop` says it; `reserved`
    is the share of its period that nobody else may take (SCHED_DEADLINE), where it may ask for priority: that of a
    section of `trocar:`, a little above that of arms, or less than all that move robots; without any it is no
    `realtime` kind.
    `start` "on-demand": only while somebody wants something of it, unless the system file says otherwise.
    `is_first`: it begins with the first and ends with the last.
    `declared`: the system file says of each instance what it writes and what it can be asked.
    `in_time`: simulated time waits for it; who is not goes by real time, or asks what time the system has.
    `budget_us` is the share of one core's time its cycle may use at its default period (median), for `trocar bench`.
    """

    kind: str
    period_s: float
    late_s: float
    stop_s: float
    on_exit: str
    topics: tuple[str, ...] = ("state",)
    events: tuple[str, ...] = ()
    instances: Callable[[SystemConfig], Iterable[ProcessInstance]] = _nobody
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
    rest: int = 1
    start: Literal["always", "on-demand"] = "always"
    is_first: bool = False
    declared: bool = False
    in_time: bool = True

    @property
    def module(self) -> str:
        """The module that runs an instance which the supervisor starts: of third parties that of users' processes."""
        return f"trocar.procs.{self.kind if self.ours and self.kind != FILTERS else 'user'}.loop"

    @property
    def realtime(self) -> bool:
        """It also locks its memory and collects no garbage; others live as programs usually do."""
        return bool(self.priority)

    @property
    def is_forked(self) -> bool:
        """It is forked off the template, which has imported its module; others get an interpreter of their own."""
        return self.realtime or self.is_first


PROCS: tuple[Proc, ...] = (
    Proc("supervisor", 0.02, 1.0, 20.0, "io powers off, and every process ends",
         sizes=sizes.of_supervisor, restart=False, budget_us=2000),
    Proc("third_party", 0.005, LATE_S, 3.0, "what follows it stops; its own program starts it again",
         ours=False, instances=_third_parties, sizes=sizes.of_third_party, declared=True),
    Proc("boards", 0.001, 0.1, 3.0, "the emulated robots have no power; they start afresh",
         instances=lambda system: [ProcessInstance("boards", system.emulation.period_s)] if system.emulation else [],
         sizes=sizes.of_boards, priority="emulation", pause_ends=False, reserved=0.7, budget_us=500),
    Proc("io", 1 / 1500, LATE_S, 5.0, "its robots lose power; they have none after a restart",
         ("state", "gains", "instruments"), ("button", "tool_type", "operating_state"),
         lambda system: [ProcessInstance(io.name, io.period_s, ("boards",) if io.port else ()) for io in system.ios],
         sizes.of_io, "io", reserved=0.6, budget_us=300),
    Proc("arm", 1 / 1500, LATE_S, 3.0, "io holds it where it is; a restart takes on its state",
         ("state", "setpoint"), ("operating_state", "goal_reached"),
         lambda system: [ProcessInstance(arm.name, arm.period_s, (arm.io,)) for arm in system.arms],
         sizes.of_arm, "arm", phase=0.5, budget_us=150, rest=3),
    Proc("suj", 1 / 500, LATE_S, 3.0, "brakes engage and base frames become unknown; a restart takes on its state",
         ("state", "setpoint"), ("operating_state",),
         lambda system: [ProcessInstance(cart.name, cart.period_s, (cart.io,)) for cart in system.carts],
         sizes.of_cart, "arm", phase=0.75, budget_us=150),
    Proc("focus", 0.01, LATE_S, 3.0, "the lens may move on; a restart stops it",
         events=("locked", "focusing_in", "focusing_out"),
         instances=lambda system: [ProcessInstance(row.name, row.period_s,
                                                   (row.io, *(pedal.io for pedal in row.pedals)))
                                   for row in system.focuses],
         priority="least", budget_us=300),
    Proc("teleop", 0.001, LATE_S, 3.0, "the slave holds where it is; a restart waits until it is enabled again",
         instances=lambda system: [ProcessInstance(row.name, row.period_s, row.arms)
                                   for rows in (system.teleop_ecms, system.teleop_psms) for row in rows],
         priority="arm", woken=True, phase=0.75, budget_us=200, rest=10),
    # Above the arms: it takes little, and an operator who cannot be seen for 30 ms counts as gone.
    Proc("console", 0.01, LATE_S, 3.0, "the operator counts as absent; a restart takes on its state",
         instances=lambda system: [
             ProcessInstance(row.name, row.period_s, (*row.teleops, *(wired.io for wired in row.operator_present)))
             for row in system.consoles],
         sizes=sizes.of_console, priority="above arms", woken=True, phase=0.05, budget_us=300),
    Proc("system", 0.01, LATE_S, 3.0, "nothing moves differently",
         instances=lambda system: [ProcessInstance("system")],
         sizes=sizes.of_system, priority="least", woken=True, phase=0.06, budget_us=500),
    Proc("socket_bridge", 0.01, 0.3, 3.0, "its clients are disconnected",
         instances=lambda system: [ProcessInstance("socket_bridge", listen=system.socket.listen)]
         if system.socket else [],
         budget_us=500, hung_s=5.0, in_time=False),
    Proc("gui", 0.05, 1.0, 3.0, "browsers see nothing; after a restart they connect again",
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
    Proc("ros_bridge", 0.01, 1.0, 3.0, "ROS clients hear nothing", topics=(),
         instances=lambda system: _users(system, {"ros_bridge": (system.ros.period_s, "")} if system.ros else {}),
         pause_ends=False, budget_us=2500, hung_s=5.0, declared=True, in_time=False),
    # It begins first and ends last: what begins and what ends is recorded, too. The start does not wait for it.
    Proc("recorder", 0.02, 1.0, 4.0, "nothing is recorded",
         instances=lambda system: [ProcessInstance("recorder")] if system.recorder else [],
         pause_ends=False, budget_us=2000, hung_s=5.0, is_first=True, declared=True, in_time=False),
    Proc("foxglove", 1 / 30, 1.0, 3.0, "its clients see nothing", topics=(),
         instances=lambda system: _users(system, {"foxglove": (1.0 / system.foxglove.rate_hz, "")})
         if system.foxglove else [],
         pause_ends=False, budget_us=5000, hung_s=5.0, declared=True, in_time=False),
)

IN_TIME: Final = frozenset(row.kind for row in PROCS if row.ours and row.in_time)
"""Kinds that simulated time waits for."""
THIRD_PARTY: Final = frozenset(row.kind for row in PROCS if not row.ours)
"""Kinds of programs that somebody else starts."""


def proc(kind: str) -> Proc:
    """The row of a kind; KeyError names what there is."""
    for row in PROCS:
        if row.kind == kind:
            return row
    raise KeyError(f"no process of kind {kind}; there are {', '.join(r.kind for r in PROCS)}")


def late_s(row: Process) -> float:
    """Silence that is reported, s: as configured, or as usual for its kind; more than an instance may sleep."""
    kind = proc(row.kind)
    return max(kind.late_s if row.late_s is None else row.late_s, 2.0 * kind.rest * row.period_s)


def hung_s(row: Process, *, simulated: bool) -> float:
    """Real silence after which an instance is killed, s; never less than what is reported.

    In simulated time nothing is in danger, and who is short of a core is given longer, unless it is configured.
    """
    kind = proc(row.kind)
    usual = max(kind.hung_s, SIMULATED_HUNG_S) if simulated else kind.hung_s
    return max(usual if row.hung_s is None else row.hung_s, late_s(row))
