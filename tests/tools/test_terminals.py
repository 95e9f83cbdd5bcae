"""Terminals and logs that are not UTF-8: each verb works, and no character ends it."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from tests.conftest import ROOT, World
from tests.tools.robot import ScriptedRobot, robot
from trocar.tools import cli
from trocar.tools.output.printing import LiveLine

Run = Callable[..., str]
REASON = "PSM1 joint 2: 3.5 ° → 4 °, Zürich ≥ 半"


@pytest.fixture
def spoken(world: World) -> Iterator[ScriptedRobot]:
    """A system whose arm reports a text that neither ASCII nor Latin-1 has."""
    with robot(world.name) as made:
        made.arm.field("reason")[...] = REASON.encode()
        made.show_arm(0.25, "FAULT")
        made.events.status(REASON, "PSM1")
        made.restarted(1, REASON)
        yield made


@pytest.fixture(params=["ascii", "latin-1"])
def terminal(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run `trocar` with streams of that encoding, which refuse what it lacks as Python's own do; returns all output."""
    def run(*words: str) -> str:
        written = io.BytesIO()
        stream = io.TextIOWrapper(written, encoding=request.param, errors="strict")
        with monkeypatch.context() as patched:
            patched.setattr(sys, "stdout", stream)
            patched.setattr(sys, "stderr", stream)
            patched.setattr(sys, "argv", ["trocar", *words])
            with pytest.raises(SystemExit):
                cli.main()
            stream.flush()
        return written.getvalue().decode(request.param)

    return run


@pytest.mark.parametrize("words", [
    ("status",), ("list",), ("attach", "--once"), ("echo", "PSM1/state", "--once"), ("recordings",),
    ("echo", "PSM1/events", "-n", "1"), ("hz", "PSM1/state", "--for", "0.01"), ("scope", "PSM1/state.reason")])
def test_a_verb_shows_similar_characters(spoken: ScriptedRobot, terminal: Run, words: tuple[str, ...]) -> None:
    shown = terminal(*words, "--system", spoken.name)
    assert shown and "�" not in shown and "\\u" not in shown
    if words[0] in ("status", "echo"):
        assert "> 4" in shown and "Z" in shown and "rich > ?" in shown


def test_a_refusal_shows_similar_characters(spoken: ScriptedRobot, terminal: Run) -> None:
    assert "PSM1" in terminal("send", "PSM1", "wörd→", "--system", spoken.name)


def test_documents_keep_every_character(spoken: ScriptedRobot, terminal: Run) -> None:
    shown = terminal("echo", "PSM1/state", "--once", "--json", "--system", spoken.name)
    assert json.loads(shown)["reason"] == REASON


@pytest.mark.slow
def test_the_help_of_each_verb_is_shown(terminal: Run) -> None:
    for words in [(), *((verb.name,) for verb in cli.VERBS),
                  *((verb.name, part.name) for verb in cli.VERBS for part in verb.parts)]:
        assert "Usage: trocar" in terminal(*words, "--help"), words


@pytest.mark.slow
def test_the_machine_is_checked_on_a_terminal_of_any_encoding(terminal: Run) -> None:
    assert terminal("doctor")


@pytest.mark.slow
@pytest.mark.parametrize(("output", "code", "reported"), [
    ("/dev/full", 1, "trocar: No space left on device\n"), ("&-", 0, "")])
def test_output_that_goes_nowhere_ends_no_verb_with_a_traceback(output: str, code: int, reported: str) -> None:
    verb = f"{sys.executable} -m trocar check configs/systems/kinematic.yaml >{output}"
    done = subprocess.run(["sh", "-c", verb], cwd=ROOT, text=True, capture_output=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (code, reported)


def test_a_terminal_that_only_appends_gets_no_line_twice_and_no_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", screen)
    for terminal, commands in (("xterm", 1), ("dumb", 0)):
        monkeypatch.setenv("TERM", terminal)
        LiveLine().show(["PSM1 follows"])
        assert screen.getvalue().count("\033") == commands and "PSM1 follows" in screen.getvalue()
        screen.truncate(0)
