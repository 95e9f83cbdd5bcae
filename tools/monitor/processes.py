"""The page of processes: state, rate and jitter, what each uses, how often it was started again, and how it ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trocar.procs.machine.usage import Usage
from trocar.tools.inspect.processes import ProcessStatus, remarks
from trocar.tools.output.printing import number, span


@dataclass(frozen=True, slots=True)
class ProcessRow:
    """One process; None where there is nothing to be said. Percent of a core, MB of its own."""

    status: ProcessStatus
    cpu_percent: float | None
    memory_mb: float | None

    @property
    def state(self) -> str:
        """In words, with how long it is silent where it is."""
        if self.status.problem in ("dead", "stalled", "silent"):
            return f"{self.status.problem} {span(self.status.silent_s)}"
        return self.status.state

    @property
    def is_gone(self) -> bool:
        """What its figures say is past."""
        return self.status.problem == "dead" or self.status.state in ("STOPPED", "CREATED", "FAILED")

    @property
    def jitter_ms(self) -> float | None:
        """Standard deviation of its period."""
        period = self.status.statistics.get("period")
        return period["std"] * 1e3 if period else None

    def details(self) -> list[str]:
        """What a person asks next: its problem, scheduling, how those before it ended."""
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
    """All processes of a system, with what they use since the last look."""

    def __init__(self) -> None:
        self._usage = Usage()

    def rows(self, processes: Sequence[ProcessStatus]) -> list[ProcessRow]:
        """As the overview found them."""
        found = [ProcessRow(one, *(self._usage.of(one.pid) if one.problem != "dead" else (None, None)))
                 for one in processes]
        self._usage.keep(one.pid for one in processes)
        return found


def cells(row: ProcessRow) -> list[str]:
    """In the order of the page's columns."""
    status = row.status
    p99 = None if status.period_p99_s is None else status.period_p99_s * 1e3
    work = None if status.work_p99_s is None else status.work_p99_s * 1e3
    return [f"{status.name} {status.simulation}".rstrip(), row.state, str(status.pid or "–"), number(status.rate_hz),
            number(row.jitter_ms, ".3f"), number(p99, ".3f"), number(work, ".3f"), number(row.cpu_percent, ".1f"),
            number(row.memory_mb, ".0f"), str(status.missed), str(status.restarts),
            status.problem if status.problem not in ("dead", "stalled", "silent") and status.problem
            else status.exit_reason]
