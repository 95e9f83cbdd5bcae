"""`trocar bench recorder`: cost of the recorder, and its effect on io.

The full KINEMATIC system on the wall clock, homed, all arms moving all the time. `recorder_cpu_percent` (100 is one
core) and `mb_per_minute` (on the disk, compressed) are those of the black box alone; `named_…` are the additional cost
of recording every record of PSM1 and its io. `sequence_gaps` are the records of these missing in the file.
`io_period_p99_ratio` is io's period (99 %) with the black box to that without a recorder, median of pairs by turns.
"""

from __future__ import annotations

import contextlib
import os
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from trocar.procs.document.recorder import NAME
from trocar.procs.recordings.reading import open_recording
from trocar.shm.system import directory
from trocar.tools.bench import beside
from trocar.tools.bench.beside import PAIRS, MovingArms, RobotAtWork, full_robot
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import plain
from trocar.tools.systems.cleanup import own_folder

TOPICS: Final = ("PSM1", "io")
SETTLE_S: Final = 3.0
END_S: Final = 30.0


def run(seconds: float = 30.0, pairs: int = PAIRS) -> dict[str, Any]:
    """Measure. `seconds`: of each part of a pair, and of the recordings."""
    name = f"bench-recorder-{os.getpid()}"
    with (own_folder(name) as folder, full_robot(name, "recorder.on=true", f"recorder.folder={folder}"),
          closing(MovingArms(name)) as arms):
        robot = RobotAtWork(name, arms.go_on)
        robot.wait(min(SETTLE_S, seconds))
        figures: dict[str, Any] = {}
        figures["recorder_cpu_percent"], figures["mb_per_minute"] = _black_box(robot, seconds)
        figures |= _named(robot, seconds)
        figures["io_period_p99_ratio"] = robot.period_ratio(NAME, seconds, pairs, contextlib.nullcontext, SETTLE_S)
    return {"figures": figures, "conditions": {"seconds": seconds, "pairs": pairs, "arms": len(beside.ARMS),
                                               "topics": " ".join(TOPICS)}}


def _state(system: str, *fields: str) -> list[float]:
    """Numbers that the recorder shows."""
    with closing(directory.reader(system, NAME, "state", often=False)) as state:
        if not state.newest():
            raise Problem("the recorder shows nothing")
        return [float(state.field(field)[()]) for field in fields]


def _black_box(robot: RobotAtWork, seconds: float) -> tuple[float, float]:
    before, begin_ns = _state(robot.system, "box_bytes", "monotonic_ns")
    percent = robot.cpu_percent(seconds, robot.process(NAME))
    after, end_ns = _state(robot.system, "box_bytes", "monotonic_ns")
    return percent, (after - before) / 1e6 / (max(end_ns - begin_ns, 1.0) * 1e-9 / 60.0)


def _named(robot: RobotAtWork, seconds: float) -> dict[str, float]:
    """A recording of every record of TOPICS."""
    with Remote(robot.system, NAME) as remote:
        for topic in TOPICS:
            remote.ask("choose", text=topic)
        number = remote.send("record", [0.0], "bench")
        robot.wait(min(1.0, seconds))
        percent = robot.cpu_percent(seconds, robot.process(NAME))
        remote.settled("stop", text="bench", timeout=END_S)
        replies = remote.replies_to(number)
    if not replies or replies[-1].outcome != "done":
        raise Problem(f"the recording did not end: {replies}")
    with closing(directory.reader(robot.system, NAME, "state", often=False)) as state:
        path = Path(plain(state.field("path").item()) if state.newest() else "")
    with open_recording(path) as recording:
        topics = [topic for topic in recording.record_topics if topic.partition("/")[0] in TOPICS]
        gaps = sum(recording.records(topic).missing for topic in topics)
        passed_s = (recording.end_ns - recording.begin_ns) * 1e-9
        lost = int(recording.metadata["losses"]["dropped"])
    megabytes = path.stat().st_size / 1e6
    return {"named_cpu_percent": percent, "named_mb_per_minute": megabytes / max(passed_s, 1e-3) * 60.0,
            "sequence_gaps": gaps + lost}
