"""`trocar bench ring`: how long shared memory takes, between fresh processes on two cores.

Each part starts its children as `python -m tools.bench_ring --child ROLE SYSTEM CORE SECONDS`; a child prints its times
(ns, one JSON list a line) and ends. The system's name is the benchmark's own and is removed on every path.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from shm.client import Client
from shm.clock import monotonic_ns, pause
from shm.directory import create_ring
from shm.layout import schema_of
from shm.mailbox import Mailbox, create_mailbox
from shm.pulse import Pulse, create_control
from shm.ring import RingReader, RingWriter
from shm.segment import Segment, names_of, segment_name, unlink
from shm.topics import PROBE
from tools.errors import Problem

ROOT = Path(__file__).resolve().parent.parent
KEPT = 200_000  # times a child keeps
WARM_UP = 200
BATCH = 200
PATIENCE_S = 60.0
SPINS = range(100_000_000)  # polls before a child gives up on the other, who may have been killed
LAST = -1.0  # a stamp that says: this was the last one
COUNTER = count()


def run(seconds: float = 2.0) -> dict[str, Any]:
    """Measure for about `seconds`; one object with `bench`, `figures` and `conditions`."""
    cores = psutil.Process().cpu_affinity() or [0]
    part_s = seconds / 4
    with _world() as system:
        (publish, newest), = _children(system, part_s, cores, "local")
        _, rounds = _children(system, part_s, cores, "pong", "ping")
        mailbox, _ = _children(system, part_s, cores, "owner", "client")
        wakeup, _ = _children(system, part_s, cores, "waiter", "ringer")
    figures = {
        "round_trip_us_p50": _percentile(rounds[0], 50) / 1e3,
        "round_trip_us_p99": _percentile(rounds[0], 99) / 1e3,
        "publish_ns_p50": _percentile(publish, 50),
        "newest_ns_p50": _percentile(newest, 50),
        "mailbox_us_p50": _percentile(mailbox[0], 50) / 1e3,
        "mailbox_us_p99": _percentile(mailbox[0], 99) / 1e3,
        "wakeup_us_p50": _percentile(wakeup[0], 50) / 1e3,
        "wakeup_us_p99": _percentile(wakeup[0], 99) / 1e3,
    }
    rows = {"rounds": len(rounds[0]), "commands": len(mailbox[0]), "wake_ups": len(wakeup[0])}
    return {"bench": "ring", "figures": figures, "conditions": {**_conditions(cores), **rows}}


def _conditions(cores: list[int]) -> dict[str, Any]:
    first, second = _pair(cores)
    pinned = f"{first} and {second}" if first != second else f"{first}, the only core: polling processes alternate"
    model = next((line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
                  if line.startswith("model name")), platform.machine())
    return {
        "cpu": model,
        "cores": len(cores),
        "pinned": pinned,
        "load_1min": os.getloadavg()[0],
        "kernel": platform.release(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "payload_bytes": schema_of(PROBE).dtype.itemsize - 16,
    }


def _pair(cores: list[int]) -> tuple[int, int]:
    return cores[0], cores[-1]


def _percentile(times: list[int], q: float) -> float:
    return float(np.percentile(np.array(times), q))


@contextlib.contextmanager
def _world() -> Iterator[str]:
    """All segments of the benchmark, gone at the end."""
    system = f"bench{os.getpid()}-{next(COUNTER)}"
    try:
        for instance in ("ping", "pong"):
            create_ring(system, instance, PROBE, {}, {})
        create_mailbox(system, "owner", "arm")
        create_control(system, "ringer")
        yield system
    finally:
        for parts in names_of(system):
            unlink(segment_name(*parts))


def _children(system: str, seconds: float, cores: list[int], *roles: str) -> list[list[list[int]]]:
    """Run one or two children side by side; the lists of times each printed."""
    running: list[subprocess.Popen[str]] = []
    try:
        for role, core in zip(roles, _pair(cores), strict=False):
            command = [sys.executable, "-m", "tools.bench_ring", "--child", role, system, str(core), str(seconds)]
            running.append(subprocess.Popen(command, cwd=ROOT, text=True, stdin=subprocess.DEVNULL,
                                            stdout=subprocess.PIPE, stderr=subprocess.PIPE))
        said = [child.communicate(timeout=PATIENCE_S + seconds) for child in running]
    except subprocess.TimeoutExpired:
        raise Problem(f"bench ring: {' and '.join(roles)} did not end") from None
    finally:
        for child in running:
            if child.poll() is None:
                child.kill()
                child.communicate()
    for role, child, (_, wrong) in zip(roles, running, said, strict=True):
        if child.returncode:
            raise Problem(f"bench ring: {role} ended with {child.returncode}: {wrong.strip().splitlines()[-1:]}")
    return [[json.loads(line) for line in out.splitlines()] for out, _ in said]


def _ends(system: str, write: str, read: str) -> tuple[RingWriter, RingReader]:
    writer = RingWriter(Segment(segment_name(system, write, PROBE.name), write=True), write)
    return writer, RingReader(Segment(segment_name(system, read, PROBE.name)))


def local(system: str, seconds: float) -> tuple[list[int], list[int]]:
    """Times of one publish and one newest, each the mean of a batch, in one process."""
    writer, reader = _ends(system, "ping", "ping")
    writer.publish(1)
    end = monotonic_ns() + int(seconds * 1e9)
    publish: list[int] = []
    newest: list[int] = []
    while monotonic_ns() < end and len(publish) < KEPT:
        begin = monotonic_ns()
        for _ in range(BATCH):
            writer.publish(begin)
        middle = monotonic_ns()
        for _ in range(BATCH):
            reader.newest()
        newest.append((monotonic_ns() - middle) // BATCH)
        publish.append((middle - begin) // BATCH)
    return publish, newest


def ping(system: str, seconds: float) -> tuple[list[int]]:
    """Round trips: publish, poll until the answer is here, copied into our record."""
    writer, reader = _ends(system, "ping", "pong")
    payload = writer.field("payload")
    _spin(lambda: reader.head > 0)  # pong is there
    while reader.next():
        pass
    times: list[int] = []
    end = monotonic_ns() + int(seconds * 1e9)
    while len(times) < KEPT:
        begin = monotonic_ns()
        writer.publish(begin)
        for _ in SPINS:
            if reader.next():
                break
        now = monotonic_ns()
        times.append(now - begin)
        if now > end:
            break
    payload[0] = LAST
    writer.publish(monotonic_ns())
    if reader.stamp_ns != begin or reader.lost:
        raise Problem("an answer is missing")
    return (times[WARM_UP:] or times,)


def pong(system: str, seconds: float) -> tuple[()]:
    """Answer every record of ping with one of the same size."""
    writer, reader = _ends(system, "pong", "ping")
    asked = reader.field("payload")
    writer.publish(1)
    while asked[0] != LAST:
        for _ in SPINS:
            if reader.next():
                break
        else:
            raise Problem("ping has gone")
        writer.publish(reader.stamp_ns)
    return ()


def _spin(ready: Callable[[], object]) -> None:
    for _ in SPINS:
        if ready():
            return
    raise Problem("the other process has gone")


def owner(system: str, seconds: float) -> tuple[list[int]]:
    """Times from a client's send to the command in the owner's hands, its numbers read, the owner polling."""
    box = Mailbox(system, "owner", "arm")
    times: list[int] = []
    for _ in SPINS:
        for command in box.drain():
            sent = float(command.values[0])
            now = monotonic_ns()
            command.done()
            if sent == LAST:
                return (times[WARM_UP:] or times,)
            times.append(now - int(sent))
    raise Problem("the client has gone")


def client(system: str, seconds: float) -> tuple[()]:
    """Send commands with the time of sending, one after the other."""
    sender = Client(system, "owner")
    values = [0.0] * 7
    end = 0
    for n in range(KEPT):
        values[0] = float(monotonic_ns())  # exact below 2**53 ns, 104 days of uptime
        sender.send("servo_jp", values)
        _spin(sender.poll)
        end = end or monotonic_ns() + int(seconds * 1e9)
        if n > WARM_UP and monotonic_ns() > end:
            break
    sender.send("servo_jp", (LAST,))
    return ()


def waiter(system: str, seconds: float) -> tuple[list[int]]:
    """Times from the ring of the bell to the waiter running, asleep before."""
    page = Pulse(system, "ringer", write=True)
    place, cycles, stamp = page.waiter(), page.field("cycles"), page.field("heartbeat_ns")
    times: list[int] = []
    seen = 0

    def news() -> bool:
        return int(cycles) != seen

    patience = monotonic_ns() + int(PATIENCE_S * 1e9)
    while monotonic_ns() < patience:
        if not place.wait(news, 1_000_000_000):
            continue  # a ring may come late, for data already seen
        now = monotonic_ns()
        seen, sent = int(cycles), int(stamp)
        if sent < 0:
            return (times,)
        times.append(now - sent)
    raise Problem("the ringer has gone")


def ringer(system: str, seconds: float) -> tuple[()]:
    """Ring the bell when the waiter has gone to sleep."""
    page = Pulse(system, "ringer", write=True)
    bell, cycles, stamp, flags = page.bell(), page.field("cycles"), page.field("heartbeat_ns"), page.field("flags")
    patience, end, n = monotonic_ns() + int(PATIENCE_S * 1e9), 0, 0
    while monotonic_ns() < (end or patience):
        while not flags[0] and monotonic_ns() < patience:
            pause(1e-5)
        end = end or monotonic_ns() + int(seconds * 1e9)
        pause(2e-4)  # the flag is up just before the sleep
        n += 1
        stamp[...] = monotonic_ns()
        cycles[...] = n
        bell.ring()
    stamp[...] = -1
    cycles[...] = n + 1
    bell.ring()
    return ()


ROLES: dict[str, Callable[[str, float], tuple[list[int], ...]]] = {
    "local": local, "ping": ping, "pong": pong, "owner": owner, "client": client, "waiter": waiter, "ringer": ringer,
}


def main(words: list[str]) -> int:
    """A child of the benchmark."""
    if len(words) != 5 or words[0] != "--child" or words[1] not in ROLES:
        print("started by: trocar bench ring", file=sys.stderr)
        return 2
    role, system, core, seconds = words[1:]
    psutil.Process().cpu_affinity([int(core)])
    gc.disable()
    for times in ROLES[role](system, float(seconds)):
        print(json.dumps(times))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
