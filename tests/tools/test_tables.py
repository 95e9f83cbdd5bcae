"""Tables: no number and no word is cut, and no line is wider than the terminal."""

from __future__ import annotations

import os
import pty
import struct
import termios
from collections.abc import Iterator
from fcntl import ioctl
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from typer.testing import CliRunner

from tests.conftest import World
from tests.recordings.made import FACTS, a_recording
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.recordings import names
from trocar.shm.time.system_time import SystemTime
from trocar.tools import cli
from trocar.tools.analysis.places import folder_of
from trocar.tools.output import printing
from trocar.tools.output.printing import fitting
from trocar.tools.output.tables import table_lines
from trocar.tools.verbs.demo import _state

APP = cli.build()
WIDTHS = (60, 80, 120)
WORDS = st.text(st.characters(categories=("L", "N", "P"), max_codepoint=0x17F), min_size=1, max_size=20)
TEXTS = st.lists(WORDS, max_size=40).map(" ".join) | st.floats().map("{:.9g}".format)
REASON = "the joint controller cannot follow its setpoint; check for a collision or too fast a command " * 2


def words_of(lines: list[str]) -> list[str]:
    return sorted(word for line in lines for word in line.split() if set(word) != {"─"})


def assert_fits(lines: list[str], width: int) -> None:
    wide = [line for line in lines if len(line) > width and len(line.split()) > 1 and "─" not in line]
    assert not wide, "\n".join(lines)


@given(st.integers(1, 9).flatmap(lambda n: st.lists(st.tuples(*[TEXTS] * n), min_size=1, max_size=5)),
       st.sampled_from(WIDTHS), st.integers(0, 9))
@pytest.mark.slow
def test_no_word_of_a_table_is_cut_at_any_width(rows: list[tuple[str, ...]], width: int, right: int) -> None:
    columns = [f"column {k}" for k in range(len(rows[0]))]
    lines = table_lines(columns, rows, columns[1 : 1 + right], width)
    used = [k for k in range(1, len(columns)) if any(row[k] for row in rows)]
    first, times = words_of([row[0] for row in rows] + [columns[0]]), sum(line.startswith("column") for line in lines)
    assert words_of(lines) == sorted(words_of([text[k] for text in (columns, *rows) for k in used]) + first * times)
    assert_fits(lines, width)


@pytest.fixture
def played(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    """A system in FAULT, with recordings and gains of many digits."""
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    monkeypatch.setattr("trocar.tools.inspect.processes._stalled", lambda *process: False)  # nothing beats here
    with robot(world.name) as made:
        made.arm.field("reason")[...] = REASON.encode()[:200]
        made.show_arm(-0.123456789, "FAULT")
        made.restarted(123456, "killed by SIGKILL")
        folder = folder_of(made.name)
        folder.mkdir(parents=True)
        monkeypatch.setitem(FACTS, names.SYSTEM, {"kind": names.FAULT, names.CODE: "tracking", "reason": REASON})
        a_recording(folder, name="fault-20260101T101010Z.mcap")
        yield made


def printed(words: list[str], width: int, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setenv("COLUMNS", str(width))
    return CliRunner().invoke(APP, words).stdout.splitlines()


@pytest.mark.parametrize("words", [
    ("status",), ("list",), ("list", "-v"), ("recordings",), ("echo", "PSM1/state", "--once"),
    ("echo", "PSM1/measured_js", "--once"), ("send", "PSM1")], ids=" ".join)
def test_no_word_of_a_verb_is_cut(words: tuple[str, ...], played: ScriptedRobot,
                                  monkeypatch: pytest.MonkeyPatch) -> None:
    asked = [*words, "--system", played.name]
    whole, lines = printed(asked, 10_000, monkeypatch), printed(asked, WIDTHS[0], monkeypatch)
    ages = ("age", "ms", "stalled")  # they pass
    missing = set(words_of(whole)) - set(words_of(lines)) - {word for line in whole for word in line.split()
                                                             if any(each in line for each in ages)}
    assert whole and not missing
    assert_fits([line for line in lines if not line.startswith(("first: ", "a recording", " "))], WIDTHS[0])


def test_the_line_of_the_demo_begins_with_what_is_in_fault(played: ScriptedRobot) -> None:
    teleop: Any = SimpleNamespace(slave="PSM1", masters=["MTMR"], is_following=True, value=lambda name: [0.1] * 7)
    with SystemTime(played.name) as time:
        parts, why = _state(played.name, teleop, time)
        assert parts[0] == "FAULT: PSM1" and "collision" in why
        played.show_arm(state="ENABLED")
        parts, why = _state(played.name, teleop, time)
        assert parts[0] == "PSM1 follows MTMR" and not why


@pytest.mark.parametrize("reason", ["", "waiting: pinch or twist the gripper to match the jaw; " * 20])
@pytest.mark.parametrize("state", ["FAULT", "ENABLED"])
def test_the_line_of_the_demo_says_within_80_columns_what_the_teleoperation_does(
        state: str, reason: str, played: ScriptedRobot) -> None:
    played.show_arm(state=state)
    for is_following, does in ((True, "PSM1 follows MTMR"), (False, "MTMR_PSM1 is ALIGNING_MTM")):
        teleop: Any = SimpleNamespace(slave="PSM1", masters=["MTMR"], is_following=is_following, shown_state=does,
                                      value=lambda name: [0.1] * 7, reported=f"MTMR_PSM1 is ALIGNING_MTM: {reason}")
        with SystemTime(played.name) as time:
            parts, why = _state(played.name, teleop, time)
        line = fitting(["12345 s of 36000 s", *parts], 79)
        assert does in line and ("FAULT: PSM1" in line) is (state == "FAULT") and "pinch" not in line
        assert why == ("" if is_following else teleop.reported) or state == "FAULT"


@given(st.lists(TEXTS), st.sampled_from(WIDTHS))
def test_a_line_that_is_written_over_has_whole_parts_only(parts: list[str], width: int) -> None:
    assume(all(parts))
    line = fitting(parts, width)
    assert len(line) <= width and (not parts or len(parts[0]) > width or line.startswith(parts[0]))
    rest = line
    for part in parts:
        rest = rest.removeprefix(part).removeprefix("  ")
    assert not rest


@pytest.mark.parametrize("columns", WIDTHS)
def test_the_line_is_as_wide_as_the_terminal_it_is_on(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    ours, theirs = pty.openpty()
    ioctl(theirs, termios.TIOCSWINSZ, struct.pack("4H", 24, columns, 0, 0))
    with os.fdopen(theirs, "w") as stream, monkeypatch.context() as patched:
        patched.setattr("sys.stderr", stream)
        line = printing.LiveLine()
        line.show(["FAULT: PSM1", *["word" * 4] * 20])
        stream.flush()
        said = os.read(ours, 1 << 16).decode().removeprefix("\r\033[K")
        line.close()
    os.close(ours)
    assert said.startswith("FAULT: PSM1  ") and columns - 18 <= len(said) < columns
