"""tools/start and tools/peers; tests/tools/test_venv.py has the installation."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.tools.fake_python import ROOT, ProjectCopy


@pytest.mark.parametrize(("word", "code"), [("--help", 0), ("-h", 0), ("rclpy", 2)])
def test_who_asks_what_peers_installs_gets_nothing_installed(word: str, code: int, tmp_path: Path) -> None:
    shutil.copy(ROOT / "tools" / "peers", tmp_path / "peers")
    found = subprocess.run([tmp_path / "peers", word], capture_output=True, text=True, check=False)
    assert found.returncode == code and (".venv-ros" in found.stdout) == (code == 0)
    assert list(tmp_path.iterdir()) == [tmp_path / "peers"]


def test_peers_installs_ros_first_and_says_what_only_root_can_install(tmp_path: Path) -> None:
    copy = ProjectCopy(tmp_path / "trocar")
    shutil.copy(ROOT / "tools" / "peers", copy.folder / "tools")
    python = copy.program("python3", 'case "$2" in venv) mkdir -p "$3/bin"; cp "$0" "$3/bin/python";; esac\n'
                                     'case "$1" in -c) pwd;; *) echo "$0 $*";; esac')
    (copy.folder / ".venv" / "bin").mkdir(parents=True)
    shutil.copy(python, copy.folder / ".venv" / "bin")
    shutil.copy(python, copy.folder / ".venv" / "bin" / "python")
    copy.program("id", "echo 1000")
    copy.program("apt-get", "echo E: Could not open lock file >&2; exit 100")
    done = copy.ask("peers")
    installed = [line for line in done.stdout.splitlines() if " pip install " in line]
    for line, package in zip(installed, ("rclpy", "axe", "ray"), strict=True):
        assert package in line, done
    assert done.returncode == 0 and done.stderr == (
        "no Octave; only root can install it: apt-get install octave octave-instrument-control\n")


def test_an_installed_project_passes_arguments_on(tmp_path: Path) -> None:
    copy = ProjectCopy(tmp_path / "trocar")
    copy.python("3.13")
    for words, meant in (("", "demo"), ("--clock wall --for 3", "demo --clock wall --for 3"), ("--json", "demo --json"),
                         ("up --for 3", "up --for 3"), ("--version", "--version"), ("-h", "-h")):
        assert copy.ask("start", *words.split()).stdout == f"-P -m trocar {meant}\n"


@pytest.mark.slow
def test_relative_files_are_those_of_the_callers_folder(tmp_path: Path) -> None:
    copy = ProjectCopy(tmp_path / "home")
    copy.python("3.13")
    copy.ask()
    real = f'#!/bin/sh\nexport PYTHONPATH="{ROOT}"\nexec "{sys.executable}" "$@"\n'
    (copy.folder / ".venv/bin/python").write_text(real)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "tools.py").write_text("raise SystemExit('a module of the caller')")
    (elsewhere / "mine.yaml").write_text('$id: "dvrk-sistem.schema.json"')
    done = subprocess.run([copy.folder / "tools" / "start", "check", "mine.yaml"], cwd=elsewhere, env=copy.environment,
                          capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1 and "mine.yaml:1: error: $id" in done.stdout, done.stderr
