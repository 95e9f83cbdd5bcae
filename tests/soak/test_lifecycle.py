"""A walk of starts, stops, subscriptions, kills and hangs. By hand: python -m tests.soak.lifecycle --seed 7."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.soak.lifecycle import RandomWalk, order

SEED = int(os.environ.get("TROCAR_LIFECYCLE_SEED", "33"))  # in few steps, each kind of step


@pytest.mark.slow
def test_nobody_is_forgotten_and_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    assert RandomWalk(SEED, tmp_path).run(16, "paced") == []


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("clock", ["wall", "lockstep"])
def test_nobody_is_forgotten_in_the_long_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: str) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    assert RandomWalk(SEED, tmp_path).run(300, clock) == []


def test_notes_out_of_order_are_found() -> None:
    assert order(["7 setup", "7 main", "7 quit", "8 setup", "8 main", "9 setup", "9 quit"]) == []
    assert order(["7 setup", "8 setup", "7 main"]) == ["7 main while another one ran, or before its setup"]
    assert order(["7 main"]) == ["7 main while another one ran, or before its setup", "process 7 did main"]
    assert order(["7 setup", "7 quit", "7 main"]) == ["process 7 did setup quit main"]
