"""`trocar commission SYSTEM`: the first day on a real robot, stage by stage."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig, from_json
from trocar.procs.machine.end_signals import ended_as_by_ctrl_c
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import WALL
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.person import AtTerminal, Declined, Person
from trocar.tools.commission.person_sim import AtBoards
from trocar.tools.commission.report import CommissionReport, fingerprint
from trocar.tools.commission.stages import NAMES, STAGES, CommissionStage
from trocar.tools.commission.subject import subjects_of
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit, note, table, tell
from trocar.tools.systems.find import supervisor_of, system_file, unknown
from trocar.tools.systems.processes import commissioning
from trocar.tools.systems.supervising import StartRequest, up_meanwhile
from trocar.tools.verbs.options import JsonOption

NAME: Final = "commission"
EASY: Final = ("io.period_s=0.002", "arm.period_s=0.002")  # on emulated boards, which share this machine's cores
EASY_LATE: Final = "late_s=0.5"
REHEARSALS: Final = 4  # of a stage in real time, while it stops


@dataclass(frozen=True, slots=True)
class Job:
    """The subject and options of a commissioning run."""

    request: StartRequest
    document: SystemConfig
    arms: list[str]
    person: Person | None  # None: one is simulated
    write: bool

    @property
    def boards(self) -> str:
        """real or emulated."""
        return boards_of(self.document)


def _eased(document: SystemConfig) -> list[str]:
    """Settings that let a rehearsal run on a busy machine; the person's settings follow and take precedence."""
    return [*EASY, *(f"processes.{row.name}.{EASY_LATE}" for row in document.processes if row.kind in ("io", "arm"))]


def boards_of(document: SystemConfig) -> str:
    """Kind of a system's boards: real or emulated."""
    return "real" if document.emulation is None else "emulated"


@ended_as_by_ctrl_c()
def commission(
    file: Annotated[Path, typer.Argument(metavar="SYSTEM", help="System file.")],
    boards: Annotated[str, typer.Option("--boards", help="`emulated`: rehearse it without hardware.")] = "",
    path: Annotated[list[Path] | None, typer.Option("--path", help="Also look for named files here.")] = None,
    stage: Annotated[str, typer.Option("--stage", help="Repeat one stage; those before it must have passed.")] = "",
    listed: Annotated[bool, typer.Option("--list", help="List the stages and which have passed.")] = False,
    arm: Annotated[list[str] | None, typer.Option("--arm", help="Only this arm; may be given several times.")] = None,
    write: Annotated[bool, typer.Option("--write", help="Calibrate into the IO files; their content is kept.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation; only for emulated boards.")] = False,
    report: Annotated[Path | None, typer.Option("--report", help="File; default commission-SYSTEM.json here.")] = None,
    sets: Annotated[list[str] | None, typer.Option(
        "--set", metavar="KEY=VALUE", help="Set a key of the `trocar:` section.")] = None,
    as_json: JsonOption = False,
    system: Annotated[str, typer.Option("--system", metavar="NAME", help="Its name while it runs.")] = NAME,
) -> int:
    """The first day on a robot: eight stages from finding the boards to a slow move, each of which stops at what is
    wrong and says what to do. A rerun resumes after the last stage that passed. Read docs/first-hardware.md first.

    Example: trocar commission configs/systems/demo.yaml --boards emulated --yes
    """
    request = StartRequest(system_file(file, path or ()), system, boards, tuple(path or ()), tuple(sets or ()))
    document = _document(request)
    if document.emulation is not None:
        request = dataclasses.replace(request, sets=(*_eased(document), *request.sets))
    if stage and stage not in NAMES:
        raise Misuse(f"no stage {stage}; there are {', '.join(NAMES)}")
    there = [subject.arm for subject in subjects_of(document) if subject.arm]
    if not there:
        raise Problem(f"{file}: no robot on boards to commission")
    if absent := next((name for name in arm or () if name not in there), None):
        raise unknown("arm on boards", absent, there)
    if write and document.emulation is not None:
        raise Misuse("--write is for a real robot: a rehearsal measures the emulated robot, not yours")
    if yes and document.emulation is None:
        raise Misuse("--yes is for emulated boards: on a real robot the operator confirms what powers or moves")
    book = CommissionReport(report or Path(f"commission-{file.stem}.json"), file.name)
    files = fingerprint(document) + "".join(f" {name}" for name in sorted(arm or []))
    if listed:
        return _list(book, boards_of(document), files, as_json)
    book.require_writable()
    _refuse_second(system)
    job = Job(request, document, arm or [], None if yes else AtTerminal(), write)
    try:
        return _go(job, book, files, _due(book, job.boards, files, stage), as_json)
    except KeyboardInterrupt:
        note("stopped by Ctrl-C; everything is off")
        return 1


def _refuse_second(system: str) -> None:
    """Problem while another commissioning runs."""
    supervisor = supervisor_of(system)
    if supervisor is not None and (pid := commissioning(supervisor.pid)):
        raise Problem(f"a commissioning runs already (pid {pid}, system {system}); wait until it ends, or choose "
                      "another name with --system")


def _document(request: StartRequest) -> SystemConfig:
    """The system according to its files; Problem with all errors."""
    loaded = load_system(request.file, search=request.paths, boards=request.boards or None, sets=request.sets,
                         name=request.system)
    if loaded.system is None:
        raise Problem("\n".join(map(str, loaded.errors)))
    return loaded.system


def _list(book: CommissionReport, boards: str, files: str, as_json: bool) -> int:
    rows = []
    for row in STAGES:
        tried = book.last(row.name, boards, files)
        state = "" if tried is None else "passed" if tried.passed else "stopped"
        rows.append((row.name, state, "" if tried is None else tried.when, row.text, row.stops))
        if as_json:
            emit({"stage": row.name, "state": state, "when": rows[-1][2], "text": row.text, "stops_at": row.stops})
    if not as_json:
        rehearsed = sum(book.passed(row.name, "emulated", files) for row in STAGES) if boards == "real" else 0
        table(f"{book.path} ({boards} boards)", ("stage", "state", "when", "looks at", "stops at"), rows)
        if rehearsed:
            note(f"{rehearsed} of {len(STAGES)} stages have passed in a rehearsal: --boards emulated lists those")
    return 0


def _due(book: CommissionReport, boards: str, files: str, wanted: str) -> list[CommissionStage]:
    """Stages to run: one stage again, or all after the last that passed."""
    left = [row for row in STAGES if not book.passed(row.name, boards, files)]
    if not wanted:
        return list(STAGES[STAGES.index(left[0]):]) if left else []
    row = STAGES[NAMES.index(wanted)]
    if left and STAGES.index(left[0]) < STAGES.index(row):
        raise Problem(f"stage {wanted} comes after {left[0].name}, which has not passed with these files; without "
                      "--stage it continues there")
    return [row]


def _go(job: Job, book: CommissionReport, files: str, due: list[CommissionStage], as_json: bool) -> int:
    if not due:
        note(f"all stages have passed: {book.path}; --stage NAME repeats one")
        return 0
    with contextlib.ExitStack() as stack:
        bench: RunningBench | None = None
        clock = ""
        for row in due:
            needed = WALL if row.real_time else job.document.clock
            if needed != clock and (row.live or job.boards == "emulated"):
                stack.close()
                bench, clock = stack.enter_context(_running(job, needed)), needed
            note(f"\n== {row.name}: {row.text}; stops at: {row.stops}")
            begin_ns = monotonic_ns()
            outcome = Outcome([Finding(f"stage {row.name}", "interrupted", "until its end", "run it again")])
            try:
                outcome = _tried(row, job, bench, book.path.parent)
            finally:
                tried = book.add(row.name, outcome, (monotonic_ns() - begin_ns) * 1e-9, job.boards, files)
            for text in outcome.notes:
                note(f"note: {text}")
            if as_json:
                emit({"stage": row.name, "passed": tried.passed, "seconds": tried.seconds, "problems": tried.problems,
                      "figures": tried.figures})
            if not tried.passed:
                if row.real_time and job.boards == "emulated":
                    note(f"{row.name} measures real time, and was rehearsed {REHEARSALS} times: the load of other "
                         "programs may be the only cause; end them first")
                if not as_json:
                    tell("\n".join(f"STOP {text}" for text in tried.problems), flush=True)
                note(f"stage {row.name} stopped, everything is off; {book.path} has what was measured, trocar logs "
                     f"--system {job.request.system} the messages; fix it and run the same command again")
                return 1
            note(f"{row.name} passed")
            if row.name == "calibrate" and job.write:
                note("the IO files have changed: run the same command again, it resumes with them")
                return 0
    note(f"all done: {book.path}")
    return 0


def _tried(row: CommissionStage, job: Job, bench: RunningBench | None, folder: Path) -> Outcome:
    """One stage; a refusal by the system is a finding, too. A rehearsal in real time may be late by chance."""
    for _ in range(REHEARSALS if row.real_time and job.boards == "emulated" else 1):
        outcome = _tried_once(row, job, bench, folder)
        if not outcome.problems:
            break
    return outcome


def _tried_once(row: CommissionStage, job: Job, bench: RunningBench | None, folder: Path) -> Outcome:
    run = row.load()
    try:
        if bench is None:
            return run(job)
        return run(bench, folder, write=job.write) if row.name == "calibrate" else run(bench)
    except (Declined, Misuse):
        raise
    except (Problem, TimeoutError) as problem:
        return Outcome([Finding(f"stage {row.name}", str(problem), "", "docs/errors.md has causes and remedies")])


@contextlib.contextmanager
def _running(job: Job, clock: str) -> Iterator[RunningBench]:
    """The system, up; down and off on every path."""
    with contextlib.ExitStack() as stack:
        sets = (*job.request.sets, f"clock={clock}")
        stack.enter_context(up_meanwhile(dataclasses.replace(job.request, sets=sets)))
        document = from_json(directory.document(job.request.system))
        person: Person = job.person or stack.enter_context(AtBoards(document))
        yield stack.enter_context(RunningBench(document, person, job.arms))
