"""The roles of `trocar bench ring` that use our own shared memory; each is made once and then measures in turns.

Started by tools/bench/children.py. Polling loops have no bound of their own, which would cost time at every poll: a
child with a crashed partner is killed, or ends with its CPU time limit.
"""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic_ns

from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import RingReader, RingWriter
from trocar.shm.system.directory import create_ring
from trocar.shm.time.clock import pause
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.topics import PROBE, PROBE_4K, Topic
from trocar.tools.bench.children import KEPT, Times, Turn
from trocar.tools.output.errors import Problem

BATCH = 50  # for operations too short for the clock; fewer than the ring keeps
LAST = -1.0  # in the first number of a payload: this was the last one of this turn
POLLERS, LOOKERS = 2, 6
LOOK_S = 0.005
PATIENCE_NS = 10_000_000_000
RINGS = (("ping", PROBE), ("pong", PROBE), ("ping", PROBE_4K), ("pong", PROBE_4K), ("local", PROBE),
         ("local", PROBE_4K), ("crowd", PROBE))


def make_segments(system: str) -> None:
    """All segments of the benchmark; the caller removes them."""
    for instance, topic in RINGS:
        create_ring(system, instance, topic, {}, {})
    create_mailbox(system, "owner", "arm", COMMANDS["arm"])
    create_control(system, "sleeper")


def _writer(system: str, instance: str, topic: Topic = PROBE) -> RingWriter:
    return RingWriter(Segment(segment_name(system, instance, topic.name), write=True), instance)


def _reader(system: str, instance: str, topic: Topic = PROBE) -> RingReader:
    return RingReader(Segment(segment_name(system, instance, topic.name)))


def ping(system: str, topic: Topic = PROBE, what: str = "trip") -> Turn:
    """Round trips: publish, poll until the answer is here, copied into our record, and read its sender."""
    writer, answers = _writer(system, "ping", topic), _reader(system, "pong", topic)
    publish, payload = writer.publish, writer.field("payload")
    arrived, stamp = answers.next, answers.field("stamp_ns").item

    def turn(seconds: float) -> Times:
        times: list[int] = []
        end = monotonic_ns() + int(seconds * 1e9)
        while True:
            begin = monotonic_ns()
            publish(begin)
            while not arrived():
                pass
            answer = stamp()
            now = monotonic_ns()
            times.append(now - begin)
            if now > end or answer != begin or len(times) == KEPT:
                break
        payload[0] = LAST
        publish(now)
        while not arrived():
            pass
        payload[0] = 0.0
        if answer != begin or answers.stamp_ns != now or answers.lost or answers.problem:
            raise Problem(f"wrong answer: {answers.problem}")
        return {what: times}

    return turn


def pong(system: str, topic: Topic = PROBE) -> Turn:
    """Answer every record of ping with one of the same size and the same stamp."""
    writer, asked = _writer(system, "pong", topic), _reader(system, "ping", topic)
    publish, arrived = writer.publish, asked.next
    stamp, payload = asked.field("stamp_ns").item, asked.field("payload")

    def turn(seconds: float) -> Times:
        while True:
            while not arrived():
                pass
            publish(stamp())
            if payload[0] == LAST:
                return {}

    return turn


def local(system: str) -> Turn:
    """Single calls in one undisturbed process, each time the mean of a batch."""
    writer, reader, large = _writer(system, "local"), _reader(system, "local"), _writer(system, "local", PROBE_4K)
    publish, newest, following, publish_4k = writer.publish, reader.newest, reader.next, large.publish
    names = ("publish", "newest", "next", "publish_4k")

    def batches() -> tuple[int, ...]:
        t0 = monotonic_ns()
        for _ in range(BATCH):
            publish(t0)
        t1 = monotonic_ns()
        for _ in range(BATCH):
            newest()
        t2 = monotonic_ns()
        for _ in range(BATCH):
            following()
        t3 = monotonic_ns()
        for _ in range(BATCH):
            publish_4k(t3)
        t4 = monotonic_ns()
        return t1 - t0, t2 - t1, t3 - t2, t4 - t3

    def turn(seconds: float) -> Times:
        times: dict[str, list[int]] = {name: [] for name in names}
        end = monotonic_ns() + int(seconds * 1e9)
        while not times["newest"] or monotonic_ns() < end:
            for name, duration in zip(names, batches(), strict=True):
                times[name].append(duration // BATCH)
        if reader.lost or reader.sequence != writer.sequence:
            raise Problem("a record is missing")
        return times

    return turn


def crowd(system: str) -> Turn:
    """Publish as fast as possible while others read; each time the mean of a batch."""
    writer = _writer(system, "crowd")
    publish, payload = writer.publish, writer.field("payload")
    turns = 0

    def turn(seconds: float) -> Times:
        nonlocal turns
        turns += 1
        times: list[int] = []
        end = monotonic_ns() + int(seconds * 1e9)
        now = 0
        while now < end:
            begin = monotonic_ns()
            for _ in range(BATCH):
                publish(begin)
            now = monotonic_ns()
            times.append((now - begin) // BATCH)
        payload[0] = turns * LAST
        publish(now)
        return {"publish_readers8": times}

    return turn


def poller(system: str) -> Turn:
    """Read every record that can be had, polling."""
    reader = _reader(system, "crowd")
    return _look_until_last(reader, reader.next)


def looker(system: str) -> Turn:
    """Look at the newest record now and then, as most processes do."""
    reader = _reader(system, "crowd")

    def look() -> bool:
        pause(LOOK_S)
        return reader.newest()

    return _look_until_last(reader, look)


def _look_until_last(reader: RingReader, look: Callable[[], bool]) -> Turn:
    """`look` again and again, until the last record of a turn is there."""
    payload = reader.field("payload")
    turns = 0

    def turn(seconds: float) -> Times:
        nonlocal turns
        turns += 1
        while not look() or payload[0] != turns * LAST:
            pass
        if reader.problem:
            raise Problem(reader.problem)
        return {}

    return turn


def owner(system: str) -> Turn:
    """Times from just before a client's send to the command's arrival at the polling owner, its numbers read."""
    box = Mailbox(system, "owner", COMMANDS["arm"])

    def turn(seconds: float) -> Times:
        times: list[int] = []
        while True:
            for command in box.drain():
                sent = float(command.values[0])
                now = monotonic_ns()
                command.done()
                if sent == LAST:
                    return {"mailbox": times}
                times.append(now - int(sent))

    return turn


def client(system: str) -> Turn:
    """Send commands with the time of sending, each when the one before has been answered."""
    sender = LoopClient(system, "owner")
    values = [0.0] * 7

    def turn(seconds: float) -> Times:
        end = monotonic_ns() + int(seconds * 1e9)
        now = 0
        while now < end:
            now = monotonic_ns()
            values[0] = float(now)  # exact below 2**53 ns, 104 days of uptime
            sender.send("servo_jp", values)
            while not sender.poll():
                pass
        sender.send("servo_jp", (LAST,))
        while not sender.poll():
            pass
        return {}

    return turn


def sleeper(system: str) -> Turn:
    """Times from the waker's call to the sleeper running."""
    page = ControlPage(system, "sleeper", write=True)
    wakeup, sent_out = page.wakeup(), page.field("cycles")
    stamp, heard = page.field("heartbeat_ns"), page.field("missed")
    seen = 0

    def news() -> bool:
        return int(sent_out) != seen

    def turn(seconds: float) -> Times:
        nonlocal seen
        times: list[int] = []
        patience = monotonic_ns() + int(seconds * 1e9) + PATIENCE_NS
        while monotonic_ns() < patience:
            if not wakeup.sleep(news, 1_000_000_000):
                continue  # a wake-up may be late, for news already seen
            now = monotonic_ns()
            seen, sent = int(sent_out), int(stamp)
            heard[...] = seen
            if sent < 0:
                return {"wakeup": times}
            times.append(now - sent)
        raise Problem("the waker has gone")

    return turn


def waker(system: str) -> Turn:
    """Wake the sleeper when it has received the last news and gone to sleep."""
    page = ControlPage(system, "sleeper", write=True)
    wakeup, sent_out = page.wakeup(), page.field("cycles")
    stamp, heard = page.field("heartbeat_ns"), page.field("missed")
    count = 0

    def asleep(patience_ns: int) -> bool:
        while heard != count or not wakeup.sleeps:
            if monotonic_ns() > patience_ns:
                return False
            pause(1e-5)
        pause(2e-4)  # the word is 1 just before the sleep
        return True

    def turn(seconds: float) -> Times:
        nonlocal count
        end = monotonic_ns() + int(seconds * 1e9)
        patience = end + PATIENCE_NS
        now = 0
        while asleep(patience):
            count += 1
            last = now > end
            now = monotonic_ns()
            stamp[...] = -1 if last else now
            sent_out[...] = count
            wakeup.wake()
            if last:
                return {}
        raise Problem("the sleeper has gone")

    return turn


ROLES: dict[str, Callable[[str], Turn]] = {
    "ping": ping, "pong": pong, "ping_4k": lambda system: ping(system, PROBE_4K, "trip_4k"),
    "pong_4k": lambda system: pong(system, PROBE_4K), "local": local, "crowd": crowd, "poller": poller,
    "looker": looker, "owner": owner, "client": client, "sleeper": sleeper, "waker": waker,
}
