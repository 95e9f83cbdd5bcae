"""Which modules read the time of day: it may be set at any time, so no lease, timeout or stall may follow it."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TIME_OF_DAY = re.compile(
    r"^from trocar\.shm\.time\.clock import .*\blocal_ns\b|CLOCK_REALTIME|datetime\.now|\btime\.time\b", re.M)
DATES = {
    "shm/time/clock.py": "has the clock",
    "shm/time/lockstep.py": "the date of the newest simulated time",
    "shm/system/events.py": "dates of events",
    "shm/mailbox/audit.py": "dates of commands",
    "procs/machine/log_files.py": "the first line of a log",
    "procs/supervisor/os_process.py": "a line in a log",
    "procs/boards/endpoints.py": "the kernel's stamps of datagrams are in it",
    "procs/crtk/views.py": "stamps for other programs",
    "procs/recordings/facts.py": "dates of records",
    "procs/ros_bridge/loop.py": "its library waits by the time of day",
    "tools/from_ros/arm.py": "delays of messages, whose stamps are of it",
    "tools/from_ros/remote_commands.py": "stamps for other programs",
    "procs/gui/browsers.py": "what pages show",
    "procs/gui/past.py": "times that a page goes back to",
    "procs/recorder/sources.py": "dates of records",
    "tools/monitor/app.py": "what a graph shows",
    "tools/systems/dumping.py": "the name of a file",
    "tools/systems/report_file.py": "the date of a file",
    "tools/commission/gravity.py": "the date of a file",
    "tools/commission/report.py": "the date of a try",
    "tools/verbs/report.py": "the name of a file",
    "tools/verbs/scope.py": "the date of a capture",
}


def test_only_what_gives_dates_reads_the_time_of_day() -> None:
    found = {path.relative_to(ROOT).as_posix() for folder in ("shm", "procs", "tools")
             for path in (ROOT / folder).rglob("*.py") if TIME_OF_DAY.search(path.read_text(encoding="utf-8"))}
    assert found <= DATES.keys()
