"""`trocar report`: what is packed, what is left out, and that no secret is in it."""

from __future__ import annotations

import gzip
import json
import os
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.conftest import World
from tests.recordings.made import a_recording
from tests.tools.robot import robot
from trocar.procs.machine.paths import token_file
from trocar.tools import cli
from trocar.tools.inspect.machine import OK, MachineFinding
from trocar.tools.systems import report_file as reporting

SYSTEM, TOKEN, OWN_TOKEN = "packed", "0123456789abcdef", "fedcba9876543210"


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of a system that is down: a log, a recording, tokens."""
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    monkeypatch.setattr(reporting, "findings", lambda: iter([MachineFinding("kernel", OK, "fine")]))
    folder = tmp_path / SYSTEM
    (folder / "recordings").mkdir(parents=True)
    theirs = tmp_path / "socket.token"
    theirs.write_text(f"{TOKEN}\n")
    token_file(os.environ, SYSTEM).write_text(OWN_TOKEN)
    (folder / "gui.log").write_text(f"open http://robot:8080/?token=verysecret&x=1\nit was {OWN_TOKEN}, or {TOKEN}.\n")
    document = json.dumps({"name": SYSTEM, "socket": {"token_file": str(theirs)}}).encode()
    a_recording(folder / "recordings", document=document)
    yield folder


def packed(file: Path) -> dict[str, bytes]:
    """Names without the folder, and contents."""
    found = {}
    with tarfile.open(file) as tar:
        for entry in tar:
            stream = tar.extractfile(entry)
            assert stream is not None
            found[entry.name.partition("/")[2]] = stream.read()
    return found


def asked(*words: str) -> tuple[int, str]:
    """Exit code and output of the verb."""
    result = CliRunner().invoke(cli.build("report"), ["report", *words])
    return result.exit_code, result.output


def test_logs_recordings_configuration_versions_and_doctor_are_in_it(state: Path, tmp_path: Path) -> None:
    file = tmp_path / "all.tar.gz"
    code, said = asked(str(file), "--system", SYSTEM)
    assert code == 0, said
    found = packed(file)
    assert set(found) == {"versions.json", "doctor.json", "configuration.json", "logs/gui.log", "recordings/one.mcap",
                          "CONTENTS.txt"}
    assert found["recordings/one.mcap"] == (state / "recordings" / "one.mcap").read_bytes()
    assert json.loads(found["configuration.json"])["name"] == SYSTEM
    assert any(row.startswith("numpy==") for row in json.loads(found["versions.json"])["packages"])
    assert json.loads(found["doctor.json"])["found"] == "fine"
    assert b"logs/gui.log" in found["CONTENTS.txt"]
    assert file.stat().st_mode & 0o077 == 0


def test_no_token_is_in_it(state: Path, tmp_path: Path) -> None:
    file = tmp_path / "all.tar.gz"
    asked(str(file), "--system", SYSTEM)
    everything = b"".join(gzip.decompress(file.read_bytes()).splitlines())
    assert b"[left out]" in everything
    for secret in (TOKEN, OWN_TOKEN, "verysecret"):
        assert secret.encode() not in everything


def test_what_has_no_room_is_left_out_and_said(state: Path, tmp_path: Path) -> None:
    file = tmp_path / "all.tar.gz"
    code, said = asked(str(file), "--system", SYSTEM, "--recordings", "0")
    assert code == 0 and "recordings/one.mcap is left out" in said
    assert not [name for name in packed(file) if name.endswith(".mcap")]


def test_a_file_that_is_there_is_not_touched(state: Path, tmp_path: Path) -> None:
    file = tmp_path / "all.tar.gz"
    file.write_text("mine")
    code, said = asked(str(file), "--system", SYSTEM)
    assert code == 1 and "is there already" in said and file.read_text() == "mine"


def test_a_system_that_never_was_is_told(state: Path, tmp_path: Path) -> None:
    code, said = asked(str(tmp_path / "all.tar.gz"), "--system", "never")
    assert code == 1 and "no system never is up" in said


def test_a_recording_that_goes_meanwhile_is_left_out(state: Path, tmp_path: Path) -> None:
    (state / "recordings" / "gone.mcap").symlink_to(tmp_path / "nowhere")
    code, said = asked(str(tmp_path / "all.tar.gz"), "--system", SYSTEM)
    assert code == 0, said


def test_what_is_in_memory_is_nobodys_to_read_meanwhile(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                         ) -> None:
    monkeypatch.setattr(reporting, "findings", lambda: iter(()))
    usual, modes = reporting.Report.copy, dict[str, int]()

    def copy(report: reporting.Report, name: str, path: Path) -> None:
        modes[name] = path.stat().st_mode & 0o777
        usual(report, name, path)

    monkeypatch.setattr(reporting.Report, "copy", copy)
    with robot(world.name) as made:
        made.show_arm()
        reporting.report(world.name, tmp_path / "all.tar.gz", 0, lambda text, done: None)
    assert modes == {"recordings/now.mcap": 0o600}
    assert [path.name for path in tmp_path.iterdir()] == ["all.tar.gz"]


def test_a_recording_that_cannot_be_read_is_told_and_the_others_are_packed(state: Path, tmp_path: Path) -> None:
    (state / "recordings" / "folder.mcap").mkdir()
    file = tmp_path / "all.tar.gz"
    _, said = asked(str(file), "--system", SYSTEM)
    assert "recordings/folder.mcap: Is a directory" in " ".join(said.split()), said
    assert "recordings/one.mcap" in packed(file)
