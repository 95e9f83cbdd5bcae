"""The pages of processes and arms: activity and resource use of each, reason for FAULT or pending condition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trocar.procs.machine.usage import Usage
from trocar.tools.inspect.messages import time_of_day
from trocar.tools.inspect.processes import ProcessStatus, cells, remarks
from trocar.tools.inspect.standing import Standing
from trocar.tools.output.printing import number, span


@dataclass(frozen=True, slots=True)
class ProcessRow:
    """One process; None for unknown values. Percent of a core, MB of its own."""

    status: ProcessStatus
    cpu_percent: float | None
    memory_mb: float | None

    @property
    def state(self) -> str:
        """In words, with the duration of a silence."""
        if self.status.problem in ("dead", "stalled", "silent"):
            return f"{self.status.problem} {span(self.status.silent_s)}"
        return self.status.state

    @property
    def is_gone(self) -> bool:
        """Whether the figures are those of a process that no longer runs."""
        return self.status.problem == "dead" or self.status.state in ("STOPPED", "CREATED", "FAILED")

    @property
    def jitter_ms(self) -> float | None:
        """Standard deviation of its period."""
        period = self.status.statistics.get("period")
        return period["std"] * 1e3 if period else None

    def details(self) -> list[str]:
        """Details: its problem, scheduling, earlier ends."""
        status = self.status
        period, work = status.statistics.get("period"), status.statistics.get("work")
        lines = [f"{status.name} ({status.kind or 'kind not known'}), pid {status.pid or '–'}, {status.cycles} cycles, "
                 f"{status.missed} missed, {status.overruns} overruns"]
        if status.problem:
            lines.append(f"problem: {status.problem}")
        for what, parts in (("period", period), ("work", work)):
            if parts:
                lines.append(f"{what} ms: " + ", ".join(f"{part} {parts[part] * 1e3:.3f}" for part in
                                                         ("avg", "std", "min", "max", "p99")))
        lines += [remarks(status)] if remarks(status) else []
        lines += [f"ended before: pid {past.pid}: {past.text}" for past in reversed(status.endings)]
        return lines


class ProcessesData:
    """All processes of a system, with their resource use since the last look."""

    def __init__(self, system: str = "") -> None:
        self._usage = Usage()

    def close(self) -> None:
        """Nothing is mapped."""

    def rows(self, processes: Sequence[ProcessStatus]) -> list[ProcessRow]:
        """As the overview found them."""
        found = [ProcessRow(one, *(self._usage.of(one.pid) if one.problem != "dead" else (None, None)))
                 for one in processes]
        self._usage.keep(one.pid for one in processes)
        return found


def process_cells(row: ProcessRow) -> list[str]:
    """In the order of the page's columns."""
    name, _, pid, rate, p99, work, missed, restarts, problem = cells(row.status)
    return [name, row.state, pid, rate, number(row.jitter_ms, ".3f"), p99, work, number(row.cpu_percent, ".1f"),
            number(row.memory_mb, ".0f"), missed, restarts,
            problem if problem not in ("dead", "stalled", "silent", "") else row.status.exit_reason]


def standing_cells(one: Standing) -> list[str]:
    """In the order of the page's columns."""
    fault = one.fault or {}
    homed = "–" if one.homed is None else "yes" if one.homed else "no"
    return [one.name, one.state, homed, str(fault.get("code") or ""), one.reason, str(fault.get("hint") or "")]


def standing_details(one: Standing) -> list[str]:
    """The reported error behind a FAULT, and the remedy."""
    lines = [f"{one.name} ({one.kind}): {one.state}"]
    if one.reason:
        lines.append(f"{'why' if one.is_fault or one.at_wall else 'waiting'}: {one.reason.removeprefix('waiting: ')}")
    fault = one.fault
    if fault is not None:
        where = [f"axis {fault['axis']}" if int(fault["axis"]) >= 0 else "",
                 f"board {fault['board']}" if int(fault["board"]) >= 0 else ""]
        measured = "" if fault["value"] is None else f"measured {number(float(fault['value']), '.5g')}"
        allowed = "" if fault["limit"] is None else f"allowed {number(float(fault['limit']), '.5g')}"
        known = ", ".join(part for part in (str(fault["component"]), *where, measured, allowed) if part)
        lines.append(f"{fault['code']} at {time_of_day(int(fault['local_ns']))}: {known}")
        lines.append(f"reported: {fault['text']}")
        if fault["hint"]:
            home = f"trocar home {one.name}"
            lines.append(f"remedy: {fault['hint']}" + ("" if home in fault["hint"] else f"; then: {home}"))
    return lines
