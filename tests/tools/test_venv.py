"""tools/venv.sh with fake Pythons: the one that it chooses, when it makes .venv again, its reports."""

from __future__ import annotations

import fcntl
import os
import pty
import subprocess
from pathlib import Path

import pytest

from tests.tools.fake_python import ProjectCopy
from trocar.procs.machine.extras import PACKAGES


@pytest.fixture
def copy(tmp_path: Path) -> ProjectCopy:
    return ProjectCopy(tmp_path / "a folder")


@pytest.mark.parametrize(("pythons", "machine", "chosen", "reported"), [
    ("3.11 3.12", "x86_64", "3.12 [demo]", "newest"),
    ("3.10 3.13 3.14", "x86_64", "3.13 [demo]", "no package for 3.14"),
    ("3.14", "x86_64", "3.14 [demo]", "without the ROS bridge"),
    ("3.12 3.13", "aarch64", "3.13 [demo]", "on aarch64"),
    ("3.12 3.13:bare", "x86_64", "3.12 [demo]", "3.12"),
    ("3.15 3.11", "x86_64", "3.11 [demo]", "3.11"),
])
def test_the_newest_python_with_all_packages_is_chosen(copy: ProjectCopy, pythons: str, machine: str, chosen: str,
                                                       reported: str) -> None:
    copy.program("uname", f"echo {machine}")
    for each in pythons.split():
        copy.python(*each.split(":"))
    done = copy.ask()
    assert copy.installed() == [chosen] and done.stdout == "-P -m trocar demo\n", done
    assert done.stderr.count("\n") == 1 and reported in done.stderr and "first use" in done.stderr
    assert copy.ask().stderr == "" and copy.installed() == []


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_the_choice_agrees_with_the_table_of_packages(copy: ProjectCopy, machine: str) -> None:
    copy.program("uname", f"echo {machine}")
    ros = PACKAGES["cyclonedds"]
    for minor in (11, 12, 13, 14):
        chosen = copy.python(f"3.{minor}")
        reported = copy.ask(TROCAR_PYTHON=str(chosen)).stderr
        has_ros = machine in ros.machines and ros.before is not None and (3, minor) < ros.before
        assert ("without the ROS bridge" not in reported) == has_ros, reported


@pytest.mark.parametrize("script", ["start", "test"])
@pytest.mark.parametrize(("python", "chosen", "reported"), [
    ("3.9.2", "", ["3.11", "3.9.2", "apt-get install"]),
    ("3.13:bare", "", ["apt-get install python3.13-venv"]),
    ("3.12", "/nowhere/python3", ["TROCAR_PYTHON=/nowhere/python3"]),
])
def test_a_python_that_cannot_be_used_is_reported_in_one_line(copy: ProjectCopy, script: str, python: str, chosen: str,
                                                              reported: list[str]) -> None:
    copy.python(*python.split(":"))
    done = copy.ask(script, TROCAR_PYTHON=chosen)
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert all(each in done.stderr for each in reported), done.stderr


def test_another_python_can_be_chosen_at_any_time(copy: ProjectCopy) -> None:
    older = str(copy.python("3.11"))
    copy.python("3.13")
    for _ in range(2):
        assert copy.ask(TROCAR_PYTHON=older).returncode == 0
    assert copy.ask().returncode == 0
    assert copy.installed() == ["3.11 [demo]"]
    assert "3.13, python3.13;" in copy.ask(TROCAR_PYTHON="python3.13").stderr
    assert copy.installed() == ["3.13 [demo]"]
    copy.ask(TROCAR_PYTHON="python3.11")
    (copy.folder / "constraints.txt").write_text("numpy==1\n")
    assert "with Python 3.11" in copy.ask().stderr, "it stays selected"


def test_scripts_that_end_at_errors_find_a_python_behind_a_missing_one(copy: ProjectCopy) -> None:
    copy.python("3.12")
    script = f'set -eu; root=x; . "{copy.folder}/tools/venv.sh" >/dev/null; trocar_choose || exit 1; echo "$version"'
    done = subprocess.run(["/bin/sh", "-c", script, str(copy.folder / "tools/wheel")], env=copy.environment,
                          capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "3.12\n"), done.stderr


def test_changed_requirements_remove_packages_and_keep_extras(copy: ProjectCopy) -> None:
    copy.python("3.13")
    copy.ask()
    copy.ask("test")
    assert copy.installed() == ["3.13 [demo]", "3.13 [bench,demo,dev]"]
    stale = copy.folder / ".venv" / "lib" / "python" / "site-packages" / "stale-1.dist-info"
    stale.mkdir()
    with (copy.folder / "pyproject.toml").open("a") as file:
        file.write("# a setting of a tool\n")
    assert copy.ask().stderr == "" and stale.exists()
    with (copy.folder / "constraints.txt").open("a") as file:
        file.write("added==1\n")
    assert "requirements changed" in copy.ask().stderr
    assert copy.installed() == ["3.13 [bench,demo,dev]"] and not stale.exists()
    assert sorted(path.name for path in copy.folder.glob(".venv*")) == [".venv", ".venv.lock", ".venv.log"]


@pytest.mark.parametrize("lost", ["lib/python/site-packages/numpy-2.dist-info", "bin/python", ".trocar", ""])
def test_a_broken_environment_is_made_again(copy: ProjectCopy, lost: str) -> None:
    copy.python("3.13")
    copy.ask()
    (copy.folder / ".venv" / lost).rename(copy.folder.parent / "lost")
    done = copy.ask()
    assert done.stdout == "-P -m trocar demo\n" and copy.installed() == 2 * ["3.13 [demo]"]
    assert (Path(lost).name if "/" in lost else "first use") in done.stderr


def test_a_project_that_has_moved_gets_an_environment_for_its_folder(copy: ProjectCopy) -> None:
    copy.python("3.13")
    copy.ask()
    copy.folder = copy.folder.rename(copy.folder.with_name("moved"))
    copy.ask()
    assert (copy.folder / ".venv/bin/trocar").read_text() == f"#!{copy.folder}/.venv/bin/python\n"


def test_a_failed_installation_names_its_log_and_leaves_the_old_environment(copy: ProjectCopy) -> None:
    copy.python("3.13")
    copy.ask()
    (copy.folder / "constraints.txt").write_text("")
    (copy.folder / ".venv-new").mkdir()  # of an interrupted one
    done = copy.ask(PIP_CODE="2")
    log = copy.folder / ".venv.log"
    assert (done.returncode, done.stdout) == (1, "") and done.stderr.count("\n") == 2
    assert "ERROR: no numpy" in done.stderr and str(log) in done.stderr and "details" not in done.stderr
    assert {"  details", "a word"} < set(log.read_text().splitlines())
    assert (copy.folder / ".venv/bin/trocar").exists()
    done = copy.ask(PIP_CODE="1", PIP_SAYS="Retrying after connection broken by ConnectTimeoutError\n"
                    "ERROR: No matching distribution found for numpy")
    assert "no connection" in done.stderr
    assert copy.ask().returncode == 0


def test_a_terminal_shows_what_is_installed(copy: ProjectCopy) -> None:
    copy.python("3.13")
    ours, terminal = pty.openpty()
    subprocess.run([copy.folder / "tools/start"], env=copy.environment, stdout=subprocess.DEVNULL, stderr=terminal,
                   timeout=60, check=True)
    shown = os.read(ours, 4096).decode()
    assert "Collecting numpy" in shown and "details" not in shown and "ERROR" not in shown
    os.close(terminal)
    os.close(ours)


def test_a_second_installation_waits_for_the_first(copy: ProjectCopy) -> None:
    copy.python("3.13")
    with (copy.folder / ".venv.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with subprocess.Popen([copy.folder / "tools/start"], env=copy.environment, stdout=subprocess.DEVNULL,
                              stderr=subprocess.PIPE, text=True) as second:
            assert second.stderr is not None and "waiting" in second.stderr.readline()
            assert copy.installed() == []
            fcntl.flock(lock, fcntl.LOCK_UN)
            assert second.wait(timeout=60) == 0
    assert copy.installed() == ["3.13 [demo]"]
