"""`trocar bench ring`: fair arithmetic, missing peers told, and nothing left behind."""

from __future__ import annotations

import ctypes
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from trocar.shm.memory.layout import schema_of
from trocar.shm.memory.segment import FOLDER, names_of
from trocar.shm.ring import ring
from trocar.shm.topics import PROBE, PROBE_4K
from trocar.tools.bench import peers as bench_peers
from trocar.tools.bench import ring as bench_ring
from trocar.tools.bench.ring import FIGURES, PEERS, SOURCE, RingTurns
from trocar.tools.output.errors import Problem

Left = Callable[[], list[str]]
READY = "print('{}', flush=True)\n"
NEEDS_GCC = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not there")


def trip(p50: int) -> dict[str, dict[str, int]]:
    return {"trip": {"p50": p50, "p99": 2 * p50, "n": 10}}


def others() -> dict[str, dict[str, int]]:
    return {name: {"p50": 100, "p99": 200, "n": 10} for name, _, _ in FIGURES.values() if name != "trip"}


def test_ratios_are_formed_of_turns_side_by_side() -> None:
    found = RingTurns()
    near, far, farther = trip(1000), trip(2000), trip(8000)  # three moods of the machine
    for ours in (near, near, far, far, farther, farther):
        found.keep(ours)
    found.keep(others())
    for ours, theirs in ((near, 8000), (far, 12000), (farther, 40000)):
        found.keep_peer("iceoryx2", ours, trip(theirs), ours)
    figures = found.all_figures()
    assert figures["ratio_vs_iceoryx2"] == 6.0  # of 8, 6 and 5
    assert figures["iceoryx2_us_p50"] == 12.0
    assert figures["round_trip_us_p50"] == 2.0 and figures["round_trip_us_p99"] == 4.0


def test_a_missing_module_is_told_with_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("iceoryx2", "zmq"):
        monkeypatch.setitem(sys.modules, module, None)
    for name in ("iceoryx2", "iceoryx2_tuned", "pyzmq"):
        commands, why = bench_ring._peer(name, "folder", (0, 1))
        assert commands == {} and why.endswith("pip install 'trocar[bench]'")
    for name in ("pipe", "queue"):
        commands, about = bench_ring._peer(name, "folder", (0, 1))
        assert commands and about.startswith("Python 3")


def test_a_missing_or_failing_gcc_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    commands, about = bench_ring._peer("c", str(tmp_path), (0, 1))
    assert not commands and "gcc is not there; sudo apt-get install" in about
    (tmp_path / "gcc").write_text("#!/bin/sh\necho 'no stdio.h' >&2\nexit 1\n")
    (tmp_path / "gcc").chmod(0o755)
    assert bench_ring._peer("c", str(tmp_path), (0, 1)) == ({}, "gcc failed: no stdio.h")


def test_all_send_records_of_the_same_size() -> None:
    sizes = {schema_of(PROBE).dtype.itemsize - 16, ctypes.sizeof(bench_peers.PeerRecord), bench_peers.PAYLOAD,
             len(bench_peers.QUESTION), len(bench_peers.END)}
    assert sizes == {216}
    assert schema_of(PROBE_4K).dtype.itemsize - 16 == 4096


def test_the_c_program_follows_the_ring() -> None:
    text = SOURCE.read_text(encoding="utf-8")
    constants = {key: int(value) for key, value in re.findall(r"(\w+) = (\d+)[,; ]", text)}
    assert (constants["DEPTH"], 8 * constants["VALUES"]) == (PROBE.depth, 216)
    match = re.search(r"#define BUSY \(UINT64_C\(1\) << (\d+)\)", text)
    assert match and 1 << int(match[1]) == ring.BUSY
    assert re.findall(r"/\* ([WSR]\d)\b", text) == ["W2", "W3", "W4", "W1", "S1", "R2", "R3"]


@NEEDS_GCC
def test_the_c_program_compiles_without_a_warning(tmp_path: Path) -> None:
    strict = ("-Wall", "-Wextra", "-Werror")
    done = subprocess.run(["gcc", *bench_ring.FLAGS, *strict, "-o", tmp_path / "pingpong", SOURCE],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Left:
    """What a bench of this process has left in shared memory and in the folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    own = (f"trocar-bench{os.getpid()}-*", f"trocar~bench{os.getpid()}-*", "sem.mp-*")
    before = {path for pattern in own[2:] for path in FOLDER.glob(pattern)}

    def look() -> list[str]:
        found = {path for pattern in own for path in FOLDER.glob(pattern)} - before
        return sorted(str(path) for path in found | set(tmp_path.iterdir()))

    return look


@pytest.mark.slow
def test_a_short_bench_gives_every_figure(left: Left, monkeypatch: pytest.MonkeyPatch) -> None:
    for readers in ("POLLERS", "LOOKERS"):
        monkeypatch.setattr(bench_ring, readers, 1)
    result = bench_ring.run(rounds=1, turn_s=0.01)
    figures, conditions = result["figures"], result["conditions"]
    there = {name for name in PEERS if not re.search("pip install|gcc is not there", conditions[name])}
    assert {"pipe", "queue"} <= there
    wanted = set(FIGURES) | {f"{name}_us_p50" for name in there} | {f"ratio_vs_{name}" for name in there}
    assert set(figures) == wanted, {name: conditions[name] for name in there}
    assert all(math.isfinite(x) and x > 0 for x in figures.values())
    for name in there:
        assert re.search(r"\d+\.\d+", conditions[name]), "a version"
    assert "1 poll" in conditions["publish_readers8"]
    assert left() == []


@pytest.mark.slow
def test_a_peer_that_fails_is_left_out_with_its_reason(monkeypatch: pytest.MonkeyPatch, left: Left) -> None:
    broken = {"c": "import sys; sys.exit('will not start')", "pipe": READY + "input(); raise SystemExit('has no turn')"}
    peer = bench_ring._peer

    def some(name: str, folder: str, cores: tuple[int, int]) -> tuple[dict[str, list[str]], str]:
        if name in broken:
            return {name: [sys.executable, "-c", broken[name]]}, "fine"
        return peer(name, folder, cores) if name == "queue" else ({}, "not asked for")

    own, trips = bench_ring._own, {name: row for name, row in FIGURES.items() if row[0] == "trip"}
    monkeypatch.setattr(bench_ring, "_own", lambda system, cores: {"trip": own(system, cores)["trip"]})
    monkeypatch.setattr(bench_ring, "FIGURES", trips)
    monkeypatch.setattr(bench_ring, "_peer", some)
    result = bench_ring.run(rounds=2, turn_s=0.005)
    assert set(result["figures"]) == set(trips) | {"queue_us_p50", "ratio_vs_queue"}
    assert result["conditions"]["c"] == "left out: bench ring, c: c ended with 1: will not start"
    assert result["conditions"]["pipe"] == "left out: bench ring, pipe: pipe ended with 1: has no turn"
    assert left() == []


@pytest.mark.slow
def test_a_part_of_ours_that_fails_ends_the_bench(monkeypatch: pytest.MonkeyPatch, left: Left) -> None:
    broken = {"trip": {"pong": [sys.executable, "-c", "raise SystemExit('no pong')"]}}
    monkeypatch.setattr(bench_ring, "_own", lambda system, cores: broken)
    monkeypatch.setattr(bench_ring, "_peer", lambda name, folder, cores: ({}, "not asked for"))
    with pytest.raises(Problem, match="pong ended with 1: no pong"):
        bench_ring.run(rounds=1, turn_s=0.01)
    assert left() == []
    assert not [parts for parts in names_of() if parts[0].startswith(f"bench{os.getpid()}")]
