"""tools/start and tools/test before anything is installed: one line that says what is missing and what helps."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("sh", "dirname", "cat", "cksum")


@pytest.mark.parametrize(("word", "code"), [("--help", 0), ("-h", 0), ("rclpy", 2)])
def test_who_asks_what_peers_installs_gets_nothing_installed(word: str, code: int, tmp_path: Path) -> None:
    shutil.copy(ROOT / "tools" / "peers", tmp_path / "peers")
    found = subprocess.run([tmp_path / "peers", word], capture_output=True, text=True, check=False)
    assert found.returncode == code and (".venv-ros" in found.stdout) == (code == 0)
    assert list(tmp_path.iterdir()) == [tmp_path / "peers"]


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


def echoing(folder: Path) -> str:
    """Make a `.venv` there whose python prints its arguments; returns what marks the requirements as installed."""
    fake = folder / ".venv" / "bin"
    fake.mkdir(parents=True)
    (fake / "python").write_text('#!/bin/sh\necho "$@"\n')
    (fake / "python").chmod(0o755)
    return subprocess.run("cat pyproject.toml constraints.txt | cksum", shell=True, cwd=folder, text=True,
                          capture_output=True, check=True).stdout


def test_peers_installs_ros_first_and_says_what_only_root_can_install(tmp_path: Path) -> None:
    environment = bare(tmp_path, 'case "$2" in venv) mkdir -p "$3/bin"; cp "$0" "$3/bin/python";; esac\n'
                                 'case "$1" in -c) pwd;; *) echo "$0 $*";; esac')
    shutil.copy(ROOT / "tools" / "peers", tmp_path / "tools")
    echoing(tmp_path)
    for name in ("mkdir", "cp"):
        (tmp_path / "bin" / name).symlink_to(str(shutil.which(name)))
    for name, text in (("id", "echo 1000"), ("apt-get", "echo E: Could not open lock file >&2; exit 100")):
        (tmp_path / "bin" / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / "bin" / name).chmod(0o755)
    done = ask(tmp_path, "peers", environment)
    installed = [line for line in done.stdout.splitlines() if " pip install " in line]
    assert ["rclpy" in line for line in installed] == [True, False] and "ray" in installed[1], done
    assert done.returncode == 0 and done.stderr == (
        "no Octave; only root can install it: apt-get install octave octave-instrument-control\n")


def test_an_installed_project_starts_at_once_and_passes_arguments_on(tmp_path: Path) -> None:
    environment = bare(tmp_path, "exit 1")
    wanted = echoing(tmp_path)
    (tmp_path / ".venv" / ".trocar").write_text(wanted)
    for words, meant in (("", "demo"), ("--clock wall --for 3", "demo --clock wall --for 3"), ("--json", "demo --json"),
                         ("up --for 3", "up --for 3"), ("--version", "--version"), ("-h", "-h")):
        command = [tmp_path / "tools" / "start", *words.split()]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout == f"-P -m trocar {meant}\n"


def test_what_the_tests_have_installed_is_enough_to_start(tmp_path: Path) -> None:
    environment = bare(tmp_path, "exit 1")
    wanted = echoing(tmp_path)
    (tmp_path / ".venv" / ".trocar[dev,bench]").write_text(wanted)
    assert ask(tmp_path, "start", environment).stdout == "-P -m trocar demo\n"
    (tmp_path / ".venv" / ".trocar[dev,bench]").write_text("of other requirements\n")
    assert ask(tmp_path, "start", environment).returncode == 1  # it would be made anew, and there is no Python for that


@pytest.mark.parametrize("script", ["start", "test"])
def test_a_broken_python_that_was_chosen_is_refused(tmp_path: Path, script: str) -> None:
    environment = bare(tmp_path, "exit 0")
    done = ask(tmp_path, script, {**environment, "TROCAR_PYTHON": "/nowhere/python3"})
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1 and "TROCAR_PYTHON=/nowhere/python3" in done.stderr


PIP = """#!/bin/sh
case "$*" in
    *pip*) echo "Collecting numpy"; echo "  details"; echo "Installing collected packages: numpy"; echo "a word" >&2
           exit ${PIP_CODE:-0} ;;
    *) echo started ;;
esac
"""


@pytest.mark.parametrize("code", [0, 1])
def test_an_installation_says_what_it_is_at_and_how_it_ended(tmp_path: Path, code: int) -> None:
    environment = bare(tmp_path, "exit 0")
    fake = tmp_path / ".venv" / "bin" / "python"
    fake.parent.mkdir(parents=True)
    fake.write_text(PIP)
    fake.chmod(0o755)
    done = ask(tmp_path, "start", {**environment, "PIP_CODE": str(code)})
    reported = done.stderr.splitlines()
    assert set(reported[1:4]) == {"Collecting numpy", "Installing collected packages: numpy", "a word"}
    assert (done.returncode, done.stdout) == ((0, "started\n") if code == 0 else (1, ""))
    assert ("the installation failed" in done.stderr) == (code == 1)


def test_relative_files_are_those_of_the_callers_folder(tmp_path: Path) -> None:
    home, elsewhere = tmp_path / "home", tmp_path / "elsewhere"
    home.mkdir()
    elsewhere.mkdir()
    environment = bare(home, "exit 1")
    fake = home / ".venv" / "bin" / "python"
    fake.parent.mkdir(parents=True)
    fake.write_text(f'#!/bin/sh\nexport PYTHONPATH="{ROOT}"\nexec "{sys.executable}" "$@"\n')
    fake.chmod(0o755)
    wanted = subprocess.run("cat pyproject.toml constraints.txt | cksum", shell=True, cwd=home, text=True,
                            capture_output=True, check=True).stdout
    (home / ".venv" / ".trocar").write_text(wanted)
    (elsewhere / "tools.py").write_text("raise SystemExit('a module of the caller')")
    (elsewhere / "mine.yaml").write_text('$id: "dvrk-sistem.schema.json"')
    done = subprocess.run([home / "tools" / "start", "check", "mine.yaml"], cwd=elsewhere, env=environment,
                          capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1 and "mine.yaml:1: error: $id" in done.stdout, done.stderr
