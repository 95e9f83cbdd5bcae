"""Stamps of records in time of day."""

from __future__ import annotations

import pytest

from trocar.procs.crtk import views


def test_the_same_record_keeps_its_stamp_until_the_time_of_day_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    local = [1_000_000_000]
    monkeypatch.setattr(views, "local_ns", lambda: local[0])
    monkeypatch.setattr(views, "monotonic_ns", lambda: 0)
    stamps = views.Stamps(simulated=False)
    first = stamps.ns(5)
    for jitter in (1000, -700, 20_000):
        local[0] = 1_000_000_000 + jitter
        stamps.look()
        assert stamps.ns(5) == first
    local[0] = 9_000_000_000
    stamps.look()
    assert stamps.ns(5) == 9_000_000_005
