"""A ring at full speed between real processes: no record is torn."""

from __future__ import annotations

from typing import Any

import pytest

from trocar.shm.memory.segment import segment_name
from trocar.shm.system.directory import create_ring
from trocar.shm.topics import Field, Topic

STRESS = Topic("stress", "io", 0, 0, (Field("check", "<u8", "", "sum"), Field("data", "(27,)<u8", "", "numbers")),
               depth=3)
STRESS_WRITER = """
import select, sys, time
import numpy as np
from trocar.shm.ring.ring import RingWriter
from trocar.shm.memory.segment import Segment
writer = RingWriter(Segment(sys.argv[2], write=True), "io")
check, data = writer.field("check"), writer.field("data")
add = np.arange(27, dtype=np.uint64)
end = time.monotonic() + float(sys.argv[3])
while time.monotonic() < end or not select.select([sys.stdin], [], [], 0)[0]:
    for _ in range(100):
        np.add(add, np.uint64(writer.sequence * 0x9E3779B9), out=data)
        check[...] = data.sum()
        writer.publish(time.monotonic_ns())
writer.publish(1)  # the last one
print(writer.sequence)
"""
STRESS_READER = """
import sys, time
from trocar.shm.ring.ring import RingReader
from trocar.shm.memory.segment import Segment
reader = RingReader(Segment(sys.argv[2]))
verb = getattr(reader, sys.argv[3])
check, data = reader.field("check"), reader.field("data")
print("ready", flush=True)
good = bad = backwards = last = 0
end = time.monotonic() + 60
while reader.stamp_ns != 1 and time.monotonic() < end:
    if verb():
        if int(data.sum()) == int(check[()]):
            good += 1
            if good == 2: print("going", flush=True)
        else: bad += 1
        if reader.sequence < last or reader.sequence != int(reader.field("sequence")[()]): backwards += 1
        last = reader.sequence
print(good, bad, backwards)
"""


@pytest.mark.slow
def test_no_record_is_torn_at_full_speed(world: Any) -> None:
    create_ring(world.name, "io", STRESS, {}, {})
    name = segment_name(world.name, "io", "stress")
    readers = [world.start(STRESS_READER, name, verb) for verb in ("newest", "newest", "next")]
    assert all(r.stdout.readline() == "ready\n" for r in readers)
    writer = world.start(STRESS_WRITER, name, "1.0")  # or longer, until its input closes
    assert all(r.stdout.readline() == "going\n" for r in readers)
    written = int(world.finish(writer))
    counts = [tuple(map(int, world.finish(r).split())) for r in readers]
    world.remove()
    assert written > 1000
    assert all(good > 1 for good, _, _ in counts), counts
    assert all((bad, backwards) == (0, 0) for _, bad, backwards in counts), counts
