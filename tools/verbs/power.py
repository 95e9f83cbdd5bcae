"""`trocar power-on`, `home`, `power-off`: bring arms to a state, and tell which are not there and why."""

from __future__ import annotations

from typing import Annotated

import typer

from trocar.procs.document.process import CALIBRATION_MODE
from trocar.procs.tables.bring_up import DISABLED, ENABLED, HOMED
from trocar.tools.client.bring_up import bring
from trocar.tools.inspect.standing import system_remarks
from trocar.tools.inspect.watch import powered_names
from trocar.tools.output.errors import Problem, only_waiting
from trocar.tools.output.printing import emit, note, progress, table
from trocar.tools.systems.find import chosen_system, is_reduced, supervisor_of
from trocar.tools.systems.processes import commissioning
from trocar.tools.verbs.options import JsonOption, SystemOption

Arms = Annotated[list[str] | None, typer.Argument(metavar="[ARM]...", help="Arms; default: all arms of the system.")]
DOING = {ENABLED: "power-on", HOMED: "homing", DISABLED: "power-off"}
Timeout = Annotated[float, typer.Option(
    "--timeout", min=0.0, help="Seconds to wait for each step; 0: as usual, 60 s to home, 7 s to switch on or off.")]


def power_on(arms: Arms = None, timeout: Timeout = 0.0, as_json: JsonOption = False,
             system: SystemOption = None) -> int:
    """Enable the arms: motor power on, joints not yet homed. Arms in FAULT are disabled first.

    Example: trocar power-on PSM1
    """
    return _verb(ENABLED, arms, timeout, as_json, system)


def home(arms: Arms = None, timeout: Timeout = 0.0, as_json: JsonOption = False, system: SystemOption = None) -> int:
    """Home the arms; those that are not enabled are enabled first. Arms may move!

    A master drives its roll to the lower stop, then moves all joints to zero. Other arms stay where they are; with
    `homing_zero_position` in the arm file they move to zero. A PSM also engages its adapter and instrument, unless that
    is done.

    Example: trocar home
    """
    return _verb(HOMED, arms, timeout, as_json, system)


def power_off(arms: Arms = None, timeout: Timeout = 0.0, as_json: JsonOption = False,
              system: SystemOption = None) -> int:
    """Disable the arms: motor power off. Arms without brakes sink!

    Exit code 1: an arm is not off, or another program removed shared memory of the system.

    Example: trocar power-off
    """
    return _verb(DISABLED, arms, timeout, as_json, system)


def _verb(goal: str, arms: list[str] | None, timeout: float, as_json: bool, system: str | None) -> int:
    name = chosen_system(system)
    supervisor = supervisor_of(name) if goal != DISABLED else None
    if supervisor is not None and (pid := commissioning(supervisor.pid)):  # a person may have a hand on the arm
        raise Problem(f"trocar commission (pid {pid}) drives {name}; wait until it ends, or stop it with Ctrl-C")
    names = powered_names(name, arms)
    if not names:
        raise Problem(f"system {name} has no arms")
    if goal != DISABLED and system_remarks(name)[0]:
        note(CALIBRATION_MODE)
    stops = " ".join(("trocar power-off", *(arms or ()))) if goal != DISABLED else ""
    with only_waiting(stops), progress(DOING[goal]) as say:
        problems = bring(name, names, goal, timeout, say, note)
    if as_json:
        emit(*({"arm": arm, "goal": goal, "done": not problem, "problem": problem or None}
               for arm, problem in problems.items()))
    else:
        rows = [(arm, goal if not problem else "NOT " + goal, problem) for arm, problem in problems.items()]
        table("", ("arm", "result", "why"), rows)
    return 1 if (goal == DISABLED and is_reduced(name)) or any(problems.values()) else 0
