"""Hostile segments: whatever the bytes are, attaching works or says why not, and nothing crashes, swells or hangs."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import os
import signal
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import FrameType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.document.system import SystemConfig, from_json
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.memory.layout import LayoutError, schema_from_json
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import FIXED, SegmentError, path_of, segment_name, unlink
from trocar.shm.system import directory
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.time.lockstep import LockstepClock, Table, create_clock
from trocar.shm.topics import SUPERVISOR_STATE

SYSTEM = f"thostile{os.getpid()}"
HANG_S = 10
MAX_BYTES = 64 << 20
OWNER = "supervisor"
NAMES = ("magic", "version", "first", "fingerprint", "stride", "depth", "schema", "info", "kind", "size")
FIELDS = ((8, 4), (12, 4), (16, 8), (24, 4), (28, 4), (32, 4), (36, 4), (40, 8), (56, 8))  # where, bytes


@contextlib.contextmanager
def bounded(weigh: bool = False) -> Iterator[None]:
    """No endless loop (an alarm ends it), and no swollen memory, which takes time to weigh."""

    def hang(number: int, frame: FrameType | None) -> None:
        raise AssertionError(f"not done after {HANG_S} s")

    before = signal.signal(signal.SIGALRM, hang)
    signal.setitimer(signal.ITIMER_REAL, HANG_S)
    if weigh:
        tracemalloc.start()
    try:
        yield
        assert not weigh or tracemalloc.get_traced_memory()[1] < MAX_BYTES
    finally:
        tracemalloc.stop()
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@dataclass(frozen=True)
class Kind:
    """A kind of segment: how one is made, and all that may be done with it."""

    name: str
    instance: str
    what: str
    make: Callable[[], object]
    use: Callable[[], object]

    @property
    def segment(self) -> str:
        return segment_name(SYSTEM, self.instance, self.what)


def read_ring() -> None:
    for kind in (None, OWNER):
        with contextlib.suppress(SegmentError), contextlib.closing(
            directory.reader(SYSTEM, OWNER, "state", kind)
        ) as reader:
            assert reader.newest() in (True, False) and reader.next() in (True, False)
            assert len(reader.last(5)) <= 5
            reader.since(0)
            assert isinstance(reader.problem + str(reader.info), str)
            assert reader.head >= 0 and reader.epoch >= 0


def write_ring() -> None:
    with contextlib.suppress(SegmentError), contextlib.closing(
        directory.writer(SYSTEM, OWNER, "state", OWNER)
    ) as writer:
        writer.publish(1)
        writer.publish(2)
    read_ring()


def use_mailbox() -> None:
    with contextlib.ExitStack() as stack, contextlib.suppress(SegmentError):
        owner = stack.enter_context(contextlib.closing(Mailbox(SYSTEM, "PSM1", COMMANDS["arm"])))
        client = stack.enter_context(contextlib.closing(Client(SYSTEM, "PSM1")))
        with contextlib.suppress(KeyError):  # its header names another kind
            client.send("hold")
        for command in itertools.chain(owner.drain(), owner.drain()):
            assert command.values.size <= 64 and isinstance(command.text + command.name, str)
            command.done()
        client.poll()
        assert isinstance(client.commands, list)


def use_control() -> None:
    with contextlib.suppress(SegmentError), contextlib.closing(ControlPage(SYSTEM, "PSM2", write=True)) as page:
        assert isinstance(page.state + str(page.get("error")), str)
        page.wakeup().wake()
        page.wakeup().sleep(lambda: False, 1000)
        page.show("RUNNING")


def use_clock() -> None:
    with contextlib.suppress(SegmentError), contextlib.closing(LockstepClock(SYSTEM, "boards")) as clock:
        clock.sleep_until(clock.now_ns() + 1, lambda: True)


def use_document() -> None:
    with contextlib.suppress(SegmentError):
        text = directory.document(SYSTEM)
        with contextlib.suppress(ValueError):
            from_json(text)


def some_records() -> None:
    directory.create_ring(SYSTEM, OWNER, SUPERVISOR_STATE, {"instances": 1}, {"kind": OWNER})
    with contextlib.closing(directory.writer(SYSTEM, OWNER, "state", OWNER)) as writer:
        for i in range(1, 300):
            writer.publish(i)


TABLE = Table(("boards",))
KINDS = {kind.name: kind for kind in (
    Kind("ring", OWNER, "state", some_records, read_ring),
    Kind("writer", OWNER, "state", some_records, write_ring),
    Kind("mailbox", "PSM1", "mailbox", lambda: create_mailbox(SYSTEM, "PSM1", "arm", COMMANDS["arm"]), use_mailbox),
    Kind("control", "PSM2", "control", lambda: create_control(SYSTEM, "PSM2"), use_control),
    Kind("clock", OWNER, "clock", lambda: create_clock(SYSTEM, TABLE), use_clock),
    Kind("document", OWNER, "document", lambda: directory.publish_document(SYSTEM, b'{"name":"a"}' * 9),
         use_document),
)}


class Templates(dict[str, bytes]):
    """The bytes of a good segment of each kind."""

    def __repr__(self) -> str:
        return "templates"  # they are long


@pytest.fixture(scope="module")
def templates() -> Iterator[Templates]:
    """Good segments of all kinds; a page for the clock's user stays."""
    found = Templates()
    for name, kind in KINDS.items():
        kind.make()
        found[name] = path_of(kind.segment).read_bytes()
        unlink(kind.segment)
    create_control(SYSTEM, "boards")
    yield found
    remove_all(SYSTEM)


HEADER = st.integers(0, 300)
ANYWHERE = st.integers(0, 1 << 20)
PLACES = st.one_of(HEADER, st.integers(0, 5000), ANYWHERE)
WORDS = st.sampled_from([0, 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1])
CHANGES = st.one_of(
    st.tuples(st.just("flip"), PLACES, st.integers(0, 7)),
    st.tuples(st.just("put"), PLACES, st.binary(min_size=1, max_size=40)),
    st.tuples(st.just("word"), PLACES, WORDS),
    st.tuples(st.just("cut"), st.one_of(ANYWHERE, HEADER), st.just(0)),
    st.tuples(st.just("grow"), st.sampled_from([1, 4095, 4096, 1 << 16]), st.just(0)),
    st.tuples(st.just("field"), st.integers(0, len(FIELDS) - 1), WORDS),
)


def changed(good: bytes, changes: list[tuple[str, int, Any]]) -> bytes:
    raw = bytearray(good)
    for what, at, value in changes:
        at = at % len(raw) if raw and what not in ("grow", "field") else at
        if what == "flip" and raw:
            raw[at] ^= 1 << value
        elif what == "put":
            raw[at : at + len(value)] = value
        elif what == "word":
            raw[at & ~7 : (at & ~7) + 8] = value.to_bytes(8, "little")
        elif what == "cut":
            del raw[at:]
        elif what == "grow":
            raw += bytes(at)
        elif what == "field":
            at, size = FIELDS[at]
            raw[at : at + size] = value.to_bytes(8, "little")[:size]
    return bytes(raw)


def try_out(kind: Kind, raw: bytes, weigh: bool = False) -> None:
    path = path_of(kind.segment)
    path.write_bytes(raw)
    path.chmod(0o600)
    try:
        with bounded(weigh):
            kind.use()
    finally:
        path.unlink()


@pytest.mark.parametrize("kind", KINDS)
def test_an_unspoilt_one_works(templates: Templates, kind: str) -> None:
    try_out(KINDS[kind], templates[kind])


SPOILT = st.lists(CHANGES, min_size=1, max_size=6)


@pytest.mark.parametrize("kind", KINDS)
@examples(80)
@given(changes=SPOILT)
def test_a_spoilt_segment_is_refused_or_harmless(
    templates: Templates, kind: str, changes: list[tuple[str, int, Any]]
) -> None:
    try_out(KINDS[kind], changed(templates[kind], changes), weigh=True)


@pytest.mark.parametrize("kind", KINDS)
@examples(15)
@given(raw=st.binary(max_size=9000))
def test_random_bytes_are_refused(templates: Templates, kind: str, raw: bytes) -> None:
    try_out(KINDS[kind], raw)


@pytest.mark.parametrize("kind", KINDS)
@examples(30)
@given(rest=st.binary(min_size=1, max_size=4000), data=st.data())
def test_a_good_header_over_garbage_is_harmless(
    templates: Templates, kind: str, rest: bytes, data: st.DataObject
) -> None:
    good = templates[kind]
    first = FIXED.unpack_from(good)[2]
    body = (rest * (len(good) // len(rest) + 1))[: len(good) - first]
    live = data.draw(st.binary(min_size=192, max_size=192), "identity and head")
    try_out(KINDS[kind], good[:64] + live + good[256:first] + body)


@pytest.mark.parametrize("kind", KINDS)
@examples(30)
@given(other=st.sampled_from(sorted(KINDS)), data=st.data())
def test_one_kind_is_not_taken_for_another(
    templates: Templates, kind: str, other: str, data: st.DataObject
) -> None:
    raw = bytearray(templates[other])
    if data.draw(st.booleans(), "with the right kind's name"):
        raw[40:56] = templates[kind][40:56]
    try_out(KINDS[kind], bytes(raw))


LEAVES = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8))
JSON = st.recursive(
    LEAVES,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=6), inner, max_size=3)),
    max_leaves=8,
)
SIZES = st.one_of(JSON, st.dictionaries(st.sampled_from(["instances", "axes"]), LEAVES, min_size=1))
INFO = st.fixed_dictionaries({}, optional={"dims": SIZES, "kind": JSON, "commands": JSON, "rate_hz": JSON})
TEXTS = st.text(max_size=4)
FIELD = st.fixed_dictionaries({
    "name": st.one_of(st.sampled_from(["instance", "text", "count", "a"]), TEXTS),
    "dtype": st.one_of(st.sampled_from(["<f8", "u1", "(3,)<i4", "(2,2)?", "S8", "(0,)<f8", "(instances,)u1"]), TEXTS),
})
SCHEMAS = st.one_of(JSON, st.fixed_dictionaries({
    "topic": st.one_of(st.just("state"), JSON), "fields": st.one_of(st.lists(FIELD, max_size=4), JSON)
}))


def rebuilt(good: bytes, schema: bytes | None, info: bytes | None) -> bytes:
    """The segment with other texts, everything in the header in agreement with them."""
    values = dict(zip(NAMES, FIXED.unpack_from(good), strict=True))
    old = good[256 : 256 + values["schema"]], good[256 + values["schema"] : 256 + values["schema"] + values["info"]]
    texts = [new if new is not None else was for new, was in zip((schema, info), old, strict=True)]
    if schema is not None:
        with contextlib.suppress(LayoutError):
            made = schema_from_json(schema)
            values |= {"fingerprint": made.fingerprint, "stride": made.stride}
    first = -(-(256 + sum(map(len, texts))) // 4096) * 4096
    size = -(-(first + values["stride"] * values["depth"]) // 4096) * 4096
    values |= {"schema": len(texts[0]), "info": len(texts[1]), "size": size, "first": first}
    head = FIXED.pack(*values.values()) + good[FIXED.size : 256] + texts[0] + texts[1]
    return (head.ljust(first, b"\0") + good[FIXED.unpack_from(good)[2] :]).ljust(size, b"\0")[:size]


@pytest.mark.parametrize("kind", ["ring", "writer", "mailbox", "control"])
@examples(20)
@given(info=st.one_of(INFO, JSON))
def test_any_constants_are_refused_or_harmless(templates: Templates, kind: str, info: Any) -> None:
    raw = rebuilt(templates[kind], None, json.dumps(info).encode())
    try_out(KINDS[kind], raw)
    if isinstance(info, dict) and kind == "ring":
        path_of(KINDS[kind].segment).write_bytes(raw)
        path_of(KINDS[kind].segment).chmod(0o600)
        with contextlib.closing(directory.reader(SYSTEM, OWNER, "state")) as reader:
            assert len(reader.info) == len(info)  # it did get as far as that
        path_of(KINDS[kind].segment).unlink()


@pytest.mark.parametrize("kind", KINDS)
@examples(40)
@given(schema=SCHEMAS)
def test_any_schema_is_refused_or_harmless(templates: Templates, kind: str, schema: Any) -> None:
    try_out(KINDS[kind], rebuilt(templates[kind], json.dumps(schema).encode(), None))


@examples(60)
@given(content=st.one_of(JSON,
                         st.dictionaries(st.sampled_from([f.name for f in dataclasses.fields(SystemConfig)]), JSON)))
def test_any_document_is_refused_or_harmless(templates: Templates, content: Any) -> None:
    name = segment_name(SYSTEM, OWNER, "document")
    directory.publish_document(SYSTEM, json.dumps(content).encode())
    try:
        with bounded(), contextlib.suppress(ValueError):
            from_json(directory.document(SYSTEM))
    finally:
        unlink(name)
