"""A plugin of pytest: which functions of the project does each test call, and how long does it take?

    python -m pytest -p tests.soak.called --called FOLDER tests/io

writes a file of JSON for each process of pytest to FOLDER: test to [seconds, {file: first lines of functions}].
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = str(ROOT) + os.sep
FOLDERS = ("procs/", "tests/soak/")
FOUND: dict[str, tuple[float, dict[str, list[int]]]] = {}
SEEN: set[CodeType] = set()


def _note(frame: FrameType, event: str, argument: Any) -> None:
    SEEN.add(frame.f_code)


def pytest_addoption(parser: pytest.Parser) -> None:
    """See pytest."""
    parser.addoption("--called", type=Path)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """See pytest."""
    SEEN.clear()
    begin = time.monotonic()
    threading.settrace(_note)
    sys.settrace(_note)
    try:
        return (yield)
    finally:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]
        functions: dict[str, list[int]] = {}
        for code in SEEN:
            path = code.co_filename.removeprefix(HERE).removeprefix("trocar/")  # which holds links to folders
            if path.startswith(FOLDERS):
                functions.setdefault(path, []).append(code.co_firstlineno)
        FOUND[item.nodeid] = time.monotonic() - begin, functions


def pytest_sessionfinish(session: pytest.Session) -> None:
    """See pytest."""
    if FOUND:
        folder = session.config.getoption("--called")
        (folder / f"{os.getpid()}.json").write_text(json.dumps(FOUND))
