"""Where a system keeps its logs and recordings, and what verbs say where nothing can be kept there."""

from __future__ import annotations

import os
import pwd
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, World
from tests.tools.robot import robot
from trocar.procs.machine.paths import NoStateFolder, log_folder, made_log_folder, made_recordings_folder
from trocar.procs.node.setup_error import explains_itself
from trocar.shm.memory.segment import names_of
from trocar.tools.inspect.machine import BAD, OK, state_folder


def trocar(home: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A verb in `folder` of somebody whose HOME this is."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("TROCAR_", "XDG_"))}
    return subprocess.run([sys.executable, "-P", "-m", "trocar", *words], cwd=folder, capture_output=True, text=True,
                          env={**environment, "HOME": str(home), "PYTHONPATH": str(ROOT)}, timeout=240, check=False)


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A HOME in which no folder can be made, not even by root."""
    file = tmp_path / "home"
    file.write_text("")
    return file


@pytest.mark.slow
@pytest.mark.parametrize("words", [
    ("up", "--detach"), ("up", "--set", "gui.listen=0.0.0.0:8099", "--for", "0"), ("demo", "--for", "1"),
    ("commission", "configs/systems/demo.yaml", "--boards", "emulated", "--yes")], ids=" ".join)
def test_a_system_that_can_keep_no_logs_is_not_started(words: tuple[str, ...], home: Path, tmp_path: Path,
                                                       world: World) -> None:
    done = trocar(home, tmp_path, *words, "--system", world.name)
    assert done.returncode == 1 and names_of(world.name) == []
    assert "Traceback" not in done.stderr and done.stderr.count("cannot keep") == 1, done.stderr
    assert str(home / ".local/state/trocar" / world.name) in done.stderr and "TROCAR_STATE" in done.stderr


@pytest.mark.slow
def test_a_dump_that_has_no_place_says_what_to_set(home: Path, tmp_path: Path, world: World) -> None:
    with robot(world.name):
        done = trocar(home, tmp_path, "dump", "--system", world.name)
        assert done.returncode == 1 and "Traceback" not in done.stderr and "TROCAR_STATE" in done.stderr, done.stderr


def test_the_variables_choose_the_folder_in_their_order(tmp_path: Path) -> None:
    given = {"HOME": "/home/lab"}
    assert log_folder(given, "lab") == Path("/home/lab/.local/state/trocar/lab")
    given["XDG_STATE_HOME"] = str(tmp_path / "xdg")
    assert made_log_folder(given, "lab") == tmp_path / "xdg/trocar/lab"
    given["TROCAR_STATE"] = str(tmp_path / "ours")
    assert made_log_folder(given, "lab") == tmp_path / "ours/lab" and (tmp_path / "ours/lab").is_dir()


def test_without_home_the_account_has_one_and_no_two_users_share_a_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    assert log_folder({}, "lab") == Path(pwd.getpwuid(os.getuid()).pw_dir) / ".local/state/trocar/lab"
    monkeypatch.setattr(os, "getuid", lambda: 64001)
    monkeypatch.setattr(pwd, "getpwuid", {}.__getitem__)  # no account
    assert log_folder({}, "lab") == Path("/tmp/trocar-64001/.local/state/trocar/lab")
    taken = Path("/tmp/trocar-64001")
    taken.mkdir()  # by another user
    try:
        with pytest.raises(NoStateFolder, match="TROCAR_STATE"):
            log_folder({}, "lab")
    finally:
        taken.rmdir()


def test_a_folder_of_others_is_no_place_for_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # as where its owner is another user
    with pytest.raises(NoStateFolder, match="TROCAR_STATE"):
        made_log_folder({"TROCAR_STATE": str(tmp_path)}, "lab")


@pytest.mark.parametrize("chosen", [True, False])
def test_recordings_that_have_no_place_say_which_setting_helps(chosen: bool, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    given = {"TROCAR_STATE": str(tmp_path / "file")}
    with pytest.raises(NoStateFolder, match="recorder.folder" if chosen else "TROCAR_STATE") as said:
        made_recordings_folder(given, "lab", str(tmp_path / "file") if chosen else "")
    assert explains_itself(said.value), "the log of the recorder has no trace of it"
    assert made_recordings_folder({}, "lab", str(tmp_path / "new")).is_dir()


@pytest.mark.slow
def test_a_system_whose_recordings_have_no_place_does_not_start(tmp_path: Path, world: World) -> None:
    (tmp_path / "file").touch()
    done = trocar(tmp_path, tmp_path, "up", "--detach", str(ROOT / "configs/systems/kinematic.yaml"), "--system",
                  world.name, "--set", f"recorder.folder={tmp_path / 'file'}", "--set", "recorder.on=true")
    assert done.returncode == 1 and names_of(world.name) == []
    assert "Traceback" not in done.stderr and "cannot keep recordings" in done.stderr, done.stderr
    assert "recorder.folder" in done.stderr


def test_doctor_looks_whether_logs_have_a_place_and_makes_none(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    wrong = state_folder({"TROCAR_STATE": str(tmp_path / "file")})
    assert wrong.state == BAD and "TROCAR_STATE" in wrong.mend
    assert state_folder({"TROCAR_STATE": str(tmp_path / "new" / "one")}).state == OK
    assert not (tmp_path / "new").exists()
