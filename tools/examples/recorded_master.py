"""A recording as the master of a teleoperation: an example of a program that takes an arm's place.

    python -m trocar.tools.examples.recorded_master configs/recordings/circle.csv --press operator_present
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trocar.procs.machine.paths import given_file
from trocar.tools.cli import guarded
from trocar.tools.client.provider import Provider
from trocar.tools.client.scripting import provide
from trocar.tools.examples.recordings import Recording, read_recording
from trocar.tools.output.printing import note
from trocar.tools.verbs.options import SystemOption

RELEASED_S = 0.2  # a console counts a button only after it has seen it released


def place_in(recording: Recording, passed_s: float, pace: float) -> tuple[float, float]:
    """The recording's own time after this real time, played back and forth, and its direction."""
    part, within = divmod(passed_s * pace, recording.seconds)
    return (within, pace) if part % 2 == 0 else (recording.seconds - within, -pace)


def play(master: Provider, recording: Recording, pace: float, times: int, held: list[str]) -> bool:
    """Show the recording at the master's rate; False: the system ended before it did."""
    begin_ns, end_s = master.now_ns, recording.seconds / pace * times
    while master.tick():
        begin_ns += round(master.held_up_s * 1e9)  # it resumes where it was
        passed_s = (master.now_ns - begin_ns) * 1e-9
        moment = recording.at(*place_in(recording, min(passed_s, end_s - 1e-9), pace))
        down = moment.pressed.union(held if passed_s >= RELEASED_S else ())
        for button in {*recording.buttons, *held}:
            master.press(button, button in down)
        master.write(moment.pose, moment.twist, gripper=moment.gripper)
        if passed_s >= end_s:
            return True
    return False


def recorded_master(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="CSV: time, x, y, z, qx, qy, qz, qw, gripper, buttons.")],
    arm: Annotated[str, typer.Option("--arm", help="The arm that it replaces.")] = "MTMR",
    press: Annotated[list[str] | None, typer.Option("--press", help="A button held down all the time.")] = None,
    pace: Annotated[float, typer.Option("--pace", min=0.01, max=10.0, help="2: twice as fast.")] = 1.0,
    times: Annotated[int, typer.Option("--times", min=1, help="Play it this many times, forwards and backwards.")] = 1,
    rate: Annotated[float, typer.Option("--rate", min=50.0, max=2000.0, help="Records a second.")] = 200.0,
    system: SystemOption = None,
) -> int:
    """Play a recording as the master of a teleoperation, then leave: whoever followed it stops.

    The columns stand in docs/third-party-masters.md; what lies between two rows is interpolated.

    Example: python -m trocar.tools.examples.recorded_master configs/recordings/circle.csv --press operator_present
    --times 4
    """
    recording = read_recording(given_file(file))
    with provide(arm, system, rate=rate, program="recorded_master") as master:
        note(f"{arm} is {file.name}: {recording.seconds:g} s, {times} times; Ctrl-C ends it")
        try:
            ended = play(master, recording, pace, times, press or [])
        except KeyboardInterrupt:
            ended = True
    note(f"{arm} has no program now" if ended else "the system has ended")
    return 0


if __name__ == "__main__":
    typer.run(guarded(recorded_master))
