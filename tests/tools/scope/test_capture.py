"""What `trocar scope` catches: on rings that the test writes."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.crtk.field_paths import parse_path
from trocar.procs.tables import codes
from trocar.shm.time.clock import monotonic_ns
from trocar.tools import cli
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.scope import capture
from trocar.tools.scope.capture import Capture, Capturing
from trocar.tools.scope.grammar import parse_condition
from trocar.tools.scope.output import as_json, lost, remarks, series_of
from trocar.tools.scope.window import gaps_of

APP = cli.build()
FIELD = "PSM1/measured_js.position[0]"


@pytest.fixture
def played(world: Any) -> Iterator[ScriptedRobot]:
    with robot(world.name, kept=1 << 20) as made:  # as long as they are
        yield made


def show(played: ScriptedRobot, position: float, at_s: float, **rest: Any) -> None:
    """A record of the arm with this stamp, after the begin of the test's own time."""
    played.show_arm(position, stamp_ns=BEGIN + 10**9 + round(at_s * 1e9), **rest)


BEGIN = monotonic_ns() - 4_000_000_000


def opened(played: ScriptedRobot, when: str = "", *fields: str) -> Capturing:
    condition = parse_condition(when) if when else None
    return Capturing(played.name, [parse_path(field) for field in fields or (FIELD,)], condition)


def values(found: Capture | None) -> list[float]:
    assert found is not None
    return [round(float(value), 3) for value in next(series_of(found)).values]


@pytest.mark.slow
def test_the_last_seconds_are_every_record_once(played: ScriptedRobot) -> None:
    for k in range(100):
        show(played, 0.01 * k, 1.0 * k - 96.0)
    with opened(played) as capturing:
        found = capturing.last(50.5)
    assert values(found) == [round(0.01 * k, 3) for k in range(49, 100)] and found.gaps == () and found.short == {}
    assert next(series_of(found)).seconds(found.moment_ns)[-1] == 0.0


def test_what_the_ring_keeps_no_more_is_told(played: ScriptedRobot) -> None:
    for k in range(5000):  # more than it has room for
        played.arm.publish(BEGIN + k * 1_000_000)
    with opened(played) as capturing:
        found = capturing.last(4.999)
    kept = capturing._windows["PSM1/state"]._reader.depth - 1
    assert found.short["PSM1/state"] == pytest.approx((5000 - kept) * 1e-3, abs=0.1) and len(values_of(found)) == kept


def values_of(found: Capture) -> Any:
    return next(series_of(found)).values


def test_records_that_were_overwritten_are_counted(played: ScriptedRobot) -> None:
    show(played, 0.0, 0.0)
    with opened(played) as capturing:
        window = capturing._windows["PSM1/state"]
        window.collect()
        for k in range(5000):
            played.arm.publish(BEGIN + 10_000_000_000 + k * 100_000)
        found = capturing.last(60.0)
        overwritten = 5000 - (window._reader.depth - 1)
    assert lost(found) == overwritten and found.gaps[0].topic == "PSM1/state"
    assert as_json(found, "", 60.0, 0.0)["gaps"][0]["lost"] == overwritten


class HurriedReader:
    """A reader whose writer goes on between two looks at the head."""

    def __init__(self, reader: Any, more: Any) -> None:
        self._reader, self._more = reader, more

    def __getattr__(self, name: str) -> Any:
        return getattr(self._reader, name)

    @property
    def head(self) -> int:
        found = int(self._reader.head)
        self._more()
        return found


@pytest.mark.parametrize("more", [1, 30, 100])
def test_nothing_is_left_out_that_comes_while_it_looks(played: ScriptedRobot, more: int) -> None:
    played.show_arm(0.0)
    with opened(played) as capturing:
        window = capturing._windows["PSM1/state"]
        window.collect()
        left = [1, 1, 1]  # so often the writer goes on

        def publish() -> None:
            for _ in range(more if left and left.pop() else 0):
                played.arm.publish(monotonic_ns())

        window._reader = HurriedReader(window._reader, publish)  # type: ignore[assignment]
        for _ in range(3):
            window.collect()
        rows = window.rows()
    assert gaps_of("PSM1/state", rows) == [] and rows.sequences.tolist() == list(range(1, 3 * more + 2))


@pytest.mark.parametrize(("when", "at"), [
    (f"{FIELD} > 0.5", 0.6), (f"{FIELD} >= 0.5", 0.5), (f"not {FIELD} < 0.5", 0.5), (f"abs({FIELD}) > 0.75", 0.8),
    (f"{FIELD} > 0.5 and {FIELD} < 0.7", 0.6), (f"{FIELD} > 5 or {FIELD} == 0.25", None),
    ("PSM1/measured_js.position > 0.85", 0.9), ("PSM1/state.state == ENABLED", 0.3), ("PSM1/state.is_busy", 0.4),
    ("PSM1/state.is_busy == true", 0.4), ("PSM1/state.state != ENABLED", 0.0),
    (f"PSM1/state.is_busy and {FIELD} > 0.65", 0.7), (f"PSM1/state.state == ENABLED and not {FIELD} < 0.4", 0.4),
])
def test_the_moment_is_where_it_begins_to_hold(played: ScriptedRobot, when: str, at: float | None) -> None:
    for k in range(10):
        show(played, 0.1 * k, 0.01 * k, state="ENABLED" if k >= 3 else "DISABLED", busy=k >= 4)
    with opened(played, when) as capturing:
        found = capturing.past(0.0, 0.0)
    assert (None if at is None else [at]) == (None if found is None else values(found))


def test_the_last_time_is_taken_of_several(played: ScriptedRobot) -> None:
    for k, position in enumerate((0.0, 1.0, 1.0, 0.0, 2.0, 2.5, 0.0)):
        show(played, position, 0.01 * k)
    with opened(played, f"{FIELD} > 0.5") as capturing:
        assert values(capturing.past(0.015, 0.015)) == [0.0, 2.0, 2.5]


@pytest.mark.slow
def test_what_is_not_valid_triggers_nothing(played: ScriptedRobot) -> None:
    show(played, 9.0, 0.0, valid=False)
    show(played, 0.1, 0.1)
    for when in (f"{FIELD} > 0.5", f"{FIELD} != 0.1", "PSM1/measured_js.velocity[0] < 1"):
        with opened(played, when) as capturing:
            assert capturing.past(0.0, 0.0) is None, when


@pytest.mark.parametrize("when", ["event PSM1 error", "event error", "event tracking", 'event PSM1 "cannot"', "fault",
                                  "fault PSM1", "event PSM1 tracking", "event error or PSM1/state.is_busy"])
def test_events_and_faults_are_moments(played: ScriptedRobot, when: str) -> None:
    played.show_arm(0.1)
    played.events.status("PSM1: HOMED", "PSM1")
    played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
    played.show_arm(0.2)
    with opened(played, when) as capturing:
        found = capturing.past(5.0, 5.0)
    assert found is not None and values(found) == [0.1, 0.2]
    times = next(series_of(found)).seconds(found.moment_ns)
    assert times[0] < 0.0 < times[1]


@pytest.mark.parametrize("when", ["event IO1", "event PSM1 warning", "event goal_reached", 'event "nothing such"',
                                  "fault IO1", "event bad-reads"])
def test_other_events_are_none(played: ScriptedRobot, when: str) -> None:
    played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
    with opened(played, when) as capturing:
        assert capturing.past(1.0, 1.0) is None


def test_a_fault_of_the_state_machine_is_one(played: ScriptedRobot) -> None:
    played.events.operating_state("ENABLED", "HOMED", True, False)
    played.show_arm(0.1)
    played.events.operating_state("FAULT", "FAULT", False, False)
    with opened(played, "fault PSM1") as capturing:
        assert values(capturing.past(1.0, 1.0)) == [0.1]


@pytest.mark.parametrize("when", ["fault", "fault PSM1"])
def test_a_fault_is_where_it_begins(played: ScriptedRobot, when: str) -> None:
    """In FAULT an arm repeats its state at each command, also at the one that clears it."""
    for position, state in ((0.1, "FAULT"), (0.2, "HOMED"), (0.3, "FAULT"), (0.4, "FAULT"), (0.5, "DISABLED")):
        played.events.operating_state(state, state, False, False)
        played.show_arm(position)
    with opened(played, when) as capturing:
        assert values(capturing.past(0.0, 1.0)) == [0.3, 0.4, 0.5]


@pytest.mark.slow
def test_it_waits_and_takes_what_comes_after(played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    positions = iter([0.1, 0.2, 0.9, 0.3, 0.4, 0.5])
    played.show_arm(0.95, age_s=1.0)  # before it began to wait: this is no moment

    def meanwhile(seconds: float) -> None:
        for position in positions:
            played.show_arm(position)
            break

    monkeypatch.setattr(capture, "pause", meanwhile)
    monkeypatch.setattr(capture, "SILENT_S", 0.05)
    with opened(played, f"{FIELD} > 0.5") as capturing:
        found = capturing.wait(60.0, 0.2, 30.0)
    assert values(found) == [0.95, 0.1, 0.2, 0.9, 0.3, 0.4, 0.5]


def happening(monkeypatch: pytest.MonkeyPatch, *steps: Callable[[], object]) -> None:
    """While it waits this happens, one after the other."""
    left = iter(steps)
    monkeypatch.setattr(capture, "pause", lambda seconds: next(left, lambda: None)())
    monkeypatch.setattr(capture, "SILENT_S", 0.05)


def test_it_does_not_wait_for_the_end_of_a_fault(played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    played.events.operating_state("FAULT", "FAULT", False, False)
    happening(monkeypatch, lambda: played.events.operating_state("FAULT", "FAULT", False, False))
    with opened(played, "fault PSM1") as capturing:
        assert capturing.wait(1.0, 0.0, 0.1) is None


RESTARTS = "supervisor/state.restarts[1]"  # written on change


@pytest.mark.parametrize(("when", "whose"), [(f"{RESTARTS} > 2 and {FIELD} > 0.5", "arm"),
                                             (f"not {RESTARTS} > 2 and {FIELD} > 0.5", "supervisor")])
def test_what_is_written_on_change_holds_from_before_it_began_to_wait(
        played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch, when: str, whose: str) -> None:
    played.restarted(3, "killed by signal 9")
    played.show_arm(0.1)
    happening(monkeypatch, lambda: played.show_arm(0.8), lambda: played.restarted(1, "it ended"))
    with opened(played, when) as capturing:
        found = capturing.wait(30.0, 0.0, 30.0)
    assert values(found) == [0.1, 0.8] and found is not None
    assert found.moment_ns == getattr(played, whose).stamp_ns


def test_what_was_written_long_before_is_found_behind_many_records(played: ScriptedRobot) -> None:
    played.show_arm(0.25, age_s=1.0)
    for _ in range(100):
        played.arm.publish(monotonic_ns())
    with opened(played) as capturing:
        window = capturing._windows["PSM1/state"]
        before = window.newest_before(monotonic_ns() - 500_000_000)
        assert before["position"][:, 0].tolist() == [0.25] and not len(window.newest_before(1))


@pytest.mark.slow
def test_what_is_written_on_change_is_waited_for_until_the_window_ends(
        played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    played.show_arm(0.1)
    happening(monkeypatch, lambda: played.show_arm(0.9), lambda: played.restarted(7, ""))
    with opened(played, f"{FIELD} > 0.5", RESTARTS) as capturing:
        found = capturing.wait(0.0, 0.3, 30.0)
    assert values(found) == [7.0] and found is not None and found.unseen == {}
    assert monotonic_ns() >= found.moment_ns + 300_000_000


@pytest.mark.slow
def test_what_did_not_come_at_the_end_of_a_window_is_told(
        played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    played.show_arm(0.1)
    happening(monkeypatch, lambda: played.show_arm(0.9))
    with opened(played, f"{FIELD} > 0.5") as capturing:
        found = capturing.wait(0.0, 0.25, 30.0)
    assert found is not None and found.unseen == {"PSM1/state": pytest.approx(0.25)}
    assert "PSM1/state: no more records came: the last 0.250 s of the window are missing" in remarks(found)
    assert as_json(found, "", 0.0, 0.25)["missing_after_s"] == found.unseen


@pytest.mark.slow
def test_numbers_are_compared_with_texts_as_they_are_written(played: ScriptedRobot) -> None:
    for k, reason in enumerate(("", "1234567", "0.10", "1e3")):
        played.arm.field("reason")[...] = reason.encode()
        show(played, 0.1 * k, 0.01 * k)
    for reason, at in (("1234567", 0.1), ("0.10", 0.2), ("1e3", 0.3), ("'1e3'", 0.3)):
        with opened(played, f"PSM1/state.reason == {reason}") as capturing:
            assert values(capturing.past(0.0, 0.0)) == [at], reason


def test_what_does_not_happen_in_time_is_none(played: ScriptedRobot) -> None:
    played.show_arm(0.1)
    with opened(played, f"{FIELD} > 0.5") as capturing:
        assert capturing.wait(1.0, 1.0, 0.05) is None


@pytest.mark.slow
def test_rings_are_aligned_on_their_stamps(played: ScriptedRobot) -> None:
    stamp = monotonic_ns() - 10**9
    for k in range(10):
        played.io.field("position")[0] = k
        played.io.field("valid")[...] = True
        played.io.publish(stamp + k * 1_000_000)
    played.show_arm(0.7, stamp_ns=stamp - 500_000_000)
    when = f"{FIELD} > 0.5 and IO1/state.position[0] >= 6"
    with opened(played, when, "IO1/state.position[0]", FIELD) as capturing:
        found = capturing.past(1.0, 1.0)
    assert found is not None and found.moment_ns == stamp + 6_000_000
    assert [len(rows) for rows in found.rows.values()] == [10, 1]


def test_fields_that_do_not_fit_are_used_wrongly(played: ScriptedRobot) -> None:
    played.show_arm(0.1)
    for when, why in (("PSM1/state.state > 1", "is text: allowed are == and !="),
                      ("PSM1/measured_js.position[0] == FAULT", "'FAULT' is none of its words"),
                      ("PSM1/measured_js.positin > 1", "did you mean position")):
        with pytest.raises(Misuse, match=why):
            opened(played, when)
    for when in ("fault PSM9", "event PSM9 error"):
        with pytest.raises(Problem, match="no process PSM9"):
            opened(played, when)


# the verb


def run(played: ScriptedRobot, *words: str) -> Result:
    return CliRunner().invoke(APP, ["scope", *words, "--system", played.name])


def filled(played: ScriptedRobot) -> None:
    for k in range(200):
        show(played, float(np.sin(k * 0.1)), 0.01 * k)


def test_tables_and_documents_have_every_record(played: ScriptedRobot, tmp_path: Path) -> None:
    filled(played)
    table = list(csv.reader(io.StringIO(run(played, FIELD, "--before", "0.505", "--csv", "-").stdout)))
    assert table[0] == ["t_s", "stamp_ns", FIELD] and len(table) == 52 and table[-1][0] == "0.000000"
    document = json.loads(run(played, FIELD, "--when", f"{FIELD} > 0.99", "--past", "--json", "--before", "0.025",
                              "--after", "0").stdout)
    (field,) = document["fields"]
    assert len(field["value"]) == 3 and field["value"][-1] > 0.99 >= field["value"][-2]
    assert document["lost"] == 0 and document["gaps"] == []
    file = tmp_path / "table.csv"
    assert run(played, FIELD, "--csv", str(file)).exit_code == 0 and len(file.read_text().splitlines()) > 50


@pytest.mark.slow
def test_what_did_not_happen_is_exit_code_one(played: ScriptedRobot) -> None:
    filled(played)
    shown = run(played, FIELD, "--when", f"{FIELD} > 5", "--timeout", "0.05")
    assert shown.exit_code == 1 and "did not happen within 0.05 s" in shown.stderr
    assert run(played, FIELD, "--when", f"{FIELD} > 5", "--past").exit_code == 1


@pytest.mark.parametrize("words", [(FIELD, "--when", "what"), ("PSM1",), ("PSM1/state",), (FIELD, "--past"),
                                   (FIELD, "--json", "--csv", "-"), (FIELD, "--before", "100")])
def test_what_is_used_wrongly_says_so(played: ScriptedRobot, words: tuple[str, ...]) -> None:
    played.show_arm(0.1)
    assert run(played, *words).exit_code == 2


@pytest.mark.slow
def test_an_empty_ring_is_a_problem(played: ScriptedRobot) -> None:
    shown = run(played, FIELD)
    assert shown.exit_code == 1 and "nothing was written to PSM1/state yet" in shown.stderr


@pytest.mark.slow
def test_a_picture_is_made_or_says_what_it_needs(played: ScriptedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                 ) -> None:
    filled(played)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    shown = run(played, FIELD, "--png", str(tmp_path / "a.png"))
    assert shown.exit_code == 1 and "pip install 'trocar[plot]'" in shown.stderr
    monkeypatch.undo()
    pytest.importorskip("matplotlib")
    shown = run(played, FIELD, "IO1/state.position[0]", "--png", str(tmp_path / "a.png"))
    assert shown.exit_code == 0, shown.stderr
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
