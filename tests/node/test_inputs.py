"""A record of another process counts while it is fresh; a torn read leaves the one before to grow old."""

from __future__ import annotations

from typing import Any

import pytest

from trocar.procs.node.inputs import LATE_NS, Input

NOW = 5_000_000_000


class FakeRecord:
    def __init__(self) -> None:
        self.stamp_ns, self.epoch, self.whole = NOW, 1, True

    def field(self, name: str) -> Any:
        return name

    def newest(self) -> bool:
        return self.whole


@pytest.mark.parametrize(("age_ns", "fresh"), [(0, True), (LATE_NS, True), (LATE_NS + 1, False), (-LATE_NS - 1, False)])
def test_a_record_counts_while_it_is_fresh(age_ns: int, fresh: bool) -> None:
    record = Input(FakeRecord())
    record.look(NOW + age_ns)
    assert record.fresh is fresh and record.age_ns == abs(age_ns)


def test_no_record_is_never_fresh() -> None:
    ring = FakeRecord()
    ring.stamp_ns = 0
    record = Input(ring)
    record.look(1)
    assert not record.fresh and not record.sampled(0)


def test_a_torn_record_leaves_the_last_to_grow_old() -> None:
    ring = FakeRecord()
    record = Input(ring, 0.05)
    assert record.look(NOW)
    ring.whole = False
    assert not record.look(NOW + 50_000_000) and record.fresh and not record.sampled(0)
    record.look(NOW + 50_000_001)
    assert not record.fresh


def test_the_age_of_a_sample_counts_as_well() -> None:
    record = Input(FakeRecord())
    record.look(NOW + LATE_NS // 2)
    assert record.sampled(LATE_NS // 2) and not record.sampled(LATE_NS // 2 + 1)


def test_another_writer_is_told_once() -> None:
    ring = FakeRecord()
    record = Input(ring)
    seen = []
    for ring.epoch in (1, 1, 2, 2):
        record.look(NOW)
        seen.append(record.restarted)
    assert seen == [False, False, True, False]
