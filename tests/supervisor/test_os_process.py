"""How a process ended, in words."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from trocar.procs.document.process import Process
from trocar.procs.machine.paths import PACKAGE
from trocar.procs.node.setup_error import SETUP_FAILED
from trocar.procs.supervisor.os_process import OsProcess
from trocar.shm.system.loglines import parsed
from trocar.shm.time.clock import monotonic_ns


class ErrorPage:
    def __init__(self, error: str) -> None:
        self.error = error.encode()

    def field(self, _: str) -> dict[Any, bytes]:
        return {(): self.error}


@pytest.mark.parametrize(("code", "error", "words"), [
    (4, "ValueError: no", "exit code 4: ValueError: no"), (-9, "x", "killed by SIGKILL"),
    (4, "sys.exit(3) in box.py line 8", "sys.exit(3) in box.py line 8"),
])
def test_an_end_has_one_exit_code(code: int, error: str, words: str) -> None:
    process = cast("OsProcess", object.__new__(OsProcess))
    process.page = cast("Any", ErrorPage(error))
    assert process.in_words(code) == words


def test_a_process_that_finds_no_memory_ends_with_that_reason() -> None:
    process = cast("OsProcess", object.__new__(OsProcess))
    process.page, process.system, process.row = cast("Any", ErrorPage("")), "lab", Process("PSM1", "arm", 0.005)
    reason = process.in_words(SETUP_FAILED)
    assert "shared memory" in reason and "trocar logs PSM1 --system lab" in reason


def test_the_trace_of_a_process_that_hangs_belongs_to_an_entry_of_that_moment(tmp_path: Path) -> None:
    process = cast("OsProcess", object.__new__(OsProcess))
    process.popen, process.log = None, tmp_path / "box.log"
    begin_s = monotonic_ns() * 1e-9
    process.trace()
    with process.log.open("a") as log:
        log.write('Stack (most recent call first):\n  File "box.py", line 21 in update\n')
    assert parsed(process.log.read_text().splitlines()[0]).monotonic_s >= begin_s - 1e-6
    assert process.where() == "box.py line 21 in update"


@pytest.mark.parametrize(("files", "where"), [
    ((f"{PACKAGE}/shm/time/clock.py", "/lab/box.py", "/lab/loop.py", f"{PACKAGE}/procs/user/loop.py"), "box.py line 2"),
    ((np.__file__, json.__file__, "/lab/box.py", "<frozen runpy>"), "box.py line 3"),
    ((f"{PACKAGE}/procs/io/loop.py", "<frozen runpy>"), "loop.py line 1")])
def test_of_a_trace_the_innermost_line_of_the_users_code_is_told(
        files: tuple[str, ...], where: str, tmp_path: Path) -> None:
    process = cast("OsProcess", object.__new__(OsProcess))
    process.log, process._log_size = tmp_path / "box.log", 0
    lines = [f'  File "{file}", line {k} in step' for k, file in enumerate(files, 1)]
    process.log.write_text("\n".join(["Current thread 0x1 (most recent call first):", *lines, "", "Extension modules"]))
    assert process.where() == f"{where} in step"


def test_a_process_that_a_signal_has_stopped_is_known() -> None:
    process = cast("OsProcess", object.__new__(OsProcess))
    with subprocess.Popen(["sleep", "60"]) as process.popen:
        try:
            assert not process.is_stopped
            process.popen.send_signal(signal.SIGSTOP)
            os.waitpid(process.popen.pid, os.WUNTRACED)
            assert process.is_stopped
        finally:
            process.popen.kill()
