"""tools/start and tools/test before anything is installed: one line that says what is missing and what helps."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("sh", "dirname", "cat", "cksum")


def bare(folder: Path, python: str) -> dict[str, str]:
    """A copy of the scripts, and a PATH where `python3` is the given shell script and there is no other."""
    (folder / "tools").mkdir()
    for name in ("start", "test", "venv.sh"):
        shutil.copy(ROOT / "tools" / name, folder / "tools" / name)
    for name in ("pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, folder / name)
    programs = folder / "bin"
    programs.mkdir()
    for name in NEEDED:
        found = shutil.which(name)
        assert found is not None
        (programs / name).symlink_to(found)
    (programs / "python3").write_text(f"#!/bin/sh\n{python}\n")
    (programs / "python3").chmod(0o755)
    return {"PATH": str(programs), "HOME": os.environ.get("HOME", "/")}


def ask(folder: Path, script: str, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a script of the copy."""
    return subprocess.run([folder / "tools" / script], env=environment, capture_output=True, text=True, timeout=60,
                          check=False)


@pytest.mark.parametrize("script", ["start", "test"])
def test_an_old_python_is_told_in_one_line(tmp_path: Path, script: str) -> None:
    environment = bare(tmp_path, 'case "$1" in --version) echo Python 3.9.2;; *) exit 1;; esac')
    done = ask(tmp_path, script, environment)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "3.11" in done.stderr
    assert "3.9.2" in done.stderr
    assert "apt-get install" in done.stderr


@pytest.mark.parametrize("script", ["start", "test"])
def test_a_missing_venv_module_is_told_in_one_line(tmp_path: Path, script: str) -> None:
    environment = bare(tmp_path, 'case "$2" in *venv*) exit 1;; *) exit 0;; esac')
    done = ask(tmp_path, script, environment)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "apt-get install python3-venv" in done.stderr


def test_an_installed_project_starts_at_once_and_passes_arguments_on(tmp_path: Path) -> None:
    environment = bare(tmp_path, "exit 1")
    fake = tmp_path / ".venv" / "bin"
    fake.mkdir(parents=True)
    (fake / "python").write_text('#!/bin/sh\necho "$@"\n')
    (fake / "python").chmod(0o755)
    wanted = subprocess.run("cat pyproject.toml constraints.txt | cksum", shell=True, cwd=tmp_path, text=True,
                            capture_output=True, check=True).stdout
    (tmp_path / ".venv" / ".trocar").write_text(wanted)
    assert ask(tmp_path, "start", environment).stdout == "-m tools demo\n"
    command = [tmp_path / "tools" / "start", "up", "--for", "3"]
    assert subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout == (
        "-m tools up --for 3\n")
