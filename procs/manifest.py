"""THE TABLE of who runs: one row per kind of process, as data. The supervisor starts nothing that is not here."""

from __future__ import annotations

from dataclasses import dataclass

from procs.lib.document import Process


@dataclass(frozen=True, slots=True)
class Proc:
    """One kind: its module, default period, how long it may be silent, and what happens after it died.

    Without a module it is a program of somebody else, who starts it: only its places in shared memory are ours.

    `topics` are the rings its instances write besides `events`; `phase` is where in the period its cycle lies in
    lock-step; it may sleep through `rest` periods. Silent for `late_s` it is reported, for `hung_s` killed, and started
    again by the policy for deaths; held up for `late_s` it begins anew as if it had been killed, where `pause_ends` it.
    `stop_s`: how long it may take to end when asked; `on_exit` is said in words for `trocar status`; `reserved` is the
    share of its period that nobody else may take (SCHED_DEADLINE), where it may ask for priority.
    `budget_us` is the share of one core's time its cycle may use at its default period (median), for `trocar bench`.
    """

    kind: str
    module: str
    period_s: float
    late_s: float
    stop_s: float
    on_exit: str
    topics: tuple[str, ...]
    phase: float = 0.0
    realtime: bool = True
    restart: bool = True
    pause_ends: bool = True
    reserved: float = 0.0
    budget_us: float = 0.0
    hung_s: float = 1.0
    rest: int = 1


PROCS: tuple[Proc, ...] = (
    Proc("supervisor", "procs.supervisor.loop", 0.02, 1.0, 20.0, "io powers off, every process ends", (),
         realtime=False, restart=False, budget_us=2000),
    Proc("boards", "procs.boards.loop", 0.001, 0.1, 3.0, "restart; emulated robots start afresh, without power",
         ("state",), pause_ends=False, reserved=0.7, budget_us=500),
    Proc("io", "procs.io.loop", 1 / 1500, 0.03, 5.0, "boards cut the amplifiers; restart without power",
         ("state", "gains", "instruments"), reserved=0.6, budget_us=300),
    Proc("arm", "procs.arm.loop", 1 / 1500, 0.03, 3.0, "io holds; restart goes on from shared memory",
         ("state", "setpoint"), phase=0.5, budget_us=150, rest=3),
    Proc("suj", "procs.suj.loop", 1 / 500, 0.03, 3.0, "brakes engage, base frames unknown; restart goes on",
         ("state", "setpoint"), phase=0.75, budget_us=150),
    Proc("teleop", "procs.teleop.loop", 0.001, 0.03, 3.0, "the slave holds; restart waits until it is enabled again",
         ("state",), phase=0.75, budget_us=200, rest=10),
    Proc("console", "procs.console.loop", 0.01, 0.03, 3.0, "operator counts as absent; restart goes on",
         ("state",), phase=0.05, budget_us=300),
    Proc("system", "procs.system.loop", 0.01, 0.03, 3.0, "nothing moves differently; restart",
         ("state",), phase=0.06, realtime=False, budget_us=500),
    Proc("focus", "procs.focus.loop", 0.01, 0.03, 3.0, "the lens may move on until the restart, which stops it",
         ("state",), realtime=False, budget_us=300),
    Proc("external", "", 0.005, 0.03, 0.0, "tele-operations that use it stop following; who owns it starts it again",
         ("state",), realtime=False, restart=False),
)


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


def hung_s(row: Process) -> float:
    """Silence after which an instance is killed, s; never less than what is reported."""
    return max(proc(row.kind).hung_s if row.hung_s is None else row.hung_s, late_s(row))
