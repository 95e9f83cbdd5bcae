"""Searches through all interleavings run at a desk only if what they search has changed since all of them passed.

`tools/test -m searches` runs all; if all pass it writes the stamp, a digest for each file of searches, which is
committed. With TROCAR_SEARCHES=apart no run includes them that does not name them: CI runs them by themselves.
"""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

MARK = "searches"
APART = "TROCAR_SEARCHES"
ROOT = Path(__file__).resolve().parent.parent
STAMP = Path(__file__).with_name("searches.stamp")
MODELS = {"tests/shm/test_models.py": "tests/shm/models/*.pml"}  # read, not imported
TABLES = ("shm/topics.py", "shm/operator_topics.py")  # searches have topics of their own
passed: set[str] = set()
failed: set[str] = set()
left_out: set[str] = set()  # files of searches
changed: set[str] = set()


def stamped() -> dict[str, str]:
    """By file of searches, the digest on which all of them have passed."""
    text = STAMP.read_text() if STAMP.exists() else ""
    return {path: digest for digest, path in (line.split() for line in text.splitlines())}


@cache
def digest(path: str) -> str:
    """Of the file of searches, all that it imports of ours, and its models."""
    found, pending = {ROOT / path, *ROOT.glob(MODELS.get(path, path))}, [ROOT / path]
    while pending:
        new = _imported(pending.pop()) - found
        found |= new
        pending += new
    every = hashlib.sha256()
    for source in sorted(found):
        every.update(f"{source.relative_to(ROOT)}\0".encode() + source.read_bytes())
    return every.hexdigest()


@cache
def _imported(source: Path) -> set[Path]:
    found = set()
    for node in ast.walk(ast.parse(source.read_text())):
        names = [name.name for name in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
        if isinstance(node, ast.ImportFrom):
            names = [str(node.module), *(f"{node.module}.{name}" for name in names)]
        for name in names:
            path = name.removeprefix("trocar.").replace(".", "/") + ".py"
            if name.startswith(("trocar.", "tests.")) and (ROOT / path).is_file() and path not in TABLES:
                found.add(ROOT / path)
    return found


def done(config: pytest.Config, items: Iterable[pytest.Item]) -> list[pytest.Item]:
    """Those of the items that need not run."""
    if MARK in config.option.markexpr:
        return []
    found = [item for item in items if item.get_closest_marker(MARK) and not item.get_closest_marker("soak")]
    files, known = {_file(item.nodeid) for item in found}, stamped()
    changed.update(path for path in files if path not in known or known[path] != digest(path))
    left_out.update(files if os.environ.get(APART) == "apart" else files - changed)
    return [item for item in found if _file(item.nodeid) in left_out]


def _file(nodeid: str) -> str:
    return nodeid.split("::")[0]


def note(report: pytest.TestReport) -> None:
    """Look at a report of any test."""
    if MARK in report.keywords:
        if not report.passed:
            failed.add(_file(report.nodeid))
        elif report.when == "call":
            passed.add(_file(report.nodeid))


def remember(config: pytest.Config) -> None:
    """After a run that has passed: write the stamp if it was of all searches of these files, and none was skipped."""
    option = config.option
    part = option.keyword or option.deselect or getattr(option, "lf", False) or any("::" in a for a in config.args)
    if option.markexpr == MARK and not part and not hasattr(config, "workerinput"):
        now = stamped() | {path: digest(path) for path in passed - failed}
        STAMP.write_text("".join(f"{now[path]} {path}\n" for path in sorted(now) if (ROOT / path).exists()))


def summary() -> Iterator[str]:
    """What of them ran, or did not, and why."""
    if left_out:
        why = "they run by themselves" if left_out & changed else "they have passed on these sources"
        yield f"searches left out ({why}): {', '.join(sorted(left_out))}"
    if changed - left_out:
        yield (f"searches whose sources have changed: {', '.join(sorted(changed - left_out))}; "
               f"tools/test -m {MARK} runs them and writes {STAMP.relative_to(ROOT)}")
