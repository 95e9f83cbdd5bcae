"""Code blocks of documents, for tests that run them."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import yaml

from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig

ROOT = Path(__file__).resolve().parent.parent
SYSTEMS = ROOT / "configs" / "systems"


def blocks(page: str, language: str) -> list[str]:
    """The fenced blocks of a page of docs/ in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", _text(page), re.DOTALL | re.MULTILINE)


def typed(page: str) -> list[list[str]]:
    """The words of each line that a reader is to type; lines that end with a backslash are one with the next."""
    lines = re.findall(r"^    (\S.*)$", re.sub(r"\\\n\s*", " ", _text(page)), re.MULTILINE)
    return [shlex.split(line) for line in lines]


def _text(page: str) -> str:
    return (ROOT / "docs" / page).read_text(encoding="utf-8")


def system_of(words: list[str]) -> SystemConfig:
    """The system that a line with `trocar up` starts; there must be no problem with it."""
    assert words[:2] == ["trocar", "up"]
    options = dict.fromkeys(words[3::2], "")
    assert set(options) <= {"--set", "--path"}, "what other options do is not known here"
    return _whole(ROOT / words[2], [value for option, value in zip(words[3::2], words[4::2], strict=True)
                                    if option == "--set"])


def system_with(section: str, folder: Path) -> SystemConfig:
    """A system of ours with this section in its file; there must be no problem with it."""
    file = folder / "page.yaml"
    file.write_text(yaml.safe_dump(yaml.safe_load((SYSTEMS / "kinematic.yaml").read_text()) | yaml.safe_load(section)))
    return _whole(file, [])


def _whole(file: Path, sets: list[str]) -> SystemConfig:
    loaded = load_system(file, sets=sets, search=[ROOT / "configs"])
    assert loaded.system is not None and not loaded.errors and not loaded.warnings, (loaded.errors, loaded.warnings)
    return loaded.system
