"""The token that is made at start for browsers on other machines."""

from __future__ import annotations

import dataclasses
import errno
import stat
from pathlib import Path

import pytest

from trocar.procs.document.bridges import WebConsole
from trocar.procs.document.system import SystemConfig
from trocar.procs.machine.access import token_in
from trocar.procs.machine.paths import NoStateFolder, token_file
from trocar.procs.supervisor import gui_token as gui_token_module
from trocar.procs.supervisor.gui_token import gui_token, told


def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **changed: object) -> tuple[SystemConfig, Path]:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    gui = dataclasses.replace(WebConsole(("10.0.0.1:8080",), makes_token=True), **changed)  # type: ignore[arg-type]
    document = SystemConfig("lab", "made by a test", "wall", (), (), None, (), gui=gui)
    return document, token_file({"TROCAR_STATE": str(tmp_path)}, "lab")


def test_it_is_another_one_each_time_and_nobody_else_can_read_it(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document, path = served(tmp_path, monkeypatch)
    seen = set()
    for _ in range(3):
        with gui_token(document):
            seen.add(token_in(str(path)))
            assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert not path.exists()
    assert len(seen) == 3 and all(len(token) == 32 for token in seen)


def test_what_was_left_or_put_there_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document, path = served(tmp_path, monkeypatch)
    path.parent.mkdir()
    (elsewhere := tmp_path / "elsewhere").write_text("0123456789abcdef")
    path.symlink_to(elsewhere)
    with gui_token(document):
        assert not path.is_symlink() and path.read_text() != elsewhere.read_text() == "0123456789abcdef"


def test_a_full_disk_is_named_with_the_setting_that_helps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document, path = served(tmp_path, monkeypatch)

    def full(count: int) -> str:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(gui_token_module.secrets, "token_hex", full)
    with pytest.raises(NoStateFolder, match="No space left on device; set TROCAR_STATE"), gui_token(document):
        pass
    assert not path.exists()


def test_it_is_printed_on_a_terminal_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document, path = served(tmp_path, monkeypatch)
    with gui_token(document):
        token = path.read_text().strip()
        assert f"http://10.0.0.1:8080/?token={token}" in told(document, to_a_terminal=True)
        elsewhere = told(document, to_a_terminal=False)
        assert str(path) in elsewhere and token not in elsewhere
    document, path = served(tmp_path, monkeypatch, makes_token=False)
    with gui_token(document):
        assert not path.exists() and told(document, to_a_terminal=True) == ""
