"""How a process ended, in words."""

from __future__ import annotations

from typing import Any, cast

import pytest

from trocar.procs.supervisor.os_process import OsProcess


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
