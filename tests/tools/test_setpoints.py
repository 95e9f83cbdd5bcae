"""Files of setpoints, tracking errors, and JSON values."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.tools.robot import ScriptedRobot, nothing_ages, robot
from trocar.procs.tables import codes
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client import following
from trocar.tools.client.following import Follower, HeldUp, beats
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import Watch
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import plain
from trocar.tools.verbs.setpoints import clipped, read_setpoints


def written(path: Path, rows: list[str]) -> Path:
    file = path / "rows.csv"
    file.write_text("\n".join(rows) + "\n")
    return file


def test_blocks_are_positions_velocities_and_efforts(tmp_path: Path) -> None:
    file = written(tmp_path, [",".join(str(i) for i in range(21))] * 3)
    rows = read_setpoints(file, 6, True)
    assert len(rows) == 3
    assert rows.position[0].tolist() == list(range(6))
    assert rows.velocity is not None
    assert rows.velocity[0].tolist() == list(range(7, 13))
    assert rows.jaw is not None
    assert rows.jaw.tolist() == [6, 6, 6]


def test_a_header_is_skipped_and_a_jaw_may_be_absent(tmp_path: Path) -> None:
    rows = read_setpoints(written(tmp_path, ["a,b,c,d,e,f", "1,2,3,4,5,6"]), 6, True)
    assert (rows.velocity, rows.jaw) == (None, None)
    assert rows.position.tolist() == [[1, 2, 3, 4, 5, 6]]


def test_seven_bare_joints_have_no_jaw(tmp_path: Path) -> None:
    rows = read_setpoints(written(tmp_path, [",".join(["1"] * 21)]), 7, False)
    assert rows.position.shape == (1, 7)
    assert rows.jaw is None


@pytest.mark.parametrize(
    ("rows", "reported"),
    [
        (["1,2,3"], "3 columns; for 6 joints"),
        (["1,2,3,4,5,6", "1,2,x,4,5,6"], "line 2"),
        (["1,2,3,4,5,6", "1,2,3"], "3 to 6 columns"),
        (["1,2,3,4,5,nan"], "finite"),
        (["a,b"], "no rows"),
    ],
)
def test_bad_files_are_refused_with_the_reason(tmp_path: Path, rows: list[str], reported: str) -> None:
    with pytest.raises(Problem, match=reported):
        read_setpoints(written(tmp_path, rows), 6, True)


def test_clipping_says_how_much_and_how_often() -> None:
    inside, cut = clipped(np.array([-1.0, 0.0, 0.5, 2.0]), -0.5, 1.0)
    assert inside.tolist() == [-0.5, 0.0, 0.5, 1.0]
    assert (cut.rows, cut.most) == (2, 1.0)


def test_late_periods_are_skipped_and_counted() -> None:
    skipped = [0]
    numbers = list(beats(1e6, 5000, skipped))
    assert len(numbers) + skipped[0] == 5000
    assert numbers == sorted(set(numbers))


def test_a_stream_that_stalled_does_not_continue(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = 0

    def wait(seconds: float) -> None:
        nonlocal now_ns
        now_ns += round(seconds * 1e9)

    for name in ("monotonic_ns", "boottime_ns"):
        monkeypatch.setattr(following, name, lambda: now_ns)
    monkeypatch.setattr(following, "pause", wait)
    skipped = [0]
    numbers = beats(100.0, None, skipped, 0.1)
    assert [next(numbers) for _ in range(50)] == list(range(50))
    wait(0.09)
    assert next(numbers) == 58 and skipped == [8], "late, not held up"
    wait(1.5)
    with pytest.raises(HeldUp, match=r"stalled for 1\.5 s"):
        next(numbers)


class SlowTime:
    """Simulated time of a busy machine: it passes while one waits for it, and real time does not matter."""

    simulated = True

    def __init__(self) -> None:
        self.now = 7_000_000_000

    def now_ns(self) -> int:
        return self.now

    def pause_until(self, deadline_ns: int, real_s: float | None) -> None:
        self.now = deadline_ns


def test_goals_of_a_stream_go_by_the_systems_time_however_slow_that_is(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("monotonic_ns", "boottime_ns", "pause"):
        monkeypatch.setattr(following, name, lambda *_: pytest.fail("real time was asked for"))
    skipped, time = [0], SlowTime()
    numbers: Any = beats(200.0, 1000, skipped, 0.1, cast(SystemTime, time))
    assert [(number, time.now - 7_000_000_000) for number in numbers] == [
        (k, 5_000_000 * (k + 1)) for k in range(1000)] and skipped == [0]
    numbers = beats(200.0, None, skipped, 0.1, cast(SystemTime, time))
    next(numbers)
    time.now += 200_000_000
    with pytest.raises(HeldUp):
        next(numbers)


def test_json_knows_no_nan() -> None:
    assert plain({"a": np.array([1.0, np.nan]), "b": b"x\0", "c": math.inf, "d": np.float64(2)}) == {
        "a": [1.0, None], "b": "x", "c": None, "d": 2.0,
    }


@pytest.fixture
def kinematic(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    nothing_ages(monkeypatch)
    with robot(world.name) as made:
        yield made


def test_samples_are_compared_with_the_row_in_force(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(9.0, "ENABLED", homed=True)
    with Watch(kinematic.name, "PSM1") as watch, Remote(kinematic.name, "PSM1") as remote:
        watch.look()
        follower = Follower(watch, remote, True, SystemTime(""))
        kinematic.show_arm(5.0, "ENABLED", homed=True)  # before the first row: not compared
        follower.send(np.full(6, 1.0), np.zeros(6), 1.0)
        kinematic.show_arm(1.5, "ENABLED", homed=True)
        follower.send(np.full(6, 2.0), np.zeros(6), 2.0)  # the sample before is drained after it, and is the first's
        kinematic.show_arm(1.5, "ENABLED", homed=True)
        follower.collect()
        assert follower.tracking.samples == 2
        assert np.allclose(follower.tracking.rms, 0.5)
        assert np.allclose(follower.tracking.most, 0.5)
        names = [command.name for command in kinematic.mailbox.drain()]
        assert names == ["servo_jp", "jaw/servo_jp"] * 2


def test_following_ends_when_the_arm_faults(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(0.0, "ENABLED", homed=True)
    with Watch(kinematic.name, "PSM1") as watch, Remote(kinematic.name, "PSM1") as remote:
        watch.look()
        follower = Follower(watch, remote, False, SystemTime(""))
        kinematic.events.report(codes.WATCHDOG, "the boards cut the amplifiers")
        kinematic.show_arm(0.0, "FAULT")
        with pytest.raises(Problem, match="FAULT: the boards cut"):
            follower.collect()
