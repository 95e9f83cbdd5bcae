"""trocar pid: gains of a running system looked at, changed, and back in a file."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from tests.examples import examples
from tests.tools.robot import robot
from trocar.procs.config import check_file
from trocar.procs.config.models.io_file import PidFile
from trocar.procs.config.read.source import read_source
from trocar.procs.config.read.validate import validate
from trocar.procs.document.gains import GAINS, changed, value_of
from trocar.procs.document.system import PidAxis
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.ring.ring import RingWriter
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools import cli
from trocar.tools.inspect.gains import Present
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.verbs.pid_file import save_as

APP = cli.build()


def rows_of(file: Path) -> tuple[PidAxis, ...]:
    source, problems = read_source(file)
    assert source is not None, problems
    content, problems = validate(PidFile, source)
    assert content is not None, problems
    return content.pid


def in_use(file: Path, rows: tuple[PidAxis, ...] | None = None) -> Present:
    start = rows_of(file)
    rows = rows or start
    values = {gain.key: np.array([value_of(row, gain.key) for row in rows]) for gain in GAINS}
    return Present("R", "R", "IO1", str(file), tuple(row.name for row in start), values, start)


@pytest.fixture(params=["ECM-Si", "ECM", "MTM", "PSM-Si", "PSM"])
def stock_file(request: pytest.FixtureRequest, data: Callable[[str], Path]) -> Path:
    return data(f"dvrk-share/pid/sawControllersPID-{request.param}.json")


def test_a_saved_file_loads_again_and_equals(stock_file: Path, tmp_path: Path) -> None:
    target = tmp_path / "new.json"
    tuned = tuple(changed(row, ["p_gain", "i_limit", "use_disturbance_observer"], [row.p_gain / 3.0, 0.1, 1.0],
                          running=False) for row in rows_of(stock_file))
    saved = save_as(in_use(stock_file, tuned), target, force=False)
    assert rows_of(target) == tuned and len(saved.changed) >= 2 * len(tuned)
    assert [p for p in check_file(target).problems if p.severity == "error"] == []
    assert saved.notes == [f"comments of {stock_file} are not in the new file"]


def test_what_did_not_change_stays_as_it_was_written(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    row = {"index": 0, "name": "a", "type": "REVOLUTE", "p_gain": 120, "d_gain": 1e-1, "i_gain": 0, "mine": [1, 2]}
    content = {"$id": "saw-controllers-pid.schema.json", "$version": "1", "who": "us", "pid": [row]}
    file.write_text(json.dumps(content))
    saved = save_as(in_use(file), tmp_path / "new.json", force=False)
    assert saved.changed == [] and saved.notes == []
    assert json.loads((tmp_path / "new.json").read_text()) == content
    tuned = (changed(rows_of(file)[0], ["d_gain"], [0.3], running=False),)
    saved = save_as(in_use(file, tuned), tmp_path / "newer.json", force=False)
    assert saved.changed == ["0 a d_gain"], "named as pid show names it"
    row["d_gain"] = 0.3
    assert json.loads((tmp_path / "newer.json").read_text()) == content


def test_nothing_is_overwritten_unasked_and_nothing_is_lost(tmp_path: Path, stock_file: Path) -> None:
    target = tmp_path / "new.json"
    target.write_text("precious")
    with pytest.raises(Problem, match="--force"):
        save_as(in_use(stock_file), target, force=False)
    assert target.read_text() == "precious"
    assert save_as(in_use(stock_file), target, force=True).backup == tmp_path / "new.json.bak1"
    assert save_as(in_use(stock_file), target, force=True).backup == tmp_path / "new.json.bak2"
    assert (tmp_path / "new.json.bak1").read_text() == "precious"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["new.json", "new.json.bak1", "new.json.bak2"]


def test_a_file_can_be_saved_over_the_one_it_came_from(tmp_path: Path, stock_file: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_bytes(stock_file.read_bytes())
    tuned = tuple(changed(row, ["offset"], [0.1], running=False) for row in rows_of(file))
    save_as(in_use(file, tuned), file, force=True)
    assert rows_of(file) == tuned and (tmp_path / "mine.json.bak1").read_bytes() == stock_file.read_bytes()


def test_what_cannot_be_saved_is_said_and_leaves_nothing(tmp_path: Path, stock_file: Path) -> None:
    with pytest.raises(Misuse, match=r"NAME\.json"):
        save_as(in_use(stock_file), tmp_path / "new.yaml", force=False)
    with pytest.raises(Problem, match="cannot be written: No such file"):
        save_as(in_use(stock_file), tmp_path / "nowhere" / "new.json", force=False)
    file = tmp_path / "mine.json"
    file.write_bytes(stock_file.read_bytes())
    gains = in_use(file)
    file.write_text("{")
    with pytest.raises(Problem, match="can no longer be read"):
        save_as(gains, tmp_path / "new.json", force=False)
    file.write_text('{"$id": "saw-controllers-pid.schema.json", "$version": 1}')
    with pytest.raises(Problem, match="has changed since"):
        save_as(gains, tmp_path / "new.json", force=False)
    file.unlink()
    with pytest.raises(Problem, match="can no longer be read"):
        save_as(gains, tmp_path / "new.json", force=False)
    with pytest.raises(Problem, match="R has no PID file"):
        save_as(dataclasses.replace(gains, file=""), tmp_path / "new.json", force=False)
    assert list(tmp_path.iterdir()) == []


@examples(30)
@given(st.lists(st.tuples(st.sampled_from(GAINS), st.floats(allow_nan=False, allow_infinity=False)), max_size=12))
def test_every_gain_comes_back_to_the_last_digit(
    tmp_path_factory: pytest.TempPathFactory, values: list[tuple[Any, float]]
) -> None:
    folder = tmp_path_factory.mktemp("pid")
    file = folder / "mine.json"
    file.write_text('{"$id": "saw-controllers-pid.schema.json", "$version": "1", "pid": [{"index": 0, "name": "a",'
                    ' "type": "REVOLUTE", "p_gain": 1, "d_gain": 1, "i_gain": 0}]}')
    row = rows_of(file)[0]
    for gain, value in values:
        if not gain.wrong(value):
            row = changed(row, [gain.key], [value], running=False)
    save_as(in_use(file, (row,)), folder / "new.json", force=False)
    assert rows_of(folder / "new.json") == (row,)


def run(*words: str) -> Result:
    return CliRunner().invoke(APP, ["pid", *words])


@pytest.fixture
def ring(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[RingWriter]:
    """A system whose io has said its gains: those of the document, but for one."""
    monkeypatch.setenv("TROCAR_SYSTEM", world.name)
    with robot(world.name):
        made = directory.writer(world.name, "IO1", "gains", "io")
        made.field("p_gain")[...] = 1.0
        made.field("p_gain")[3] = 2.5
        made.field("i_forget_rate")[...] = made.field("v_low_pass_cutoff")[...] = 1.0
        made.publish(monotonic_ns())
        yield made
        made.close()


def test_show_marks_what_is_not_as_in_the_file(ring: RingWriter) -> None:
    rows = [json.loads(line) for line in run("show", "--json").stdout.splitlines()]
    assert [row["changed"] for row in rows] == [[], [], [], ["p_gain"], [], [], []]
    assert rows[3]["p_gain"] == 2.5 and rows[3]["robot"] == "PSM1" and rows[3]["io"] == "IO1"
    text = run("show", "PSM1").output
    assert "2.5*" in text and "3 roll" in text


def test_save_names_axes_and_gains_as_show_does(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    row = {"type": "REVOLUTE", "p_gain": 120, "d_gain": 0.1, "i_gain": 0}
    file.write_text(json.dumps({"$id": "saw-controllers-pid.schema.json", "$version": "1", "pid": [
        {"index": k, "name": name, **row} for k, name in enumerate(("yaw", "wrist pitch", "jaw"))]}))
    first, second, third = rows_of(file)
    found = in_use(file, (first, changed(second, ["p_gain", "use_disturbance_observer"], [7.0, 1.0], running=False),
                          changed(third, ["d_gain"], [0.3], running=False)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("trocar.tools.verbs.pid.present", lambda *_: [found])
        patch.setattr("trocar.tools.verbs.pid.chosen_system", lambda *_: "")
        patch.setenv("COLUMNS", "1000")
        shown, saved = run("show").stdout.splitlines(), run("save", "R", str(tmp_path / "new.json"))
    columns = [" ".join(name.split()) for name in re.split(r"  +", shown[1].strip())]
    stars = {f"{axis} {line.split()[0]}" for line in shown[2:] if "*" in line
             for axis, cell in zip(columns, line.split()[1:], strict=True) if cell.endswith("*")}
    assert stars and stars == set(saved.stdout.strip().rpartition(": ")[2].split(", "))


@pytest.mark.parametrize("width", [60, 80, 120])
def test_show_cuts_no_number(width: int, ring: RingWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = [120.0, 6000.0, 0.123456789, 1e6, 2.5, 3.25, 7.0]
    ring.field("p_gain")[:7] = numbers
    ring.publish(monotonic_ns())
    monkeypatch.setenv("COLUMNS", str(width))
    lines = run("show", "PSM1").output.splitlines()
    shown = [word for line in lines if line.split()[:1] == ["p_gain"] for word in line.split()[1:]]
    assert [float(word.rstrip("*")) for word in shown] == numbers
    assert max(len(line) for line in lines if "─" not in line) <= width


@pytest.mark.parametrize(("words", "code", "reported"), [
    (("show", "PSM9"), 1, "no joint controller PSM9; did you mean PSM1"),
    (("set", "PSM1", "9", "p_gain=1"), 1, "axis 9 of PSM1; allowed: 0 to 6, yaw, pitch"),
    (("set", "PSM1", "0", "p_gain"), 2, "KEY=VALUE is needed"),
    (("set", "PSM1", "0", "pgain=1"), 1, "no gain pgain; did you mean p_gain"),
    (("set", "PSM1", "0", "p_gain=much"), 2, "a number is needed"),
    (("set", "PSM1", "0", *(f"{gain.key}=1" for gain in GAINS)), 2, "give fewer gains at once"),
    (("save", "PSM1", "x.yaml"), 2, "NAME.json"),
])
def test_mistakes_say_what_is_allowed(ring: RingWriter, words: tuple[str, ...], code: int, reported: str) -> None:
    done = run(*words)
    assert done.exit_code == code and reported in done.stderr


@pytest.mark.parametrize("takes", [True, False])
def test_set_looks_whether_io_has_the_gains(ring: RingWriter, takes: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.tools.verbs.pid.CONFIRMED_NS", 30_000_000_000 if takes else 100_000_000)
    mailbox = Mailbox(os.environ["TROCAR_SYSTEM"], "IO1", COMMANDS["io"])

    def io() -> None:
        end = monotonic_ns() + 10 * 10**9
        while not (found := list(mailbox.drain())) and monotonic_ns() < end:
            pause(0.001)
        found[0].done()
        if takes:
            ring.field("p_gain")[2] = 7.0
            ring.publish(monotonic_ns())

    thread = threading.Thread(target=io)
    thread.start()
    done = run("set", "PSM1", "2", "p_gain=7")
    thread.join()
    mailbox.close()
    assert done.exit_code == (0 if takes else 1), done.output
    assert ("p_gain 1 → 7" if takes else "IO1 answered done, but reports other gains: insertion p_gain") in done.output


def test_gains_of_a_dead_io_are_not_taken_for_those_in_use(ring: RingWriter) -> None:
    ring.close()
    done = run("show")
    assert done.exit_code == 1 and "does not run" in done.stderr
