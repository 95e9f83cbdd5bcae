"""A JSON file that replaces another one: completely or not at all, with the old content kept."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from trocar.tools.output.errors import Problem


def put(path: Path, text: str, check: Callable[[Path], object]) -> Path | None:
    """Write a file that `check` accepts; returns the copy of its old content, None: there was none.

    Problem if it cannot be written, or an exception of `check`; then nothing has changed.
    """
    fresh, kept = path.with_name(f".{path.stem}.{os.getpid()}.json"), None
    try:
        with fresh.open("x", encoding="utf-8") as out:
            out.write(text)
            out.flush()
            os.fsync(out.fileno())
        check(fresh)
        if path.exists():
            kept = _backup(path)
        fresh.replace(path)
    except OSError as bad:
        raise Problem(f"{path} cannot be written: {bad.strerror or bad}") from None
    finally:
        fresh.unlink(missing_ok=True)
    return kept


def _backup(path: Path) -> Path:
    """A copy under a name that nothing has."""
    number = 1
    while (kept := path.with_name(f"{path.name}.bak{number}")).exists():
        number += 1
    shutil.copy2(path, kept)
    return kept
