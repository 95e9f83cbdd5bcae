"""The past of a system, from its rings and the recorder's files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from tests.conftest import World
from tests.gui.test_browsers import Console, play
from tests.tools.robot import KEPT, ScriptedRobot, robot
from trocar.procs.document.system import from_json
from trocar.procs.gui.past import MAX_SPAN_MS, Past, _thinned
from trocar.procs.gui.timeline_source import A_LOOK, FILES_NS, LOOK_NS, MARKS, TimelineSource
from trocar.procs.gui.times import Times
from trocar.procs.recordings import names
from trocar.procs.recordings.facts import document_of, facts_of
from trocar.procs.recordings.snapshot import take
from trocar.procs.tables import codes
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns, monotonic_ns

STATE, PLOT = "PSM1/state", "plot:PSM1/state.position[1]"


class Then:
    """Times before the beginning of a test, however long that takes."""

    def __init__(self) -> None:
        self.monotonic_ns, self.local_ns = monotonic_ns(), local_ns()

    def stamp(self, ago_s: float) -> int:
        return self.monotonic_ns - round(ago_s * 1e9)

    def local(self, ago_s: float) -> int:
        return self.local_ns - round(ago_s * 1e9)


@contextmanager
def opened(scripted: ScriptedRobot, folder: Path) -> Iterator[Past]:
    """Its past, with recordings in this folder."""
    frozen = directory.document(scripted.name)
    with closing(Past(from_json(frozen), folder, frozen)) as past:
        yield past


def was(past: Past, at_ns: int, *sources: str, span_ms: int = 0, points: int = 1000) -> dict[str, Any]:
    """The data of sources so long ago."""
    at = at_ns // 1_000_000
    parts = {"at": at, "from": at - span_ms, "to": at, "points": points, "sources": sources}
    found: dict[str, Any] = orjson.loads(past.ask(parts, 1).result(30))
    assert found["id"] == 1 and found["at"] == at
    assert found["known"] == any(row["age"] is not None for name, row in found["data"].items() if name == STATE)
    return dict(found["data"])


def kept(scripted: ScriptedRobot, folder: Path, kind: str, at_ns: int, reason: str = "") -> Path:
    """The contents of its rings, as a file of the recorder."""
    path = folder / f"{kind}-{names.utc(at_ns)}.mcap"
    with path.open("wb") as file:
        take(scripted.name, file, facts_of(scripted.name, kind, "PSM1", reason), document_of(scripted.name))
    return path


def test_what_rings_keep_is_shown_as_it_was(world: World, tmp_path: Path) -> None:
    then = Then()
    with robot(world.name) as scripted, opened(scripted, tmp_path) as past:
        for age_s in (40.0, 30.0, 20.0):
            scripted.show_arm(age_s / 100, "ENABLED" if age_s > 25 else "FAULT", stamp_ns=then.stamp(age_s))
        found = was(past, then.local(29.0), STATE, "scene", "messages", "processes", "PSM9/state")
        assert found[STATE]["state"] == "ENABLED" and found[STATE]["position"][0] == 0.3
        assert found[STATE]["age"] == 1.0, "of that time, not of now"
        assert found["scene"]["arms"]["PSM1"]["state"] == "ENABLED" and found["scene"]["arms"]["PSM1"]["late"]
        assert found["messages"]["rows"] == []
        for name in ("processes", "PSM9/state"):
            assert found[name] == {"age": None, "problem": "not recorded"}
        assert was(past, then.local(19.0), STATE)[STATE]["state"] == "FAULT"
        assert was(past, then.local(60.0), STATE)[STATE]["age"] is None


def test_what_rings_have_lost_comes_from_recordings(world: World, tmp_path: Path) -> None:
    then = Then()
    with robot(world.name) as scripted, opened(scripted, tmp_path) as past:
        for k in range(KEPT - 1):
            scripted.show_arm(0.01 * k, "ENABLED", stamp_ns=then.stamp(100.0 - 0.1 * k))
        path = kept(scripted, tmp_path, names.BOX, then.local(100.0))
        for k in range(2 * KEPT):
            scripted.show_arm(9.0, "FAULT", stamp_ns=then.stamp(20.0 - 0.01 * k))
        found = was(past, then.local(97.0), STATE, PLOT, span_ms=2000)
        assert found[STATE]["state"] == "ENABLED" and abs(found[STATE]["position"][0] - 0.3) < 0.02
        samples = found[PLOT]
        assert len(samples["t"]) == len(samples["v"]) and 18 <= len(samples["t"]) <= 22
        assert all(0 < b - a < 0.2 for a, b in zip(samples["t"], samples["t"][1:], strict=False))
        assert abs(samples["t"][-1] - then.local(97.0) * 1e-9) < 0.2, "times of day"
        assert was(past, then.local(19.1), STATE)[STATE]["state"] == "FAULT"
        assert was(past, then.local(60.0), STATE)[STATE]["age"] is None, "there is a gap"
        path.unlink()
        assert was(past, then.local(97.0), STATE)[STATE]["age"] is None, "the recorder has removed it"


def test_recordings_of_another_configuration_are_left_out(world: World, tmp_path: Path) -> None:
    then = Then()
    with robot(world.name) as scripted:
        scripted.show_arm(0.5, stamp_ns=then.stamp(100.0))
        kept(scripted, tmp_path, names.BOX, then.local(100.0))
        (tmp_path / f"box-{names.utc(local_ns())}.mcap").write_bytes(b"no recording")
        for _ in range(2 * KEPT):
            scripted.show_arm()
        frozen = directory.document(scripted.name)
        for document, is_known in ((frozen, True), (frozen + b" ", False)):
            with closing(Past(from_json(frozen), tmp_path, document)) as past:
                assert (was(past, then.local(99.0), STATE)[STATE]["age"] is not None) == is_known


def test_thinned_samples_keep_peaks_and_are_few() -> None:
    values = np.zeros(30_011)
    values[[12_345, 30_010]] = 7.0, -3.0
    values[100:200] = np.nan
    times = np.arange(len(values)) * 1e-3
    found = _thinned({"age": 0.0, "t": times, "v": values}, 400)
    assert len(found["t"]) <= 600 and np.nanmax(found["v"]) == 7.0 and np.nanmin(found["v"]) == -3.0
    assert (np.diff(found["t"]) > 0).all()
    several = _thinned({"age": 0.0, "t": times, "v": [values, values]}, 400)
    assert len(several["v"]) == 2 and len(several["v"][1]) == len(several["t"])
    assert _thinned({"age": None}, 10) == {"age": None}


def test_a_fault_is_a_mark_with_its_cause_and_its_recording(world: World, tmp_path: Path) -> None:
    then = Then()
    with robot(world.name) as scripted, opened(scripted, tmp_path) as past:
        io = directory.writer(world.name, "IO1", "events", "io")
        kept(scripted, tmp_path, names.FAULT, then.local(3600.0), "PSM1: an hour ago")
        scripted.events.operating_state("ENABLED", "ENABLED", True, False)
        scripted.events.report(codes.TRACKING, "it does not follow", "PSM1")
        for _ in range(2):
            scripted.events.operating_state("FAULT", "FAULT", False, False)
        scripted.events.status("nothing of note")
        with closing(TimelineSource(from_json(directory.document(world.name)), past)) as source:
            source.read(LOOK_NS)
            kept(scripted, tmp_path, names.FAULT, local_ns() + 300_000_000, "PSM1: it does not follow")
            scripted.events.report(codes.FAULT_RECORDED, "kept in a file", "PSM1")
            assert source._looked is not None
            source._looked.result(30)
            past.look().result(30)
            found = source.read(LOOK_NS + FILES_NS)
        io.close()
        before, fault = found["marks"]
        assert before["text"] == "PSM1: an hour ago" and "t" not in before and before["file"].startswith("fault-")
        assert fault["kind"] == "fault" and fault["text"] == "PSM1: it does not follow" and fault["size"] > 0
        assert abs(fault["at"] - local_ns() // 1_000_000) < 60_000 and fault["file"] != before["file"]


def test_warnings_displace_no_fault_and_what_is_in_fault_now_is_its_present_state(world: World, tmp_path: Path) -> None:
    with robot(world.name, 4 * MARKS) as scripted, opened(scripted, tmp_path) as past:
        scripted.show_arm(state="FAULT")
        scripted.events.report(codes.TRACKING, "it does not follow", "PSM1")
        scripted.events.operating_state("FAULT", "FAULT", False, False)
        with closing(TimelineSource(from_json(directory.document(world.name)), past)) as source:
            look_ns = LOOK_NS
            for _ in range(2 * MARKS // A_LOOK + 2):
                for k in range(A_LOOK):
                    scripted.events.report(codes.TEMPERATURE_HIGH, f"warning {k}", "PSM1")
                found = source.read(look_ns := look_ns + LOOK_NS)
            kinds = [mark["kind"] for mark in found["marks"]]
            assert kinds == ["fault"] + ["warning"] * MARKS and "does not follow" in found["marks"][0]["text"]
            assert found["now"] == ["PSM1"], "long after the event"
            scripted.show_arm(state="DISABLED")
            assert source.read(look_ns + LOOK_NS)["now"] == [], "without any event"


def test_a_page_asks_one_question_at_a_time(world: World, tmp_path: Path) -> None:
    async def story(console: Console) -> None:
        frozen = directory.document(console.robot.name)
        with closing(Past(from_json(frozen), tmp_path, frozen)) as past:
            object.__setattr__(console.all.served, "past", past)
            browser, page = console.page()
            then = Then()
            console.robot.show_arm(0.25, stamp_ns=then.stamp(5.0))
            now = then.local_ns // 1_000_000

            def ask(**more: Any) -> None:
                parts = {"at": now, "from": now - 10_000, "to": now, "points": 100, "sources": [STATE, PLOT], **more}
                browser.handle(json.dumps({"op": "past", "id": 7, **parts}))

            ask()
            ask()
            await console.tick()
            assert "one question" in page.last("reply")["text"]
            while not any(message["op"] == "past" for message in page.heard):
                await console.tick()
            data = page.last("past")["data"]
            assert data[STATE]["position"][0] == 0.25 and data[PLOT]["v"] == [0.25]
            for wrong in ({"from": now - MAX_SPAN_MS - 1}, {"from": now, "to": now - 1}, {"at": -1}, {"at": 1.5},
                          {"sources": ["PSM1/state"] * 65}, {"sources": [PLOT] * 17}):
                before = len(page.heard)
                ask(**wrong)
                await console.tick()
                assert page.heard[-1]["op"] == "reply" and len(page.heard) == before + 1, wrong
            ask(at=now - 100)
            console.all.leave(browser)

    play(world.name, story)


def test_slow_simulated_time_has_its_times_of_day() -> None:
    times = Times(np.array([10, 0, 5]) * 10**9, np.array([1100, 1000, 1020]) * 10**9)
    assert times.local(np.array([-1, 0, 2, 7, 11]) * 10**9).tolist() == [
        999 * 10**9, 1000 * 10**9, 1008 * 10**9, 1052 * 10**9, 1101 * 10**9]
    assert [times.stamp(at * 10**9) // 10**9 for at in (1008, 1052, 1105, 0)] == [2, 7, 15, 0]
