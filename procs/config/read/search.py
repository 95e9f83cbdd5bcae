"""The search for configuration files: folders in order, and alternative names."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os.path import lexists
from pathlib import Path, PurePosixPath

from trocar.procs.machine.paths import PROJECT_CONFIGS

_PID_STOCK = "sawControllersPID-"


@dataclass(frozen=True, slots=True)
class SearchPath:
    """Folders in order of precedence; the last one is the project's own `configs/`."""

    folders: tuple[Path, ...]

    def first(self, *folders: Path) -> SearchPath:
        """The same path with `folders` directly after the working folder (which stays first)."""
        return SearchPath(_unique((self.folders[0], *folders, *self.folders[1:])))

    def find(self, *names: str) -> Path | None:
        """The first of `names` that exists: each name in all folders, then its alternatives.

        If there is no such file, but a folder, named pipe or dangling link of that name, its path: the error of reading
        explains it.
        """
        for name in names:
            found = self._exact(name, _is_file)
            if found:
                return found
        for name in names:
            for other in _other_names(name):
                found = self._exact(other, _is_file)
                if found:
                    return found
        there = (self._exact(name, lexists) for name in names if name)
        return next((path for path in there if path), None)

    def find_all(self, name: str) -> tuple[Path, ...]:
        """All files called `name`, or its YAML alternative, in order; at most one per folder."""
        hits = []
        for folder in self.folders:
            for candidate in (name, *_other_names(name)):
                if _is_file(folder / candidate):
                    hits.append(folder / candidate)
                    break
        return tuple(hits)

    def nearest(self, name: str) -> str:
        """The existing file whose name is most similar to `name`; "" when none is close."""
        inner, wanted = PurePosixPath(name).parent, PurePosixPath(name).name
        there = [entry for folder in self.folders for entry in _names_in(folder / inner)]
        close = difflib.get_close_matches(wanted, there, n=1, cutoff=0.75)
        return str(inner / close[0]) if close else ""

    def __str__(self) -> str:
        return ", ".join(str(folder) for folder in self.folders)

    def _exact(self, name: str, fits: Callable[[Path], bool]) -> Path | None:
        direct = expanded(name)
        if direct.is_absolute():
            return direct if fits(direct) else None
        return next((folder / name for folder in self.folders if fits(folder / name)), None)


def search_path(folders: tuple[Path, ...]) -> SearchPath:
    """A search path without repetitions."""
    return SearchPath(_unique(folders))


def search_beside(files: Sequence[Path], search: Sequence[Path], configs: Path = PROJECT_CONFIGS) -> SearchPath:
    """Where to search for files named in `files`: working folder, their folders, each `--path` (`search`), `configs`.
    """
    return search_path((Path.cwd(), *(file.parent for file in files), *search, configs))


def _names_in(folder: Path) -> list[str]:
    try:
        return sorted(entry.name for entry in folder.iterdir())
    except OSError:
        return []


def expanded(name: str) -> Path:
    """A path with `~` expanded; unchanged if the user is unknown."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)


def _is_file(path: Path) -> bool:
    """Whether a path is a file; False if that cannot be determined (too long, no permission)."""
    try:
        return path.is_file()
    except OSError:
        return False


def _unique(folders: tuple[Path, ...]) -> tuple[Path, ...]:
    seen: dict[Path, Path] = {}
    for folder in folders:
        seen.setdefault(folder.resolve(), folder)
    return tuple(seen.values())


def _other_names(name: str) -> tuple[str, ...]:
    """Alternatives: `x/PSM.yaml` for `x/PSM.json`, and `pid/PSM.yaml` for `pid/sawControllersPID-PSM.json`."""
    path = PurePosixPath(name)
    if path.suffix != ".json":
        return ()
    twin = path.with_suffix(".yaml")
    if twin.name.startswith(_PID_STOCK):
        return (str(twin), str(twin.with_name(twin.name.removeprefix(_PID_STOCK))))
    return (str(twin),)
