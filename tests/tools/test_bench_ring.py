"""`trocar bench ring` measures in fresh processes and leaves nothing behind."""

from __future__ import annotations

import math

import pytest

from shm.segment import names_of
from tools import bench_ring
from tools.errors import Problem


@pytest.mark.slow
def test_every_figure_is_a_time() -> None:
    result = bench_ring.run(0.2)
    assert result["bench"] == "ring"
    assert {"round_trip_us_p50", "round_trip_us_p99", "publish_ns_p50", "newest_ns_p50", "mailbox_us_p50",
            "wakeup_us_p50"} <= set(result["figures"])
    assert all(math.isfinite(x) and x > 0 for x in result["figures"].values())
    assert result["conditions"]["payload_bytes"] == 216
    assert not [parts for parts in names_of() if parts[0].startswith("bench")]


@pytest.mark.slow
def test_a_child_that_fails_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*arguments: object) -> None:
        raise Problem("broken")

    monkeypatch.setattr(bench_ring, "create_mailbox", broken)
    with pytest.raises(Problem, match="broken"):
        bench_ring.run(0.1)
    with pytest.raises(Problem, match="owner ended with 1"):
        bench_ring._children("nosuchsystem", 0.1, [0], "owner")
    assert not [parts for parts in names_of() if parts[0].startswith("bench")]


def test_a_wrong_child_call_is_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_ring.main(["--child", "nobody", "a", "0", "1"]) == 2
    assert "trocar bench ring" in capsys.readouterr().err


def test_one_core_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "the only core" in bench_ring._conditions([3])["pinned"]
    assert bench_ring._conditions([0, 1])["pinned"] == "0 and 1"
