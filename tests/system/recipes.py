"""A copy of the program in which tests write what a person writes who adds something to its tables."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from tests.system.robot import ROOT

Recipe = Mapping[str, str | tuple[tuple[str, str], ...]]
"""By file: the text of a new one, or what is written before which line of one that is there."""


def tree_with(recipe: Recipe, folder: Path) -> Path:
    """The copy with these files in it; fails when a line that is looked for is not there once."""
    for name in ("procs", "shm", "tools", "configs", "trocar"):  # with bytecode, which each process would make again
        shutil.copytree(ROOT / name, folder / name, symlinks=True)
    for name, written in recipe.items():
        path = folder / name
        if isinstance(written, str):
            path.parent.mkdir(exist_ok=True)
            path.write_text(written)
            continue
        text = path.read_text()
        for line, added in written:
            assert text.count(line) == 1, f"{name}: {line}"
            text = text.replace(line, added + line)
        path.write_text(text)
    return folder
