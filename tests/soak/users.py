"""Several users of one machine, each with a KINEMATIC arm: CPU time, memory and speed of a class.

    python -m tests.soak.users --users 20 --seconds 20

Needs root, which becomes each of them. All start at the same time; prints a row for each number of users that was
measured, with the sums of all their processes. Exit code 1 when a system did not start, or had a problem.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.user_sim import ROOT, UserSim
from trocar.shm.time.clock import monotonic_ns, pause

FIRST: Final = 64201
FILE: Final = str(ROOT / "configs" / "systems" / "kinematic.yaml")
TICKS: Final = os.sysconf("SC_CLK_TCK")
SETTLE_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Usage:
    """Of all processes of some users."""

    processes: int
    cpu_s: float
    pss_mb: float
    at_ns: int


def usage(users: Sequence[UserSim]) -> Usage:
    """Now, from the Linux kernel's list of processes."""
    numbers, processes, ticks, pss_kb = {user.number for user in users}, 0, 0, 0
    for folder in Path("/proc").iterdir():
        try:
            if not folder.name.isdigit() or folder.stat().st_uid not in numbers:
                continue
            words = (folder / "stat").read_text().rsplit(")", 1)[1].split()
            found = re.search(r"^Pss: +(\d+)", (folder / "smaps_rollup").read_text(), re.MULTILINE)
        except OSError:  # it has ended
            continue
        processes, ticks = processes + 1, ticks + int(words[11]) + int(words[12])
        pss_kb += int(found[1]) if found else 0
    return Usage(processes, ticks / TICKS, pss_kb / 1e3, monotonic_ns())


def measure(users: Sequence[UserSim], seconds: float, sets: Sequence[str]) -> bool:
    """Start, measure and print; whether all went well."""
    words = ["up", FILE, "--detach", *(word for text in sets for word in ("--set", text))]
    began_ns = monotonic_ns()
    starts = [user.start(*words) for user in users]
    outputs = [start.communicate(timeout=600.0)[0] for start in starts]
    start_s = (monotonic_ns() - began_ns) * 1e-9
    if bad := [output for start, output in zip(starts, outputs, strict=True) if start.returncode]:
        print(f"{len(bad)} did not start, the first: {bad[0]}")
        return False
    pause(SETTLE_S)
    before = usage(users)
    pause(seconds)
    after = usage(users)
    took_s, count = (after.at_ns - before.at_ns) * 1e-9, len(users)
    shown = [user.status() for user in users]
    speeds = [float(one["speed"]) for one in shown]
    problems = [row["problem"] for one in shown for row in one["processes"] if row["problem"]]
    cores = (after.cpu_s - before.cpu_s) / took_s / count
    print(f"{count:3} users: started in {start_s:.0f} s; CPU {100 * cores:.1f} % of a core each, "
          f"{cores * count / sum(speeds):.2f} s per second of the system's time; "
          f"memory {after.pss_mb / count:.0f} MB each (PSS with shared memory); "
          f"{after.processes / count:.1f} processes each; speed {min(speeds):.2f} to {max(speeds):.2f} of real time")
    if problems:
        print(f"problems: {sorted(set(problems))}")
    return not problems


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--users", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--set", dest="sets", action="append", default=[])
    chosen = parser.parse_args()
    with UserSim.several(range(FIRST, FIRST + chosen.users)) as users:
        return 0 if measure(users, chosen.seconds, chosen.sets) else 1


if __name__ == "__main__":
    sys.exit(main())
