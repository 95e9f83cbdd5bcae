"""A copy of the demo's files that a test may spoil."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from trocar.procs.config import PROJECT_CONFIGS, FileProblem, Loaded, load_system

SYSTEM = "systems/demo.yaml"
Section = Mapping[str, object]


@dataclass(frozen=True)
class Home:
    """A folder like configs/."""

    path: Path

    def edit(self, name: str, old: str, new: str, count: int = 1) -> int:
        """Replace the first `old` of a file; the line it was in."""
        file = self.path / name
        text = file.read_text()
        assert old in text, f"{old!r} is not in {name}"
        file.write_text(text.replace(old, new, count))
        return text[: text.index(old)].count("\n") + 1

    def load(self, file: str = SYSTEM, **options: object) -> Loaded:
        return load_system(self.path / file, configs=self.path, **options)  # type: ignore[arg-type]

    def error(self, **options: object) -> FileProblem:
        """The only error there is."""
        loaded = self.load(**options)
        assert loaded.system is None
        assert len(loaded.errors) == 1, [str(problem) for problem in loaded.errors]
        return loaded.errors[0]

    def warning(self, **options: object) -> FileProblem:
        """The only warning there is, of files without errors."""
        loaded = self.load(**options)
        assert loaded.system is not None, loaded.errors
        (warning,) = loaded.warnings
        return warning

    def emulate(self, section: Section, hardware: str = "QLA1", **keys: object) -> Loaded:
        """The demo on this hardware with this emulation section; the keys are those of its IO."""
        file = self.path / "io/PSM1-demo.yaml"
        file.write_text(file.read_text().replace("hardware_version: QLA1", f"hardware_version: {hardware}"))
        io = {"name": "IO1", "port": "udp", **keys}
        arm = {"name": "PSM1", "type": "PSM", "serial": "demo", "IO": "IO1", "arm_file": "arms/PSM1-demo.yaml",
               "IO_file": "io/PSM1-demo.yaml", "PID_file": "pid/PSM.yaml"}
        return self.load_made({"IOs": [io], "arms": [arm], "trocar": {"boards": "emulated", "emulation": section}})

    def load_made(self, system: Section, boards: str | None = None) -> Loaded:
        """A system file with these keys, made.json."""
        head = {"$id": "dvrk-system.schema.json", "$version": "1"}
        (self.path / "made.json").write_text(json.dumps({**head, **system}, indent=1))
        return self.load("made.json", boards=boards)


@pytest.fixture(scope="session")
def own_files() -> dict[str, bytes]:
    """The project's own files: written to each home, which takes a sixth of the time of copies."""
    files = (path for path in PROJECT_CONFIGS.rglob("*") if path.is_file())
    return {path.relative_to(PROJECT_CONFIGS).as_posix(): path.read_bytes() for path in files}


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_files: dict[str, bytes]) -> Home:
    for folder in {os.path.dirname(name) for name in own_files}:  # noqa: PTH120  # for hundreds of tests
        (tmp_path / "home" / folder).mkdir(parents=True, exist_ok=True)
    for name, content in own_files.items():
        with open(f"{tmp_path}/home/{name}", "wb") as file:  # noqa: PTH123
            file.write(content)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return Home(tmp_path / "home")
