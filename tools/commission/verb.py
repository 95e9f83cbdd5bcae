"""`trocar commission SYSTEM`: the first day on a real robot, stage by stage."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from trocar.procs.config import load_system
from trocar.procs.document.system import Robot, SystemConfig, from_json
from trocar.procs.fpga.conversion import are_nominal
from trocar.procs.machine.end_signals import ended_as_by_ctrl_c
from trocar.procs.machine.verb_lines import default_system
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import WALL
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.io_file import CALIBRATED, REHEARSED
from trocar.tools.commission.person import AtTerminal, Declined, Person
from trocar.tools.commission.person_sim import AtBoards
from trocar.tools.commission.report import CommissionReport, Try, fingerprint
from trocar.tools.commission.stages import NAMES, STAGES, CommissionStage
from trocar.tools.commission.subject import carts_of, setup_subject, subjects_of
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit, note, table, tell
from trocar.tools.systems.find import supervisor_of, system_file, unknown
from trocar.tools.systems.processes import commissioning
from trocar.tools.systems.supervising import StartRequest, up_meanwhile
from trocar.tools.verbs.options import JsonOption, PathOption
from trocar.tools.verbs.report import RECORDINGS_MB, pack

NAME: Final = "commission"
EASY: Final = ("io.period_s=0.002", "arm.period_s=0.002")  # on emulated boards, which share this machine's cores
CALIBRATING: Final = "calibration_mode=true"
EASY_LATE: Final = "late_s=0.5"
NOMINAL: Final = "its IO file still has nominal current offsets"
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
        return "real" if self.document.emulation is None else "emulated"


def _eased(request: StartRequest, document: SystemConfig) -> StartRequest:
    """A rehearsal that runs on a busy machine, too; the person's settings follow and take precedence."""
    if document.emulation is None:
        return request
    late = (f"processes.{row.name}.{EASY_LATE}" for row in document.processes if row.kind in ("io", "arm"))
    return dataclasses.replace(request, sets=(*EASY, *late, *request.sets))


def _has_no_table(robot: Robot) -> bool:
    return robot.potentiometers == "DIGITAL" and not robot.lookup


@ended_as_by_ctrl_c()
def commission(
    file: Annotated[Path, typer.Argument(metavar="SYSTEM", help="System file.")],
    boards: Annotated[str, typer.Option(
        "--boards", help="`emulated`: rehearse on emulated boards, without hardware.")] = "",
    path: PathOption = None,
    stage: Annotated[str, typer.Option("--stage", help="Stage to repeat. All earlier stages must have passed.")] = "",
    listed: Annotated[bool, typer.Option("--list", help="List the stages, and show which have passed.")] = False,
    arm: Annotated[list[str] | None, typer.Option("--arm", help="Arm to commission; repeatable; default: all.")] = None,
    write: Annotated[bool, typer.Option(
        "--write", help="Write the calibration into your files. FILE.bak1 keeps the old content.")] = False,
    yes: Annotated[bool, typer.Option(
        "--yes", help="Confirm every step automatically; only with emulated boards.")] = False,
    report: Annotated[Path | None, typer.Option(
        "--report", help="Report file; default: commission-SYSTEM.json.")] = None,
    pack_into: Annotated[Path | None, typer.Option(
        "--pack", metavar="FILE",
        help="Pack report, configuration files, logs, recordings and version numbers into a new .tar.gz "
        "file, ready to send. No stage is run.")] = None,
    sets: Annotated[list[str] | None, typer.Option(
        "--set", metavar="KEY=VALUE", help="Value for a key of the file's `trocar:` section.")] = None,
    as_json: JsonOption = False,
    system: Annotated[str, typer.Option("--system", metavar="NAME", help="Name of the system during commissioning."),
    ] = default_system(NAME),
) -> int:
    """Commission a robot in stages, from finding the boards to moving slowly. The later stages power and move it.

    First read docs/first-hardware.md. Each stage stops at the first problem, and names the remedy. The same command
    then resumes after the last stage that passed.

    Example: trocar commission configs/systems/demo.yaml --boards emulated --yes
    """
    if stage and stage not in NAMES:
        raise Misuse(f"no stage {stage}; there are {', '.join(NAMES)}")
    request, document = _document(StartRequest(system_file(file, path or ()), system, boards, tuple(path or ()),
                                               tuple(sets or ())))
    job = Job(_eased(request, document), document, arm or [], None, write)
    _check(job, yes)
    book = CommissionReport(report or Path(f"commission-{file.stem}.json"), file.name)
    files = fingerprint(document) + "".join(f" {name}" for name in sorted(job.arms))
    if pack_into is not None:
        return pack(system, pack_into, RECORDINGS_MB, as_json, _files(file, document, book))
    if listed:
        return _list(book, job.boards, files, as_json)
    book.require_writable()
    _refuse_second(system)
    job = dataclasses.replace(job, person=None if yes else AtTerminal())
    try:
        return _go(job, book, files, _due(job, book, files, stage), as_json)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("; everything is off; the same command resumes with the interrupted stage") from None


def _check(job: Job, yes: bool) -> None:
    """Problem if the system has no such arms on boards; Misuse for options of the other kind of boards."""
    there = [subject.arm for subject in subjects_of(job.document) if subject.arm]
    there += [cart.name for cart in carts_of(job.document)]
    if not there:
        raise Problem(f"{job.request.file}: no robot on boards to commission")
    if absent := next((name for name in job.arms if name not in there), None):
        raise unknown("arm on boards", absent, there)
    if job.write and job.boards == "emulated":
        raise Misuse("--write is for a real robot: a rehearsal measures the emulated robot, not yours")
    if yes and job.boards == "real":
        raise Misuse("--yes is for emulated boards: on a real robot the operator confirms what powers or moves")


def _files(file: Path, document: SystemConfig, book: CommissionReport) -> list[Path]:
    """The report, the files of the system, and those that stages have written."""
    sources = [Path(robot.source) for io in document.ios for robot in io.robots]
    sources += [Path(arm.source) for arm in document.arms] + [Path(cart.source) for cart in document.carts]
    each = {path.resolve(): path for path in (book.path, file, *sources, *book.made) if path.is_file()}
    return list(each.values())


def _refuse_second(system: str) -> None:
    """Problem while another commissioning runs."""
    supervisor = supervisor_of(system)
    if supervisor is not None and (pid := commissioning(supervisor.pid)):
        raise Problem(f"a commissioning runs already (pid {pid}, system {system}); wait until it ends, or choose "
                      "another name with --system")


def is_calibrating(document: SystemConfig) -> bool:
    """Whether the system starts in calibration mode."""
    return any(io.calibration_mode for io in document.ios)


def _document(request: StartRequest) -> tuple[StartRequest, SystemConfig]:
    """The system according to its files, and how to start it; Problem with all errors.

    Files that lack calibrated values start in calibration mode, until the next stage that makes some.
    """
    calibrating = dataclasses.replace(request, sets=(*request.sets, CALIBRATING))
    errors: Sequence[object] = ()
    for each in (request, calibrating):
        loaded = load_system(each.file, search=each.paths, boards=each.boards or None, sets=each.sets, name=each.system)
        if loaded.system is not None:
            if each is calibrating:
                note("\n".join(map(str, errors)))
                note("the files lack calibrated values: the system starts in calibration mode")
            return each, loaded.system
        errors = errors or loaded.errors
    raise Problem("\n".join(map(str, errors)))


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


def _due(job: Job, book: CommissionReport, files: str, wanted: str) -> list[CommissionStage]:
    """Stages to run: one stage again, or all after the last that passed; none that needs values which are missing."""
    left = _left(job, book, files)
    due = list(STAGES[STAGES.index(left[0]):]) if left else []
    if wanted:
        due = [STAGES[NAMES.index(wanted)]]
        if left and STAGES.index(left[0]) < STAGES.index(due[0]):
            raise Problem(f"stage {wanted} comes after {left[0].name}, which has not passed with these files; without "
                          "--stage it continues there")
    for what, stage in _lacks(job, book, files):
        if due and not (due := [row for row in due if row in STAGES[: NAMES.index(stage) + 1]]):
            raise Problem(what)
    return due


def _left(job: Job, book: CommissionReport, files: str) -> list[CommissionStage]:
    """The stages that have not passed."""
    return [row for row in STAGES if not book.passed(row.name, job.boards, files)]


def _lacks(job: Job, book: CommissionReport, files: str) -> list[tuple[str, str]]:
    """Values without which no motor or brake may be driven, with the remedy, and the last stage that needs none.

    Setup joints alone wait for no value of an arm.
    """
    found: list[tuple[str, str]] = []

    def use(stage: str, name: str = "") -> str:
        put = _put_in_place(job, book, book.last(stage, job.boards, files), name)
        return f"{put} (--stage {stage} repeats stage {stage})"

    document = job.document
    are_arms = not job.arms or bool(subjects_of(document, job.arms))
    arms = [subject.robot for subject in subjects_of(document) if subject.arm and are_arms]
    for robot in (*arms, *(setup_subject(document, cart).robot for cart in carts_of(document, job.arms))):
        if _has_nominal_offsets(robot):
            found.append((f"{robot.name}: {NOMINAL}: {use('currents', Path(robot.source).stem)}", "currents"))
    for robot in filter(_has_no_table, arms):
        found.append((f"{robot.name}: its potentiometers have no table: {use('tables', robot.serial)}", "tables"))
    if are_arms and is_calibrating(document):  # potentiometers are not compared with encoders: no joint controller
        found.append(("these files still lack calibrated values, and no arm homes in calibration mode: "
                      + use("calibrate"), "calibrate"))
    return found


def _put_in_place(job: Job, book: CommissionReport, tried: Try | None, name: str = "") -> str:
    """What to do with the new files of a stage whose names contain `name`."""
    sources = {Path(robot.source).stem: Path(robot.source).name for io in job.document.ios for robot in io.robots}
    rows = []
    for made in (book.path.parent / file for file in (tried.made if tried else ()) if name in file):
        place = made.stem.removesuffix(f"-{REHEARSED}").removesuffix(f"-{CALIBRATED}")
        if made.suffix == ".json":  # else it is the old content
            rows.append(f"{made} " + ("in its place" if place == made.stem else
                                      f"in the place of {sources.get(place, f'{place}.json')}"))
    where = "in a copy of the folder, " if job.boards == "emulated" else ""
    return f"{where}put {' and '.join(rows) or 'the new files in the place of the old ones'}"


def _has_nominal_offsets(robot: Robot) -> bool:
    return robot.hardware != "dRA1" and are_nominal([part.current_to_bits.offset for part in robot.actuators])


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
                _tell_stop(row, job, book, () if as_json else tried.problems)
                return 1
            note(f"{row.name} passed")
            goes_on = row is not due[-1] or _lacks(job, book, files)
            if row.writes and outcome.figures and goes_on and (after := _new_files(job, book, tried)):
                note(after)
                return 0
    if left := _left(job, book, files):
        note(f"stage {due[-1].name} passed; next: {left[0].name} (the command without --stage); {book.path}")
    else:
        note(f"all done: {book.path}")
    return 0


def _tell_stop(row: CommissionStage, job: Job, book: CommissionReport, problems: Sequence[str]) -> None:
    """What has stopped a stage, and what to do."""
    if row.real_time and job.boards == "emulated":
        note(f"{row.name} measures real time, and was rehearsed {REHEARSALS} times: the load of other programs may be "
             "the only cause; end them first")
    if problems:
        tell("\n".join(f"STOP {text}" for text in problems), flush=True)
    note(f"stage {row.name} stopped, everything is off; {book.path} has what was measured, trocar logs "
         f"--system {job.request.system} the messages; fix it and run the same command again")


def _new_files(job: Job, book: CommissionReport, tried: Try) -> str:
    """What to do with the files that a stage has written before the next stage; empty: nothing."""
    if job.write:
        return "the files have changed: run the same command again, it resumes with them"
    if job.boards == "emulated" and not is_calibrating(job.document):
        return ""  # a rehearsal continues with the robot's own files
    put = _put_in_place(job, book, tried)
    return (f"to rehearse the rest: {put}, and run the same command there; real boards refuse such files"
            if job.boards == "emulated" else f"{put}, then run the same command again: it resumes with it")


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
        return run(bench, folder, write=job.write) if row.writes else run(bench)
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
