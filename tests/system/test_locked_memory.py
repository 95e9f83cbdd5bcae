"""What running processes have locked: their own memory each, what they share the supervisor, once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.memory.segment import names_of, path_of, segment_name
from trocar.shm.time.control_page import ControlPage

pytestmark = [pytest.mark.slow, pytest.mark.patient]
MEGABYTE = 1 << 20
MAX_OWN = 20 * MEGABYTE
"""An arm or io has 12 MB of its own, and had 44 MB when it locked a copy of every page of the template."""


def locked(pid: int) -> int:
    """What the kernel counts against the limit of a process, bytes."""
    found = re.search(r"VmLck:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    return int(found[1]) << 10 if found else 0


def maps(pid: int) -> list[tuple[str, dict[str, int]]]:
    """Of each region its line and its sizes in kB."""
    found: list[tuple[str, dict[str, int]]] = []
    for line in Path(f"/proc/{pid}/smaps").read_text().splitlines():
        if re.match(r"[0-9a-f]+-", line):
            found.append((line, {}))
        elif line.endswith(" kB"):
            found[-1][1][line.split(":")[0]] = int(line.split()[1])
    return found


def rights(robot: Robot, instance: str) -> str:
    page = ControlPage(robot.name, instance)
    words = str(page.get("policy").rstrip(b"\0").decode())
    page.close()
    return words


def test_each_locks_its_own_memory_and_the_supervisor_what_they_share(robot: Robot) -> None:
    robot.are_verbs_apart = True  # a fork of a test's template has more modules
    patience = ("supervisor_lost_s=30", "processes.io.hung_s=60", "processes.PSM1.hung_s=60")
    robot.up(ROOT / "configs/systems/kinematic.yaml", "--set", "clock=wall",
             *(word for setting in patience for word in ("--set", setting)))
    wait_for(lambda: "locked" in rights(robot, "supervisor"), 60, "the supervisor's locks")
    if "not locked" in rights(robot, "supervisor"):
        pytest.skip("nobody may lock memory here")
    shared = sum(path_of(segment_name(*parts)).stat().st_size for parts in names_of(robot.name))
    assert locked(robot.pid("supervisor")) >= shared + 40 * MEGABYTE  # numpy alone has so much code
    for name in ("io", "PSM1"):
        assert rights(robot, name).endswith("locked")
        found = maps(robot.pid(name))
        assert sum(sizes["Private_Dirty"] for _, sizes in found) << 10 < MAX_OWN
        for line, sizes in found:
            if "/dev/shm/" in line or (" r-xp " in line and "numpy" in line):
                assert sizes["Rss"] == sizes["Size"] and not sizes["Locked"], line
            elif sizes["Anonymous"] and " rw-p " in line:
                assert sizes["Locked"] >= sizes["Private_Dirty"], line  # and its part of the pages that it shares
