"""THE TABLE of the command line: one row per verb. `trocar VERB` and `python -m trocar VERB` are the same.

A verb's module is imported when the verb is used, so that help and completion are quick. Read-only verbs never change
the robot; the rows marked `moves` may start, stop, power or move something.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import inspect
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from trocar.procs.machine.end_signals import ctrl_c_ends, ctrl_c_raises
from trocar.procs.machine.imports import many_imports
from trocar.procs.machine.paths import ROOT
from trocar.procs.machine.version import VERSION
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.terminal import adapt_streams, open_streams

FINE, WRONG, MISUSED, INTERRUPTED = 0, 1, 2, 130


@dataclass(frozen=True, slots=True)
class Verb:
    """One verb: `door` is module:function in tools/, `moves` marks verbs that may change the robot's state."""

    name: str
    door: str
    text: str
    moves: bool = False
    raw: bool = False  # arguments that look like options are taken as they are (negative numbers)
    parts: tuple[Verb, ...] = ()  # a verb with sub-verbs and no function of its own


VERBS: tuple[Verb, ...] = (
    Verb("demo", "verbs.demo:demo", "Run a demo: a simulated operator moves a master, and a PSM follows.", moves=True),
    Verb("up", "verbs.up:up", "Start a system; nothing is powered or moved.", moves=True),
    Verb("down", "verbs.down:down", "Stop a system, and clean up after crashed systems.", moves=True),
    Verb("start", "verbs.processes:start", "Start one process of a running system.", moves=True),
    Verb("stop", "verbs.processes:stop", "Stop one process, and list the processes that depend on it.", moves=True),
    Verb("restart", "verbs.processes:restart", "Stop one process and start it again.", moves=True),
    Verb("power-on", "verbs.power:power_on", "Power the arms on, without homing them.", moves=True),
    Verb("home", "verbs.power:home", "Home the arms, and power them on first where needed.", moves=True),
    Verb("power-off", "verbs.power:power_off", "Power the arms off.", moves=True),
    Verb("send", "verbs.send:send", "Send a command to a process, e.g. an arm.", moves=True, raw=True),
    Verb("get", "verbs.properties:get", "Show the properties of processes and their values."),
    Verb("set", "verbs.properties:set_property", "Set a property of a process.", moves=True, raw=True),
    Verb("record", "verbs.record:record", "Record topics to a file, at full rate."),
    Verb("stream", "verbs.stream:stream", "Stream joint setpoints from a CSV file to an arm.", moves=True),
    Verb("replay", "verbs.replay:replay", "Repeat the motion of a recording, or show its records.", moves=True),
    Verb("pid", "", "Show, change and save the gains of the joint controllers.", moves=True, parts=(
        Verb("show", "verbs.pid:show", "Print the gains in use."),
        Verb("set", "verbs.pid:set_gains", "Change gains of a running controller.", moves=True),
        Verb("save", "verbs.pid:save", "Save the gains in use as a PID file."),
    )),
    Verb("bus", "", "Find, read, write and watch the controllers on a bus.", moves=True, parts=(
        Verb("scan", "verbs.bus:scan", "Find every controller; the first scan after power-up writes node numbers."),
        Verb("read", "verbs.bus:read", "Read registers."),
        Verb("write", "verbs.bus:write", "Write a register; asks first.", moves=True),
        Verb("watch", "verbs.bus:watch", "Live view of one board."),
    )),
    Verb("status", "verbs.status:status", "Show processes, arms and teleoperations, and the next thing to do."),
    Verb("logs", "verbs.logs:logs", "Show the logs of processes."),
    Verb("list", "verbs.listing:list_topics", "List topics with their rates and fields."),
    Verb("hz", "verbs.listing:hz", "Measure the rates of topics."),
    Verb("echo", "verbs.echo:echo", "Print the values of a topic."),
    Verb("scope", "verbs.scope:scope", "Show fields of topics around an event, as a plot or a table."),
    Verb("export", "verbs.export:export", "Export a recording as CSV, Parquet or rosbag2."),
    Verb("compare", "verbs.compare:compare", "Compare two recordings."),
    Verb("attach", "verbs.attach:attach", "Open the full-screen live monitor."),
    Verb("recordings", "verbs.recordings:recordings", "List recordings."),
    Verb("dump", "verbs.dump:dump", "Save a system's shared memory, even after a crash."),
    Verb("report", "verbs.report:report", "Pack logs, recordings and version numbers for a bug report."),
    Verb("rl", "", "Run policies in reinforcement-learning environments.", moves=True, parts=(
        Verb("rollout", "verbs.rl:rollout", "Run a policy in an environment: on this machine, on Ray, or on a robot.",
             moves=True),
    )),
    Verb("new-arm", "new_arm.verb:new_arm", "Write the configuration files of a new arm."),
    Verb("commission",
         "commission.verb:commission", "Commission a robot, stage by stage; powers and moves it.", moves=True),
    Verb("check", "verbs.check:check", "Validate configuration files."),
    Verb("kinematics", "", "Compute the kinematics and gravity torques of an arm from its files.", parts=(
        Verb("fk", "verbs.kinematics:fk", "Pose of the tip."),
        Verb("jacobian", "verbs.kinematics:jacobian", "Body and spatial Jacobian."),
        Verb("ik", "verbs.kinematics:ik", "Joints for a pose, or why none reach it."),
        Verb("gravity", "verbs.kinematics:gravity", "Efforts that hold the arm."),
    )),
    Verb("convert", "verbs.convert:convert", "Convert configuration files older than dVRK 2.4."),
    Verb("doctor", "verbs.doctor:doctor", "Check this machine and suggest fixes."),
    Verb("bench", "verbs.bench:bench", "Measure the speed of this machine and of Trocar."),
)

PANELS = {True: "Verbs that may start, stop, power or move something",
          False: "Verbs that neither power nor move anything"}


class VerbGroup(TyperGroup):
    """Verbs under one name; a wrong one is answered with those that there are."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """See typer."""
        if args[0] not in self.commands and not ctx.resilient_parsing:
            from trocar.procs.crtk.names import none_such

            about = () if ctx.parent else (verb.name for verb in VERBS if args[0] in re.findall(r"\w{4,}", verb.text))
            ctx.fail(none_such("command", args[0], self.commands, ctx.command_path, about))
        return super().resolve_command(ctx, args)


def build(only: str | None = None) -> typer.Typer:
    """The command line. With `only`, that verb's module is imported and the others appear as names in the help."""
    app = typer.Typer(
        name="trocar", cls=VerbGroup, help="Drive and inspect da Vinci research robots.", no_args_is_help=True,
        pretty_exceptions_enable=False, context_settings={"help_option_names": ["-h", "--help"]},
        epilog="Exit codes: 0 success, 1 problem, 2 usage error, 130 Ctrl-C. Help for a verb: trocar VERB --help. "
        "Example: trocar demo --for 10",
    )
    app.callback()(_nothing)
    for verb in VERBS:
        _add(app, verb, stub=only is not None and verb.name != only)
    return app


def _add(app: typer.Typer, verb: Verb, *, stub: bool) -> None:
    """A verb, or a group of them, under its name."""
    panel = PANELS[verb.moves]
    if verb.parts and not stub:
        examples = examples_of(verb)  # the shortest to read: lines that begin with our own name
        example = f"Example: {next((text for text in examples if text.startswith('trocar')), examples[0])}"
        group = typer.Typer(name=verb.name, cls=VerbGroup, help=verb.text, epilog=example, no_args_is_help=True)
        for part in verb.parts:
            _add(group, part, stub=False)
        app.add_typer(group, name=verb.name, short_help=verb.text, rich_help_panel=panel)
        return
    function = _stub if stub else guarded(loaded(verb.door))
    settings = {"ignore_unknown_options": True} if verb.raw else None
    text = None if stub else _flowing(function.__doc__ or "")
    app.command(verb.name, help=text, short_help=verb.text, rich_help_panel=panel, context_settings=settings)(function)


def _flowing(text: str) -> str:
    """A docstring whose paragraphs are lines, for terminals of any width."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in inspect.cleandoc(text).split("\n\n"))


def _version(asked: bool) -> None:
    if asked:
        python = ".".join(map(str, sys.version_info[:3]))
        print(f"trocar {VERSION} ({ROOT}, Python {python})")
        raise typer.Exit(FINE)


def _nothing(
    version: Annotated[bool, typer.Option("--version", is_eager=True, callback=_version,
                                          help="Print version and location.")] = False,
) -> None:
    """Drive and inspect da Vinci research robots."""


def _stub() -> None:
    """Placeholder for a verb that is not called."""


def loaded(door: str) -> Callable[..., Any]:
    """The function behind a verb, its module imported."""
    module, function = door.split(":")
    found: Callable[..., Any] = getattr(importlib.import_module(f"trocar.tools.{module}"), function)
    return found


def examples_of(verb: Verb) -> list[str]:
    """Usage examples of a verb, or of its sub-verbs, from the help."""
    if verb.parts:
        return [example for part in verb.parts for example in examples_of(part)]
    texts = (loaded(verb.door).__doc__ or "").split("Example: ")[1:]
    return [text.strip().splitlines()[0] for text in texts]


def guarded(function: Callable[..., Any]) -> Callable[..., None]:
    """The verb with its errors, Ctrl-C among them, turned into one line and an exit code, which it may return."""
    @functools.wraps(function)
    def run(*arguments: Any, **named: Any) -> None:
        code = FINE
        with _readers_may_leave():
            try:
                code = function(*arguments, **named) or FINE
            except BrokenPipeError:
                raise
            except Misuse as error:
                code = _reported(error, MISUSED)
            except _something_wrong() as error:
                code = _reported(error, WRONG)
            except KeyboardInterrupt as stopped:
                code = _reported(KeyboardInterrupt(f"stopped by Ctrl-C{stopped}"), INTERRUPTED)
        raise typer.Exit(code)

    return run


@contextlib.contextmanager
def _readers_may_leave() -> Iterator[None]:
    """A reader of our output may close it early, as `head -1` does: the rest of it goes nowhere, without an error."""
    try:
        with contextlib.suppress(BrokenPipeError):
            yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except OSError:  # also a full disk, which the verb has reported
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())  # the interpreter flushes it again at exit


def _something_wrong() -> tuple[type[Exception], ...]:
    """Exceptions from a robot or this machine; not every verb loads the modules that define them."""
    from trocar.shm.mailbox.client import MailboxFull
    from trocar.shm.memory.segment import SegmentError
    from trocar.shm.ring.ring import RingError

    return Problem, SegmentError, RingError, MailboxFull, OSError


def _reported(error: BaseException, code: int) -> int:
    from trocar.tools.output.printing import note

    if isinstance(error, OSError) and error.filename is not None:
        note(f"trocar: {error.filename}: {error.strerror}")
    else:
        note(f"trocar: {getattr(error, 'strerror', None) or error}")
    return code


def _verb_asked(arguments: Sequence[str]) -> str | None:
    """The verb that is going to run: the first word; None means that all may be needed (completion)."""
    if any(key.endswith("_COMPLETE") for key in os.environ):
        return None
    return next((word for word in arguments if not word.startswith("-")), "")


def _warned(message: Warning | str, *_: object, **__: object) -> None:
    """A warning as a person may read it: without the place in a file of ours that Python's own has."""
    from trocar.tools.output.printing import note

    note(f"trocar: {message}")


def main() -> None:
    """The command `trocar`."""
    open_streams()
    adapt_streams()
    warnings.showwarning = _warned
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a verb computes nothing that threads of numpy are worth
    ctrl_c_ends()
    with many_imports():
        app = build(_verb_asked(sys.argv[1:]))
    ctrl_c_raises()
    with _readers_may_leave():
        app(prog_name="trocar")
