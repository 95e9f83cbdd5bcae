"""`trocar compare`: what is the same is said to be, and what differs is found with its place and size."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from typer.testing import CliRunner, Result

from tests.examples import examples
from tests.recordings.made import BEGIN_NS, STATE, STEP_NS, rows_of, written
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import Chunk, packed
from trocar.procs.recordings.layout import ENCAPSULATION
from trocar.procs.recordings.reading import Records, open_recording
from trocar.procs.recordings.writing import ChannelTable, RecordingFile
from trocar.shm.memory.layout import schema_of
from trocar.shm.topics import ARM_STATE
from trocar.tools import cli
from trocar.tools.analysis.choosing import Stretch
from trocar.tools.analysis.comparing import Comparing, as_dict
from trocar.tools.analysis.differences import SEQUENCE, STAMP, START, compared, distance, in_common, paired, same
from trocar.tools.analysis.tolerances import parsed, tolerance_of
from trocar.tools.output.errors import Misuse, Problem

APP = cli.build()


def records(rows: NDArray[Any]) -> Records:
    return Records(rows, rows["stamp_ns"].astype(np.int64), np.ones(len(rows), np.int64))


def sane(count: int = 40, first: int = 1) -> NDArray[Any]:
    """Records whose numbers are small."""
    rows = rows_of(STATE, count, first=first)
    for name, field in (("position", 1.0), ("matrix", 2.0)):
        rows[name] = field * np.arange(rows[name].size).reshape(rows[name].shape)
    return rows


def saved(folder: Path, name: str, rows: NDArray[Any], topic: str = "state") -> Path:
    path = folder / name
    with path.open("wb", buffering=0) as stream:
        written(stream, {("PSM1", topic): (STATE, rows)})
    return path


def run(*words: Any) -> Result:
    return CliRunner().invoke(APP, ["compare", *map(str, words)])


def test_a_recording_is_equal_to_itself(tmp_path: Path) -> None:
    path = saved(tmp_path, "a.mcap", rows_of(STATE, 50))  # any bits, NaN among them
    found = run(path, path)
    assert found.exit_code == 0 and "equal: 50 records of 1 topics, bit for bit" in found.stdout, found


def test_the_same_number_of_another_type_is_not_the_same(tmp_path: Path) -> None:
    a, b = (np.zeros(3, [("sequence", "<u8"), ("stamp_ns", "<i8"), ("value", kind)]) for kind in ("<f8", "<f4"))
    found = compared("PSM1/state", records(a), records(b), STAMP)
    assert found.unknown == ("value",) and not found.is_equal and not found.is_within


def test_what_the_first_has_not_recorded_is_not_compared_where_the_second_repeats_it(tmp_path: Path) -> None:
    whole, some = tmp_path / "whole.mcap", tmp_path / "some.mcap"
    for path, count in ((whole, 20), (some, 0)):
        with path.open("wb", buffering=0) as stream:
            written(stream, {("PSM1", "state"): (STATE, sane(20)), ("boards", "state"): (STATE, sane(count))})
    with open_recording(some) as one, open_recording(whole) as other:
        again = Comparing(STAMP, as_a=True).of(one, other)
        assert again.outcome == "equal" and "not recorded: boards/state" in again.left_out
        assert Comparing(STAMP).of(one, other).outcome == "different"
        assert Comparing(STAMP, as_a=True).of(other, one).outcome == "different"


@pytest.mark.slow
def test_a_difference_is_told_with_its_place_and_size(tmp_path: Path) -> None:
    rows = sane()
    other = rows.copy()
    other["position"][7, 1] += 0.25
    other["position"][9, 0] -= 0.5
    a, b = saved(tmp_path, "a.mcap", rows), saved(tmp_path, "b.mcap", other)
    found = run(a, b, "--json")
    said = json.loads(found.stdout)
    (field,) = said["topics"][0]["fields"]
    assert found.exit_code == 1 and said["outcome"] == "different" and field["field"] == "position"
    assert (field["differing"], field["max"], field["unit"]) == (2, 0.5, "rad")
    assert field["first"] == {"stamp_ns": 7 * STEP_NS + 5, "sequence": 8, "element": 1, "a": 15.0, "b": 15.25}
    assert field["worst"]["sequence"] == 10 and field["rms"] == pytest.approx(np.sqrt((0.25**2 + 0.5**2) / 80))
    shown = run(a, b)
    assert "PSM1/state.position" in shown.stdout and "different" in shown.stdout.splitlines()[-1]


@pytest.mark.slow
def test_what_is_within_its_tolerance_is_fine(tmp_path: Path) -> None:
    rows = sane()
    other = rows.copy()
    other["position"] += 0.001
    a, b = saved(tmp_path, "a.mcap", rows), saved(tmp_path, "b.mcap", other)
    for tolerance, code in (("position=1.1mrad", 0), ("PSM1/*.position=0.1deg", 0), ("0.0011", 0), ("1.1mrad", 0),
                            ("position=0.9mrad", 1), ("1mm", 1), ("matrix=1", 1)):
        found = run(a, b, "--tolerance", tolerance)
        assert found.exit_code == code, (tolerance, found)
    assert "within the tolerances" in run(a, b, "--tolerance", "0.01").stdout
    assert run(a, b, "--tolerance", "position=1parsec").exit_code == 2


@pytest.mark.slow
def test_records_that_one_lacks_are_told(tmp_path: Path) -> None:
    rows = sane()
    a, b = saved(tmp_path, "a.mcap", rows), saved(tmp_path, "b.mcap", np.delete(rows, [3, 4, 39]))
    found = run(a, b)
    assert found.exit_code == 1 and "3 records are only in A" in found.stdout
    assert run(b, a, "--json").stdout.count('"only_b": 3') == 1
    assert run(a, saved(tmp_path, "c.mcap", rows[5:30]), "--common").exit_code == 0


@pytest.mark.slow
def test_a_topic_that_one_lacks_is_told(tmp_path: Path) -> None:
    a, b = saved(tmp_path, "a.mcap", sane()), saved(tmp_path, "b.mcap", sane(), topic="setpoint")
    found = run(a, b)
    assert found.exit_code == 1 and "only A has PSM1/state" in found.stdout and "no topic in common" in found.stdout
    assert run(a, a, "--topics", "PSM2/state").exit_code == 1 and run(a, a, "--topics", "PSM?/*").exit_code == 0


@pytest.mark.slow
def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    good, bad = saved(tmp_path, "a.mcap", sane()), tmp_path / "bad.mcap"
    bad.write_bytes(b"x" * 100)
    assert "is no MCAP file" in run(good, bad).stderr
    assert "no such file" in run(good, tmp_path / "none.mcap").stderr
    assert run(good, good, "--align", "colour").exit_code == 2


def test_runs_that_begin_at_other_times_are_aligned() -> None:
    rows, later = sane(), sane(first=100)
    later["stamp_ns"] += 123_456_789_000
    for how, count in ((STAMP, 0), (START, 40), (SEQUENCE, 0)):
        assert len(paired(records(rows), records(later), how)) == count, how
    assert compared("t", records(rows), records(later), START).is_equal
    assert len(in_common(records(rows), records(later))[0].rows) == 0


@examples(60)
@given(st.lists(st.integers(-400_000, 400_000), min_size=40, max_size=40), st.sets(st.integers(1, 38), max_size=10))
def test_jitter_below_half_a_period_pairs_the_right_records(jitter: list[int], gone: set[int]) -> None:
    rows = sane()
    other = np.delete(rows, sorted(gone))
    other["stamp_ns"] += np.delete(np.array(jitter), sorted(gone))
    pairs = paired(records(rows), records(other), STAMP)
    assert np.array_equal(rows["sequence"][pairs.a], other["sequence"][pairs.b])
    assert set(rows["sequence"][pairs.only_a] - 1) == gone and not len(pairs.only_b)


@examples(100)
@given(st.lists(st.tuples(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1)), min_size=1))
def test_whole_numbers_do_not_overflow(pairs: list[tuple[int, int]]) -> None:
    a, b = np.array(pairs, np.int64).T.reshape(2, -1, 1)
    assert np.allclose(distance(a, b)[:, 0], [abs(x - y) for x, y in pairs], rtol=1e-12)
    assert np.array_equal(same(a, b)[:, 0], [x == y for x, y in pairs])


def test_nan_is_nan_and_infinity_no_number() -> None:
    a = np.array([[np.nan, np.inf, -np.inf, 0.0, 1.0, np.nan]])
    b = np.array([[np.nan, np.inf, np.inf, -0.0, np.nan, 1.0]])
    assert same(a, b).tolist() == [[True, True, False, False, False, False]]
    assert np.isnan(distance(a, b)[0]).tolist() == [True, False, True, False, True, True]


def test_fields_that_one_lacks_are_told_and_chosen_ones_left_out() -> None:
    rows = sane()
    places: Any = rows.dtype.fields
    form = {"names": ["error" if name == "fault" else name for name in places], "itemsize": rows.dtype.itemsize,
            "formats": [place[0] for place in places.values()], "offsets": [place[1] for place in places.values()]}
    other = rows.view(np.dtype(form))
    found = compared("t", records(rows), records(other), STAMP)
    assert found.unknown == ("fault", "error") and not found.is_within
    assert compared("t", records(rows), records(rows), STAMP, ("position",)).is_equal


def test_tolerances_by_name_count_before_those_by_unit() -> None:
    those = [parsed("1e-3"), parsed("1mm"), parsed("position=2mrad"), parsed("position=3mm"), parsed("2deg")]
    assert tolerance_of(those, "PSM1/state", "position", "rad|m") == pytest.approx(2e-3)
    assert tolerance_of(those, "PSM1/state", "position", "m") == pytest.approx(3e-3)
    assert tolerance_of(those, "PSM1/state", "other", "rad|m") == pytest.approx(1e-3)
    assert tolerance_of(those, "PSM1/state", "other", "V") == pytest.approx(1e-3)
    assert tolerance_of(those, "PSM1/state", "stamp_ns", "ns") == 0.0 == tolerance_of([], "t", "f", "rad")
    for text in ("", "x", "position=", "-1", "nan", "1e", "=1", "position=1=2"):
        with pytest.raises(Misuse):
            parsed(text)


@pytest.mark.slow
def test_a_picture_shows_what_differs(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows = sane()
    other = rows.copy()
    other["position"][20:] += 0.1
    a, b = saved(tmp_path, "a.mcap", rows), saved(tmp_path, "b.mcap", other)
    found = run(a, b, "--plot", tmp_path / "d.png")
    assert "PSM1/state.position" in found.stderr, found
    assert (tmp_path / "d.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.slow
def test_what_was_computed_on_demand_in_one_of_them_is_left_out(tmp_path: Path) -> None:
    schema = schema_of(ARM_STATE)
    rows = np.zeros(20, schema.dtype)
    rows["sequence"], rows["stamp_ns"] = np.arange(20) + 1, np.arange(20) * STEP_NS
    other = rows.copy()
    other["body_measured_cf"][:10] = np.nan
    paths = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for path, each in zip(paths, (rows, other), strict=True):
        with path.open("wb", buffering=0) as stream:
            written(stream, {("PSM1", "state"): (schema, each)})
    found = run(*paths)
    assert found.exit_code == 0 and "not requested all the time: PSM1/state.body_measured_cf" in found.stdout
    other["body_measured_cf"] = 1.0
    with paths[1].open("wb", buffering=0) as stream:
        written(stream, {("PSM1", "state"): (schema, other)})
    assert run(*paths).exit_code == 1


def steady(folder: Path, name: str, kind: str = names.NAMED, **topics: tuple[int, int]) -> Path:
    """Topics of an instance each with a rate, from one ms to another; those called `e…` come on events."""
    path, table = folder / name, ChannelTable()
    with path.open("wb", buffering=0) as stream:
        file, chunk = RecordingFile(stream, table, {names.SYSTEM: {"kind": kind, "system": "x"}}), Chunk()
        for topic, (begin, end) in topics.items():
            rate = {} if topic.startswith("e") else {"rate_hz": 1000.0}
            channel, layout = table.ring("PSM1", topic, "arm", STATE, 1, rate)
            for row in sane(end, 1)[begin:end]:
                chunk.add(channel, int(row["sequence"]), BEGIN_NS + int(row["stamp_ns"]), int(row["stamp_ns"]),
                          ENCAPSULATION, row.tobytes()[: layout.size])
        file.put(packed(chunk, ""))
        file.finish()
    return path


def outcome(a: Path, b: Path, how: str = STAMP, topics: list[str] | None = None) -> dict[str, Any]:
    with open_recording(a) as one, open_recording(b) as other:
        return as_dict(Comparing(how, topics, common=True).of(one, other))


def test_the_common_time_is_one_for_all_topics(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.tools.analysis.common_time.SLACK_NS", 30_000_000)
    a = steady(tmp_path, "a.mcap", one=(0, 200), two=(5, 198))
    found = outcome(a, steady(tmp_path, "b.mcap", one=(40, 300), two=(40, 300)))
    assert found["outcome"] == "equal" and found["compared"] == 2 * 158
    assert any("0.040 to 0.197 s of A and" in text for text in found["left_out"])
    died = outcome(a, steady(tmp_path, "died.mcap", one=(0, 200), two=(5, 100)))
    assert died["outcome"] == "different", "its process died in B alone"
    assert {row["topic"]: row["only_a"] for row in died["topics"]} == {"PSM1/one": 0, "PSM1/two": 98}
    late = outcome(a, steady(tmp_path, "late.mcap", one=(0, 200), two=(100, 198)))
    assert late["outcome"] == "different"
    dump = steady(tmp_path, "dump.mcap", names.DUMP, one=(0, 200), two=(100, 198))
    assert outcome(a, dump)["outcome"] == "equal", "its ring was not deeper"


def test_events_are_compared_as_far_back_as_both_have_them(tmp_path: Path) -> None:
    a = steady(tmp_path, "a.mcap", names.DUMP, state=(150, 200), events=(10, 60))
    found = outcome(a, steady(tmp_path, "b.mcap", state=(0, 200), events=(0, 60)))
    assert found["outcome"] == "equal" and found["compared"] == 100
    less = outcome(a, steady(tmp_path, "less.mcap", state=(0, 200), events=(0, 59)))
    assert less["outcome"] == "different", "the last event is in A alone"
    none = outcome(steady(tmp_path, "late.mcap", state=(0, 200), events=(190, 200)),
                   steady(tmp_path, "none.mcap", state=(0, 200), events=(0, 0)))
    assert none["outcome"] == "different"


def test_runs_at_other_times_have_their_first_seconds_in_common(tmp_path: Path) -> None:
    a, b = steady(tmp_path, "a.mcap", state=(0, 100)), steady(tmp_path, "b.mcap", state=(500, 700))
    with pytest.raises(Problem, match="no time in common; --align start"):
        outcome(a, b)
    for one, other in ((a, b), (b, a)):
        [topic] = outcome(one, other, START)["topics"]
        assert (topic["compared"], topic["only_a"], topic["only_b"]) == (100, 0, 0)
    assert outcome(a, b, SEQUENCE)["outcome"] == "different", "no number is in both"


def test_nothing_that_was_compared_is_never_equal(tmp_path: Path) -> None:
    a, b = saved(tmp_path, "a.mcap", sane(0)), saved(tmp_path, "b.mcap", sane(0))
    found = run(a, b)
    assert found.exit_code == 1 and "nothing was compared" in found.stdout, found
    rows = saved(tmp_path, "c.mcap", sane(40))
    with open_recording(rows) as one, open_recording(rows) as other:
        none = Comparing(STAMP).of(one, other, (Stretch(1 << 40), Stretch(1 << 40)))
    assert none.outcome == "different" and none.compared == 0
