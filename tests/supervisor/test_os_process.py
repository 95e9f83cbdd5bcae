"""How a process ended, in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import pytest

from trocar.procs.supervisor.os_process import OsProcess
from trocar.shm.system.loglines import parsed
from trocar.shm.time.clock import monotonic_ns


class ErrorPage:
    def __init__(self, error: str) -> None:
        self.error = error.encode()

    def field(self, _: str) -> dict[Any, bytes]:
        return {(): self.error}


@pytest.mark.parametrize(("code", "error", "words"), [
    (4, "ValueError: no", "exit code 4: ValueError: no"), (3, "", "exit code 3"), (-9, "x", "killed by SIGKILL"),
    (4, "sys.exit(3) in box.py line 8", "sys.exit(3) in box.py line 8"),
])
def test_an_end_has_one_exit_code(code: int, error: str, words: str) -> None:
    process = cast("OsProcess", object.__new__(OsProcess))
    process.page = cast("Any", ErrorPage(error))
    assert process.in_words(code) == words


def test_the_trace_of_a_process_that_hangs_belongs_to_an_entry_of_that_moment(tmp_path: Path) -> None:
    process = cast("OsProcess", object.__new__(OsProcess))
    process.popen, process.log = None, tmp_path / "box.log"
    begin_s = monotonic_ns() * 1e-9
    process.trace()
    with process.log.open("a") as log:
        log.write('Stack (most recent call first):\n  File "box.py", line 21 in update\n')
    assert parsed(process.log.read_text().splitlines()[0]).monotonic_s >= begin_s - 1e-6
    assert process.where() == "box.py line 21 in update"
