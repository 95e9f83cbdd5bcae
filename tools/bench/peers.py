"""The peers of `trocar bench ring`: other libraries for the same job, each in its best setting.

Started by tools/bench/children.py with a folder of the bench, PLACE, and the core of the partner, OTHER. All send 216
bytes back and forth and poll for them. Byte transports return the same bytes without reading them; with iceoryx2 both
sides read a number of the record, as with ours.

iceoryx2 comes twice: with the calls of its own Python examples, and tuned like its own benchmark in Rust: the next
sample is borrowed while the other side is at work, the payload written and read at its bare address. The two measuring
loops are written out, although similar: a call of ours inside them would count as the peer's time.
"""

from __future__ import annotations

import ctypes
import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from queue import Empty
from time import monotonic_ns
from typing import Any

from trocar.tools.bench.children import KEPT, PATIENCE_S, Times, Turn, pin
from trocar.tools.output.errors import Problem

PAYLOAD = 216
LAST = -1
QUESTION, END = bytes(PAYLOAD), b"\xff" * PAYLOAD
Send = Callable[[bytes], object]
Receive = Callable[[], bytes]

SETTINGS = {
    "iceoryx2": "publish-subscribe, Ipc; fixed-size record; 1 publisher, 1 subscriber, buffer 1, no history, no log; "
                "loan_uninit, write_payload, send; receive in a loop, payload().contents",
    "iceoryx2_tuned": "the same services; sample borrowed ahead, memmove to payload_ptr, send; receive in a loop, one "
                      "number read at payload_ptr",
    "pyzmq": "PAIR over ipc, send; recv(NOBLOCK) in a loop; its I/O threads run on the same two cores",
    "pipe": "multiprocessing.Pipe(duplex=False), one each way, send_bytes; poll(0) in a loop, recv_bytes",
    "queue": "multiprocessing.Queue, one each way, put; get_nowait in a loop; its feeder threads run on the same cores",
}
MODULES = {"iceoryx2": "iceoryx2", "iceoryx2_tuned": "iceoryx2", "pyzmq": "zmq"}  # the others are Python's own


class PeerRecord(ctypes.Structure):
    """Payload of iceoryx2: a number and further values, 216 bytes."""

    _fields_ = [("number", ctypes.c_int64), ("values", ctypes.c_double * 26)]  # ctypes requires a list


def iceoryx2_prefix(place: str) -> str:
    """The beginning of all names in shared memory that iceoryx2 makes for the bench in this folder."""
    return f"{Path(place).name}_"


def _iceoryx2(place: str, way: str, first: bool) -> tuple[Any, Any]:
    """A publisher and a subscriber of two services, each made for exactly one of either."""
    import iceoryx2 as iox2

    iox2.set_log_level(iox2.LogLevel.Fatal)
    config = iox2.config.default()
    config.global_cfg.root_path = iox2.Path.new(str(Path(place) / "iceoryx2"))
    config.global_cfg.prefix = iox2.FileName.new(iceoryx2_prefix(place))
    config.global_cfg.creation_timeout = iox2.Duration.from_secs(int(PATIENCE_S))  # for the second to attach
    node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
    questions, answers = (
        node.service_builder(iox2.ServiceName.new(f"{way}/{which}")).publish_subscribe(PeerRecord)
        .max_publishers(1).max_subscribers(1).history_size(0).subscriber_max_buffer_size(1).enable_safe_overflow(True)
        .open_or_create()
        for which in ("questions", "answers")
    )
    writes, reads = (questions, answers) if first else (answers, questions)
    return writes.publisher_builder().create(), reads.subscriber_builder().create()


def iceoryx2_ping(place: str) -> Turn:
    """Round trips with the calls of iceoryx2's examples."""
    publisher, subscriber = _iceoryx2(place, "plain", True)
    loan, receive, record = publisher.loan_uninit, subscriber.receive, PeerRecord()

    def turn(seconds: float) -> Times:
        times: list[int] = []
        end = monotonic_ns() + int(seconds * 1e9)
        now = 0
        while now < end and len(times) < KEPT:
            begin = monotonic_ns()
            record.number = begin
            loan().write_payload(record).send()
            while (sample := receive()) is None:
                pass
            answer = sample.payload().contents.number
            now = monotonic_ns()
            sample.delete()
            if answer != begin:
                raise Problem("iceoryx2: the answer does not match the question")
            times.append(now - begin)
        publisher.send_copy(PeerRecord(number=LAST))
        return {"trip": times}

    return turn


def iceoryx2_pong(place: str) -> Turn:
    """The other end of `iceoryx2_ping`."""
    publisher, subscriber = _iceoryx2(place, "plain", False)
    loan, receive, record = publisher.loan_uninit, subscriber.receive, PeerRecord()

    def turn(seconds: float) -> Times:
        while True:
            while (sample := receive()) is None:
                pass
            record.number = number = sample.payload().contents.number
            if number == LAST:
                return {}
            loan().write_payload(record).send()
            sample.delete()

    return turn


def iceoryx2_tuned_ping(place: str) -> Turn:
    """Round trips with all possible work moved before or after the measurement."""
    publisher, subscriber = _iceoryx2(place, "tuned", True)
    loan, receive, record = publisher.loan_uninit, subscriber.receive, PeerRecord()
    copy, source, number_at = ctypes.memmove, ctypes.addressof(record), ctypes.c_int64.from_address

    def turn(seconds: float) -> Times:
        times: list[int] = []
        end = monotonic_ns() + int(seconds * 1e9)
        now = 0
        ahead = loan().assume_init()
        target = ahead.payload_ptr
        while now < end and len(times) < KEPT:
            begin = monotonic_ns()
            record.number = begin
            copy(target, source, PAYLOAD)
            ahead.send()
            ahead = loan().assume_init()  # while the other side is at work
            target = ahead.payload_ptr
            while (sample := receive()) is None:
                pass
            answer = number_at(sample.payload_ptr).value
            now = monotonic_ns()
            sample.delete()
            if answer != begin:
                raise Problem("iceoryx2: the answer does not match the question")
            times.append(now - begin)
        publisher.send_copy(PeerRecord(number=LAST))
        return {"trip": times}

    return turn


def iceoryx2_tuned_pong(place: str) -> Turn:
    """The other end of `iceoryx2_tuned_ping`."""
    publisher, subscriber = _iceoryx2(place, "tuned", False)
    loan, receive, record = publisher.loan_uninit, subscriber.receive, PeerRecord()
    copy, source, number_at = ctypes.memmove, ctypes.addressof(record), ctypes.c_int64.from_address

    def turn(seconds: float) -> Times:
        while True:
            ahead = loan().assume_init()
            target = ahead.payload_ptr
            while (sample := receive()) is None:
                pass
            record.number = number = number_at(sample.payload_ptr).value
            if number == LAST:
                return {}
            copy(target, source, PAYLOAD)
            ahead.send()
            sample.delete()

    return turn


def _ask(send: Send, receive: Receive) -> Turn:
    """Round trips of bytes."""

    def turn(seconds: float) -> Times:
        times: list[int] = []
        end = monotonic_ns() + int(seconds * 1e9)
        now = 0
        while now < end and len(times) < KEPT:
            begin = monotonic_ns()
            send(QUESTION)
            answer = receive()
            now = monotonic_ns()
            if len(answer) != PAYLOAD:
                raise Problem("the answer does not match the question")
            times.append(now - begin)
        send(END)
        return {"trip": times}

    return turn


def _answer(send: Send, receive: Receive) -> Turn:
    """Return all received data."""

    def turn(seconds: float) -> Times:
        while (question := receive()) != END:
            send(question)
        return {}

    return turn


def _zmq(place: str, first: bool) -> tuple[Send, Receive]:
    import zmq

    socket = zmq.Context().socket(zmq.PAIR)
    socket.linger = 0
    address = f"ipc://{place}/zmq"
    if first:
        socket.connect(address)  # waits for the other end if need be
    else:
        socket.bind(address)
    get, noblock, again = socket.recv, zmq.NOBLOCK, zmq.Again

    def receive() -> bytes:
        while True:
            try:
                return get(noblock)
            except again:
                pass

    return socket.send, receive


def _pipe(reads: Connection, writes: Connection) -> tuple[Send, Receive]:
    poll, get = reads.poll, reads.recv_bytes

    def receive() -> bytes:
        while not poll(0):
            pass
        return get()

    return writes.send_bytes, receive


def _queue(reads: multiprocessing.Queue[bytes], writes: multiprocessing.Queue[bytes]) -> tuple[Send, Receive]:
    get = reads.get_nowait

    def receive() -> bytes:
        while True:
            try:
                return get()
            except Empty:
                pass

    return writes.put, receive


ENDS: dict[str, Callable[..., tuple[Send, Receive]]] = {"pipe": _pipe, "queue": _queue}


def _partner(kind: str, core: int, turns: Connection, reads: Any, writes: Any) -> None:
    """The answering process of pipe and queue: a child of the asking one, which is how they find each other."""
    pin(core)
    answer = _answer(*ENDS[kind](reads, writes))
    turns.send(True)
    try:
        while turns.recv():
            answer(0.0)
    except EOFError:
        return


def _with_partner(kind: str, other: int) -> Turn:
    """The asking process of pipe or queue."""
    context = multiprocessing.get_context("spawn")
    if kind == "pipe":
        (their_in, our_out), (our_in, their_out) = context.Pipe(False), context.Pipe(False)
        ours: tuple[Any, Any] = our_in, our_out
        theirs: tuple[Any, Any] = their_in, their_out
    else:
        questions, answers = context.Queue(), context.Queue()
        ours, theirs = (answers, questions), (questions, answers)
    turns, their_turns = context.Pipe()
    context.Process(target=_partner, args=(kind, other, their_turns, *theirs), daemon=True).start()
    their_turns.close()
    if not turns.poll(PATIENCE_S) or not turns.recv():
        raise Problem(f"{kind}: the partner did not start")
    ask = _ask(*ENDS[kind](*ours))

    def turn(seconds: float) -> Times:
        turns.send(True)
        return ask(seconds)

    return turn


ROLES: dict[str, Callable[[str, str], Turn]] = {
    "iceoryx2_ping": lambda place, other: iceoryx2_ping(place),
    "iceoryx2_pong": lambda place, other: iceoryx2_pong(place),
    "iceoryx2_tuned_ping": lambda place, other: iceoryx2_tuned_ping(place),
    "iceoryx2_tuned_pong": lambda place, other: iceoryx2_tuned_pong(place),
    "pyzmq_ping": lambda place, other: _ask(*_zmq(place, True)),
    "pyzmq_pong": lambda place, other: _answer(*_zmq(place, False)),
    "pipe": lambda place, other: _with_partner("pipe", int(other)),
    "queue": lambda place, other: _with_partner("queue", int(other)),
}
