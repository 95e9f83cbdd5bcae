"""Processes without real-time rights are named at `up` and in `status`, with the two lines that grant them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.system.robot import ROOT
from trocar.procs.node.realtime import lacking, user

ASK = """
import os, resource
from trocar.procs.document.system import Process
from trocar.procs.node.realtime import in_words, lock_memory, realtime
for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
    resource.setrlimit(limit, (0, 0))
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
row = Process(name="io", kind="io", period_s=0.001, priority=80, cpus=(999,))
print(in_words([*realtime(row, "wall"), lock_memory()]).decode())
"""


def test_all_is_well_where_everybody_got_what_it_asked_for() -> None:
    assert lacking({"IO1": "deadline, locked", "PSM1": "FIFO 60, locked", "supervisor": "other"}) == ""


def test_what_is_lacking_is_told_with_who_lacks_it_and_what_grants_it() -> None:
    reported = lacking({"IO1": "no FIFO, not locked", "PSM1": "FIFO 60, not locked", "console": "no FIFO"}).splitlines()
    assert reported[0].endswith(": IO1, console") and reported[1].endswith(": IO1, PSM1")
    assert "/etc/security/limits.d/trocar.conf" in reported[2]
    assert reported[3:5] == [f"    {user()} - rtprio 98", f"    {user()} - memlock unlimited"]
    assert "LimitRTPRIO=98" in reported[5] and "LimitMEMLOCK=infinity" in reported[5]


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become somebody without rights")
def test_both_refusals_of_the_kernel_are_noted() -> None:
    done = subprocess.run([sys.executable, "-c", ASK], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "no FIFO, not locked, no cpu 999", done.stderr
