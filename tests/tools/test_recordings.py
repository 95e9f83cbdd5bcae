"""Recordings of a master: what a file may be, and what it shows between its rows."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import typer

from trocar.procs.config import PROJECT_CONFIGS
from trocar.tools.cli import guarded
from trocar.tools.client import provider
from trocar.tools.examples.recorded_master import place_in, recorded_master
from trocar.tools.examples.recordings import read_recording
from trocar.tools.output.errors import Problem

HEAD = "time,x,y,z,qx,qy,qz,qw,gripper,clutch"
ROWS = ("10,0,0,0,0,0,0,1,0,0", f"10.5,0.1,0,0,0,0,{math.sin(0.25)},{math.cos(0.25)},1,1", "11,0.1,0,0,0,0,0,1,1,0")


def written(tmp_path: Path, *lines: str) -> Path:
    file = tmp_path / "hand.csv"
    file.write_text("\n".join(lines))
    return file


def test_between_rows_it_goes_straight_and_turns_about_one_axis(tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path, "# a comment", HEAD, "", *ROWS))
    assert recording.seconds == 1.0
    moment = recording.at(0.25)
    assert moment.pose == pytest.approx([0.05, 0, 0, 0, 0, math.sin(0.125), math.cos(0.125)])
    assert moment.twist == pytest.approx([0.2, 0, 0, 0, 0, 1.0]) and moment.gripper == 0.5
    assert not moment.pressed and recording.at(0.6).pressed == {"clutch"}
    assert recording.at(0.25, -1.0).twist == pytest.approx([-0.2, 0, 0, 0, 0, -1.0])
    for outside in (-1.0, 5.0):
        assert np.array_equal(recording.at(outside).twist, np.zeros(6))
    assert recording.at(5.0).pose[0] == 0.1 and not recording.at(5.0).pressed


def test_a_recording_without_gripper_and_buttons_will_do(tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path, "time,x,y,z,qx,qy,qz,qw", "0,0,0,0,0,0,0,1", "1,0,0,0,0,0,0,-1"))
    moment = recording.at(0.5)
    assert moment.gripper is None and np.abs(moment.pose[3:6]).max() == 0.0, "q and -q are the same"


def test_it_plays_to_and_fro(tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path, HEAD, *ROWS))
    assert [place_in(recording, passed, 2.0) for passed in (0.25, 0.75, 1.25)] == [(0.5, 2.0), (0.5, -2.0), (0.5, 2.0)]


@pytest.mark.parametrize(
    ("lines", "says"),
    [((), "hand.csv:0: the first line has no column time, x"),
     (("time,x,y,z,qx,qy,qz", ROWS[0]), "hand.csv:1: the first line has no column qw"),
     ((HEAD + ",x", ROWS[0]), "names a column twice"),
     ((HEAD, ROWS[0]), "1 rows; a recording has two at least"),
     ((HEAD, ROWS[0], "11,0,0"), "hand.csv:3: 3 values; needed are 10"),
     ((HEAD, ROWS[0], ROWS[1].replace("0.1", "nan")), "hand.csv:3: 10 values; needed are 10 finite numbers"),
     ((HEAD, ROWS[0], ROWS[1].replace("0.1", "far")), "hand.csv:3: could not convert"),
     ((HEAD, ROWS[0], "11,0,0,0,0,0,0,2,0,0"), "hand.csv:3: quaternion has length 2"),
     ((HEAD, ROWS[1], ROWS[0]), "hand.csv:3: time 10 does not come after 10.5")],
)
def test_mistakes_are_told_with_their_line(tmp_path: Path, lines: tuple[str, ...], says: str) -> None:
    with pytest.raises(Problem) as caught:
        read_recording(written(tmp_path, *lines))
    assert says in str(caught.value)


def test_the_player_finds_a_stock_file_from_any_folder_and_says_that_there_is_no_system(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    connected = provider.connected
    monkeypatch.setattr(provider, "connected", lambda attach, timeout, what: connected(attach, 0.0, what))
    with pytest.raises(typer.Exit) as ended:
        guarded(recorded_master)(Path("configs/recordings/circle.csv"), system="nosuch", rate=200.0)
    assert ended.value.exit_code == 1
    assert "trocar: MTMR is not connected after 0 s: no system nosuch is up" in capsys.readouterr().err


def test_the_project_s_own_recording_moves_as_a_hand_does() -> None:
    recording = read_recording(PROJECT_CONFIGS / "recordings/circle.csv")
    moments = [recording.at(time) for time in np.arange(0.0, recording.seconds, 0.01)]
    assert max(float(np.abs(moment.twist[:3]).max()) for moment in moments) < 0.2
    grippers = [moment.gripper for moment in moments if moment.gripper is not None]
    assert max(grippers) - min(grippers) > math.radians(40), "it shows presence"
    assert np.allclose(moments[0].pose, moments[-1].pose, atol=1e-6)
