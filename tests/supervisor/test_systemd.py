"""What systemd hears of a system, and the unit that starts one."""

from __future__ import annotations

import configparser
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from trocar.procs.node.realtime import SYSTEMD
from trocar.procs.supervisor.systemd import Notifier

ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "tools" / "trocar.service"


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[socket.socket]:
    """The other end of the socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(tmp_path / "notify"))
        heard.setblocking(False)
        yield heard


def heard_by(heard: socket.socket) -> list[str]:
    """All that has come."""
    found = []
    while True:
        try:
            found.append(heard.recv(4096).decode())
        except BlockingIOError:
            return found


def test_systemd_hears_that_we_live_four_times_in_its_time(systemd: socket.socket, tmp_path: Path) -> None:
    environ = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid()),
               "HOME": "/"}
    notifier = Notifier(environ)
    assert environ == {"HOME": "/"}, "our processes do not speak for us"
    notifier.tell("READY=1", "STATUS=up")
    for now_ns in range(10_000_000_000, 12_000_000_000, 20_000_000):
        notifier.beat(now_ns)
    assert heard_by(systemd) == ["READY=1\nSTATUS=up", *["WATCHDOG=1"] * 4]
    notifier.close()


def test_nothing_waits_for_a_systemd_that_does_not_listen(systemd: socket.socket, tmp_path: Path) -> None:
    notifier = Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "4"})
    for now_ns in range(5_000):
        notifier.beat(now_ns * 1000)
    (tmp_path / "notify").unlink()
    notifier.tell("STOPPING=1")
    notifier.close()


def test_without_systemd_nothing_is_said(tmp_path: Path) -> None:
    for environ in ({}, {"WATCHDOG_USEC": "1", "WATCHDOG_PID": "1"}):
        notifier = Notifier(environ)
        notifier.tell("READY=1")
        notifier.beat(1)
        notifier.close()


def test_the_unit_gives_the_rights_and_the_time_to_power_off() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]  # keys of units have capitals
    unit.read(UNIT)
    service = unit["Service"]
    assert all(f"{key}={service[key]}" in SYSTEMD for key in ("LimitRTPRIO", "LimitMEMLOCK"))
    assert service["Type"] == "notify" and float(service["WatchdogSec"]) > 1.0
    assert service["KillMode"] == "mixed" and " down" in service["ExecStopPost"]
    if shutil.which("systemd-analyze") is not None:
        done = subprocess.run(["systemd-analyze", "verify", str(UNIT)], capture_output=True, text=True, check=False)
        assert "Unknown" not in done.stderr
