"""What verbs say: nothing that others wrote steers the terminal."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from tests.conftest import World
from tests.tools.robot import ScriptedRobot, robot
from trocar.tools import cli
from trocar.tools.output import printing
from trocar.tools.output.columns import columns_file
from trocar.tools.output.printing import printable

ROOT = Path(cli.__file__).parent
EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m red \u202e"
STEERS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
APP = cli.build()


def test_progress_is_a_line_now_and_then_where_there_is_no_terminal(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    now_ns = 0
    monkeypatch.setattr(printing, "monotonic_ns", lambda: now_ns)
    with printing.progress("replay") as say:
        for now_ns in range(0, 25_000_000_000, 500_000_000):  # the clock
            say(f"{now_ns * 1e-9:.1f} s of 25.0 s", now_ns / 25e9)
    assert capsys.readouterr() == ("", "replay: 10.0 s of 25.0 s\nreplay: 20.0 s of 25.0 s\n")


@pytest.mark.parametrize(("seconds", "text"), [
    (None, "–"), (-1.0, "0.0 s"), (0.34, "0.3 s"), (9.96, "10 s"), (99.0, "99 s"), (240.0, "4 min"), (10800.0, "3 h"),
    (172800.0, "2 days")])
def test_a_duration_has_the_unit_of_its_size(seconds: float | None, text: str) -> None:
    assert printing.span(seconds) == text


def test_who_waits_notices_that_nobody_reads_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as output, monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", output)
        printing.need_reader()
        os.close(reading)
        with pytest.raises(BrokenPipeError):
            printing.need_reader()
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    printing.need_reader()


class TerminalOutput(io.StringIO):
    """What a terminal gets."""

    def isatty(self) -> bool:
        """It is one."""
        return True


@pytest.mark.parametrize(("output", "lines"), [(TerminalOutput(), 3), (io.StringIO(), 1)])
def test_a_terminal_gets_lines_that_are_broken_between_words_and_a_pipe_one_line(
    output: io.StringIO, lines: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdout", output)
    monkeypatch.setenv("COLUMNS", "20")
    printing.tell("first: check the potentiometer, then home", indent="  ")
    shown = output.getvalue().splitlines()
    assert len(shown) == lines and " ".join(map(str.strip, shown)) == "first: check the potentiometer, then home"
    printing.tell("a command that a person copies", indent=None)
    assert output.getvalue().splitlines()[lines:] == ["a command that a person copies"]


@pytest.fixture
def evil(world: World) -> Iterator[ScriptedRobot]:
    """A system whose arm says what a terminal would obey."""
    with robot(world.name) as made:
        made.arm.field("reason")[...] = EVIL.encode()
        made.show_arm(0.25, "FAULT")
        made.events.status(f"PSM1: {EVIL}", "PSM1")
        made.restarted(1, EVIL)
        yield made


def run(played: ScriptedRobot, *words: str) -> Result:
    return CliRunner().invoke(APP, [*words, "--system", played.name])


def test_what_is_printable_stays_and_what_steers_is_replaced() -> None:
    assert printable("3.5 °, ß – …\n\tline") == "3.5 °, ß – …\n\tline"
    assert not STEERS.search(printable(EVIL)) and printable(EVIL).endswith("31m red \ufffd")
    assert printable("a\nb\tc", "") == "a\ufffdb\ufffdc"


@pytest.mark.parametrize("words", [
    ("status",), ("attach",), ("echo", "PSM1/state", "--once"), ("echo", "PSM1/state.reason", "--once"),
    ("echo", "PSM1/events", "-n", "1"), ("scope", "PSM1/state.reason"), ("list",)])
def test_what_a_process_says_never_reaches_the_terminal_as_it_is(evil: ScriptedRobot, words: tuple[str, ...]) -> None:
    shown = run(evil, *words)
    assert shown.stdout and not STEERS.search(shown.stdout + shown.stderr), words
    if words[0] != "list":
        assert "\ufffd" in shown.stdout, words


def test_documents_keep_every_character_and_show_none_that_steers(evil: ScriptedRobot) -> None:
    shown = run(evil, "echo", "PSM1/state", "--once", "--json")
    assert not STEERS.search(shown.stdout) and json.loads(shown.stdout)["reason"] == EVIL


def test_tables_notes_and_files_on_a_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
                                              ) -> None:
    printing.table(f"[bold]{EVIL}", ("who", "why"), [("PSM1", EVIL)])
    printing.note(EVIL)
    printing.tell(EVIL)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    with columns_file("-", ("why",)) as file:
        file.row([EVIL])
    shown = capsys.readouterr()
    assert "[bold]" in shown.out, "it is no markup of ours"
    assert not STEERS.search(shown.out + shown.err) and (shown.out + shown.err).count("red") == 5


def test_problems_are_told_without_what_steers(evil: ScriptedRobot) -> None:
    shown = run(evil, "echo", f"PSM1/{EVIL}")
    assert shown.exit_code and not STEERS.search(shown.stderr)


def test_verbs_print_by_these_functions_alone() -> None:
    ours = re.compile(r"(?<![\w.])print\((?!f?\"\\r|file=)")
    found = [f"{path.name}: {line.strip()}" for folder in ("verbs", "commission") for path in
             sorted((ROOT / folder).glob("*.py")) for line in path.read_text().splitlines() if ours.search(line)]
    assert found == [], "tell, note and emit of tools/output/printing.py know what a terminal may have"


def test_a_table_that_nobody_reads_does_not_end_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    output = os.fdopen(writing, "w")
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", output)
        with pytest.raises(BrokenPipeError):  # with which a verb's exit code is 0
            printing.table("", ("name",), [("PSM1",)])
    with contextlib.suppress(BrokenPipeError):
        output.close()


def test_a_warning_of_python_reaches_the_terminal_as_one_plain_line() -> None:
    code = ("import warnings; from trocar.tools import cli; from trocar.tools.output.errors import Clipped\n"
            f"text = 'PSM1 move_jp was clipped' + {EVIL!r}\n"
            "cli.build = lambda only: lambda prog_name: warnings.warn(text, Clipped)\n"
            "cli.main()")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT.parent, capture_output=True, text=True, check=True)
    assert "PSM1 move_jp was clipped" in done.stderr and done.stderr.count("\n") == 1
    assert "<string>" not in done.stderr and "Clipped" not in done.stderr and not STEERS.search(done.stderr)
