"""`trocar up [SYSTEM]`: start a system."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from trocar.procs.machine.end_signals import ctrl_c_waits
from trocar.procs.machine.logind import at_logout
from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.machine.verb_lines import default_system, verb_line
from trocar.tools.output.errors import Misuse
from trocar.tools.output.printing import emit, note, progress, tell
from trocar.tools.systems.dumping import keep_left_over
from trocar.tools.systems.find import environment, system_file
from trocar.tools.systems.supervising import Background, StartRequest, refuse_shortage, refuse_taken
from trocar.tools.systems.web_address import web_addresses
from trocar.tools.verbs.logs import tail
from trocar.tools.verbs.options import ClockOption, JsonOption, PathOption, SetOption, clock_set

DEMO = PROJECT_CONFIGS / "systems" / "demo.yaml"
NOTES = 30


def up(
    file: Annotated[Path | None, typer.Argument(
        metavar="[SYSTEM]", help="System file; default: configs/systems/demo.yaml.")] = None,
    boards: Annotated[str, typer.Option("--boards", help="`emulated`: emulate the boards, without hardware.")] = "",
    path: PathOption = None,
    calibration: Annotated[bool, typer.Option(
        "--calibration-mode", "-C", help="Do not check potentiometers; only for calibration.")] = False,
    clock: ClockOption = "",
    seconds: Annotated[float | None, typer.Option(
        "--for", min=0.0, help="Time until the system stops, in seconds of real time.")] = None,
    sets: SetOption = None,
    detach: Annotated[bool, typer.Option(
        "--detach", help="Return when the system is up. The system keeps running.")] = False,
    as_json: JsonOption = False,
    system: Annotated[str, typer.Option(
        "--system", envvar="TROCAR_SYSTEM", metavar="NAME", help="Name of the new system.")] = default_system(),
) -> int:
    """Start a system: all processes that the system file describes.

    Nothing is powered or moved. Ctrl-C or `trocar down` stops the system.

    Example: trocar up configs/systems/demo.yaml --boards emulated --detach
    """
    if boards not in ("", "emulated"):
        raise Misuse(f"--boards {boards}; allowed: emulated")
    if file is None:
        file, boards = DEMO, boards or "emulated"
    values = (*(sets or ()), *clock_set(clock), *(["calibration_mode=true"] if calibration else []))
    request = StartRequest(system_file(file, path or ()), system, boards, tuple(path or ()), values, seconds)
    refuse_shortage()
    refuse_taken(system)
    with progress(f"saving the memory that {system} left") as say:
        keep_left_over(system, say)
    if not detach:
        sys.stdout.flush()
        ctrl_c_waits()
        os.execve(sys.executable, request.command(), environment())
    with progress(f"starting {system}") as say:
        background = Background(request)
        try:
            background.wait_until_up(say)
        except BaseException:
            background.stop(say)
            raise
    note(tail(background.log, NOTES))
    if any(warning := at_logout(os.getuid())):
        note(": ".join(warning))
    links = web_addresses(system)
    if as_json:
        emit({"system": system, "pid": background.popen.pid, "log": str(background.log), "web_console": links})
    else:
        if links:
            tell(f"in a browser: {', '.join(links)}")
        tell(f"system {system} is up (pid {background.popen.pid}); {verb_line('status', system)} shows it, "
             f"{verb_line('down', system)} stops it")
    return 0
