"""Locations of a system's files outside shared memory, and the search for files named on a command line."""

from __future__ import annotations

import contextlib
import difflib
import os
import pwd
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).absolute().parents[2]
"""The folder of the package `trocar`."""
ROOT: Final = PACKAGE.parent
"""The folder that contains the package: a checkout, or the packages of an environment."""
PROJECT_CONFIGS: Final = (PACKAGE / "configs").resolve()
ADDS_FOLDER: Final = "--path FOLDER adds a folder"


STATE_REMEDY: Final = "set TROCAR_STATE to a folder that you can write"


class NoStateFolder(OSError):
    """Logs or recordings cannot be kept; the message names the setting to change."""


def log_folder(environ: Mapping[str, str], system: str) -> Path:
    """Folder of a system's log files: `TROCAR_STATE`, else `XDG_STATE_HOME/trocar`, else `~/.local/state/trocar`."""
    chosen = environ.get("TROCAR_STATE")
    if chosen:
        return Path(chosen) / system
    state = environ.get("XDG_STATE_HOME")
    root = Path(state) if state else _home(environ) / ".local" / "state"
    return root / "trocar" / system


def _home(environ: Mapping[str, str]) -> Path:
    """HOME, else the home of the user's account, else a folder in /tmp; NoStateFolder if another user has that."""
    if home := environ.get("HOME"):
        return Path(home)
    with contextlib.suppress(KeyError):
        return Path(pwd.getpwuid(os.getuid()).pw_dir)
    folder = Path(f"/tmp/trocar-{os.getuid()}")
    with contextlib.suppress(FileNotFoundError):
        if folder.lstat().st_uid != os.getuid():
            raise NoStateFolder(f"cannot keep logs and recordings in {folder}: it is another user's; {STATE_REMEDY}")
    return folder


def made_log_folder(environ: Mapping[str, str], system: str) -> Path:
    """The folder of log files, made and writable; otherwise NoStateFolder."""
    return _made(log_folder(environ, system), "logs and recordings", STATE_REMEDY)


def made_recordings_folder(environ: Mapping[str, str], system: str, chosen: str = "") -> Path:
    """The folder of recordings, made and writable; otherwise NoStateFolder."""
    return _made(recordings_folder(environ, system, chosen), "recordings",
                 "set recorder.folder to a folder that you can write" if chosen else STATE_REMEDY)


def _made(folder: Path, what: str, remedy: str) -> Path:
    why = why_not_writable(folder)
    try:
        if not why:
            folder.mkdir(parents=True, exist_ok=True)
            return folder
    except OSError as error:
        why = error.strerror or str(error)
    raise NoStateFolder(f"cannot keep {what} in {folder}: {why}; {remedy}")


def why_not_writable(folder: Path) -> str:
    """Why files cannot be made in a folder, which need not exist yet; empty if they can."""
    try:
        there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    except OSError as error:
        return error.strerror or str(error)
    if not there.is_dir():
        return f"{there} is no folder"
    return "" if os.access(there, os.W_OK | os.X_OK) else "no permission to write"


def token_file(environ: Mapping[str, str], system: str) -> Path:
    """The file of the web console's token that was made at the system's start; only its user can read it."""
    return log_folder(environ, system) / "gui.token"


def recordings_folder(environ: Mapping[str, str], system: str, chosen: str = "") -> Path:
    """Folder of a system's recordings: with its log files, or a folder in `chosen`, which is common to all systems."""
    return Path(chosen) / system if chosen else log_folder(environ, system) / "recordings"


def given_file(path: Path, search: Sequence[Path] = (), configs: Path = PROJECT_CONFIGS) -> Path:
    """A file named on a command line: as given, else along `search`, in `configs`, in its systems, or in its parent.

    If X.json is in none of them, X.yaml is searched, too. Returns `path` itself if there is no file: see `not_found`.
    """
    twins = (path, path.with_suffix(".yaml")) if path.suffix == ".json" else (path,)
    places = (folder / name for name in twins for folder in _folders(search, configs) if exists(folder / name))
    return next(places, path)


def not_found(path: Path, search: Sequence[Path] | None = None, configs: Path = PROJECT_CONFIGS) -> str:
    """The message for a file that was not found; `search`: folders from `--path`, None without that option."""
    if path.is_symlink():
        return dangling(path)
    folders = _folders(search or (), configs)
    there = {entry.stem: entry.name for folder in folders for entry in _entries(folder / path.parent) if exists(entry)}
    near = difflib.get_close_matches(path.stem, there, n=1, cutoff=0.6)
    hint = f" (did you mean {path.parent / there[near[0]]}?)" if near else ""
    places = dict.fromkeys(str(folder.absolute()) for folder in folders)
    looked = "" if path.is_absolute() else f"; looked in {', '.join(places)}"
    return f"no such file{hint}{looked}{f'; {ADDS_FOLDER}' if looked and search is not None else ''}"


def dangling(link: Path) -> str:
    """The message for a symbolic link to a file that does not exist."""
    return f"a link to {link.readlink()}, which does not exist"


def _folders(search: Sequence[Path], configs: Path) -> tuple[Path, ...]:
    return (Path(), *search, configs, configs / "systems", configs.parent)


def exists(path: Path) -> bool:
    """Whether a path exists; False if that cannot be determined (too long, no permission)."""
    try:
        return path.exists()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Whether a path is a folder; False if that cannot be determined."""
    try:
        return path.is_dir()
    except OSError:
        return False


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []
