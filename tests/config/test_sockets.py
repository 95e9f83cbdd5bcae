"""The socket bridge in a system file: what it may say, and what is missing."""

from __future__ import annotations

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.document.bridges import Rights, SocketBridge
from trocar.procs.document.process import ON_DEMAND


def attach(home: Home, text: str) -> None:
    """The system's file with this `socket`."""
    file = home.path / SYSTEM
    file.write_text(file.read_text().replace("\ntrocar:\n", f"\ntrocar:\n  socket: {text}\n"))


def test_without_more_it_listens_on_this_machine(home: Home) -> None:
    attach(home, "{max_clients: 64}")
    loaded = home.load()
    assert loaded.system is not None and loaded.system.socket == SocketBridge(("127.0.0.1:7380",))
    row = loaded.system.process("socket_bridge")
    assert (row.start, row.listen) == (ON_DEMAND, ("127.0.0.1:7380",))


@pytest.mark.parametrize(("text", "words"), [
    ("{listen: 0.0.0.0:7380}", "anyone could connect to 0.0.0.0:7380"),
    ("{listen: [127.0.0.1:7380, '[::]:7381'], tls: {certificate: a, key: b}}", "anyone could connect to [::]:7381"),
    ("{token_file: nowhere}", "no file nowhere"), ("{grants: all}", "grants"),
    ("{listen: here}", "IP address and port"), ("{tls: {certificate: a}}", "key"),
    ("{max_clients: 0}", "out of range")])
def test_mistakes_are_told(home: Home, text: str, words: str) -> None:
    attach(home, text)
    assert any(words in str(error) for error in home.load().errors), home.load().errors


def test_rights_go_by_the_address_unless_said() -> None:
    bridge = SocketBridge(("127.0.0.1:1", "0.0.0.0:1"))
    assert bridge.rights_at("127.0.0.1:1") == bridge.rights_at("[::1]:1") == Rights(True, True, True)
    assert bridge.rights_at("0.0.0.0:1") == bridge.rights_at("192.0.2.1:1") == Rights(False, False, False)
    said = SocketBridge(("0.0.0.0:1",), grants="command")
    assert said.rights_at("0.0.0.0:1") == Rights(False, True, False)
    assert SocketBridge((), grants="view", may_power=True).rights_at("127.0.0.1:1") == Rights(True, False, False)


def test_that_it_listens_to_other_machines_is_said(home: Home) -> None:
    (home.path / "token").write_text("0123456789abcdef")
    attach(home, "{listen: 0.0.0.0:7380, token_file: token, grants: command}")
    loaded = home.load()
    assert loaded.system is not None and loaded.system.socket is not None
    assert loaded.system.socket.token_file == str((home.path / "token").absolute())
    notes = [note for note in loaded.system.notes if "socket_bridge" in note]
    assert notes == ["socket_bridge: listens to other machines at 0.0.0.0:7380",
                     "socket_bridge: clients at 0.0.0.0:7380 may command"]
