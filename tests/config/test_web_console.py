"""The web console in a system file."""

from __future__ import annotations

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.document.bridges import WebConsole
from trocar.procs.document.process import ON_DEMAND
from trocar.procs.document.system import from_json, to_json


def attach(home: Home, text: str) -> None:
    """The system's file with this `gui`."""
    file = home.path / SYSTEM
    file.write_text(file.read_text().replace("\ntrocar:\n", f"\ntrocar:\n  gui: {text}\n"))


def test_without_more_it_is_for_this_machine_alone(home: Home) -> None:
    attach(home, "{max_clients: 16}")
    loaded = home.load()
    assert loaded.system is not None and loaded.system.gui == WebConsole(("127.0.0.1:8080",))
    row = loaded.system.process("gui")
    assert (row.start, row.listen) == (ON_DEMAND, ("127.0.0.1:8080",))
    assert from_json(to_json(loaded.system)) == loaded.system


def test_a_system_without_it_has_none(home: Home) -> None:
    loaded = home.load()
    assert loaded.system is not None and loaded.system.gui is None
    assert "gui" not in [row.name for row in loaded.system.processes]


@pytest.mark.parametrize(("text", "words"), [
    ("{listen: '[::]:8080', tls: {certificate: a, key: b}}", "no file a"), ("{token_file: nowhere}", "no file nowhere"),
    ("{max_clients: 0}", "out of range"), ("{port: 8080}", "port")])
def test_mistakes_of_a_web_console_are_told(home: Home, text: str, words: str) -> None:
    attach(home, text)
    assert any(words in str(error) for error in home.load().errors), home.load().errors


def test_who_may_take_control_from_elsewhere_is_said(home: Home) -> None:
    (home.path / "gui.token").write_text("0123456789abcdef")
    attach(home, "{listen: 0.0.0.0:8080, token_file: ../gui.token}")
    loaded = home.load()
    assert loaded.system is not None, loaded.errors
    assert "gui: the robot in a browser: http://0.0.0.0:8080" in loaded.system.notes
    assert "gui: clients with the token may take control at 0.0.0.0:8080" in loaded.system.notes


def test_a_token_is_made_at_start_where_others_may_come_and_nothing_says_who(home: Home) -> None:
    attach(home, "{listen: ['127.0.0.1:8080', '0.0.0.0:8081', '[::]:8082']}")
    loaded = home.load()
    assert loaded.system is not None, loaded.errors
    gui = loaded.system.gui
    assert gui is not None and gui.makes_token
    assert gui.links("abc", "robot.lab") == ["http://127.0.0.1:8080", "http://robot.lab:8081/?token=abc",
                                             "http://127.0.0.1:8081", "http://robot.lab:8082/?token=abc",
                                             "http://[::1]:8082"]
    assert any("made at each start" in note for note in loaded.system.notes)
    assert from_json(to_json(loaded.system)) == loaded.system
