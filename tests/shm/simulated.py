"""The real modules of shm/ on simulated memory: stand-ins for a segment and for what the kernel and C do to it.

`Real` reads the source of ring, mailbox, place, locks, nap and order, changes it where asked (a seeded mutant, a
smaller depth; a change that matches nothing is an error) and runs it with the stand-ins in place of Segment, struct,
ctypes and locks. Every access to shared memory ends in a method of the Actor that runs; one that did not would fail,
because no stand-in is a buffer. Two changes are always made, to ring.py: a slot is loaded into bytes before it is
copied, and each round of a retry begins with `merge` (what a round does depends on the reader and the round's number
alone).
"""

from __future__ import annotations

import re
import struct
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from tests.shm.process import PLAIN, REAL, Actor, Address
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import mailbox, mailbox_map, place, received
from trocar.shm.memory import locks, order
from trocar.shm.memory.layout import Schema, schema_of
from trocar.shm.memory.segment import Header
from trocar.shm.ring import ring
from trocar.shm.time import lockstep, wakeup
from trocar.shm.topics import Field, Topic

FIRST = 4096
NAPS_AT = FIRST + 64
PAIR = schema_of(Topic("pair", "io", (Field("value", "<i8", "", "a number"),), depth=1))  # payload: stamp, value
MODULES = {module.__name__.split(".")[-1]: module for module in (
    order, ring, locks, mailbox_map, received, mailbox, place, wakeup, lockstep)}
SMALL = (
    ("mailbox", "PER_CYCLE = 8", "PER_CYCLE = 1"),
    ("mailbox_map", "COMMANDS_DEPTH = COMMAND.depth", "COMMANDS_DEPTH = 2"),
    ("mailbox_map", "REPLIES_DEPTH = REPLY.depth", "REPLIES_DEPTH = 2"),
    ("mailbox_map", "CLIENTS = 16", "CLIENTS = 1"),
    ("mailbox_map", "from trocar.shm.memory.holders import HOLDER, PROGRAM, Holder, in_words",
     'from trocar.shm.memory.holders import Holder, in_words; HOLDER, PROGRAM = struct.Struct("<I4s"), 4'),
    ("place", "STOP_TRIES, STOP_PAUSE_S = 200, 0.001", "STOP_TRIES, STOP_PAUSE_S = 2, 0.0"),
    ("mailbox_map", "MAX_VALUES, MAX_TEXT = 64, 64", "MAX_VALUES, MAX_TEXT = 2, 0"),
    ("mailbox", "SHORT = 8", "SHORT = 1"),
    ("mailbox_map", "<qQQQHHI", "<qQBBBBI"),
    ("mailbox_map", "from trocar.shm.mailbox.origins import PROGRAM_BYTES", "PROGRAM_BYTES = 0"),
    ("mailbox_map", '"<QB200s"', '"<QB7s"'),
    ("mailbox_map", "REPLY_TEXT = 199", "REPLY_TEXT = 6"),
    ("lockstep", "words[monotonic], words[local] = monotonic_ns(), local_ns()", "pass"),  # nobody here looks at them
    ("lockstep", "words[advances] = (words[advances] + 1) % WORDS", "pass"),
)
Change = tuple[str, str, str]  # module, old text, new text


def private(thing: Any) -> tuple[Any, ...]:
    """The private state of one of our objects, but for views, places and the record, which no method looks at."""
    return tuple((name, tuple(sorted(value)) if isinstance(value, set) else tuple(value) if isinstance(value, list)
                  else value) for name, value in vars(thing).items() if isinstance(value, (*PLAIN, set))
                 or (isinstance(value, list) and all(isinstance(v, int) for v in value)))


class SimulatedPart:
    """A part of a segment's memory, like a memoryview of it; in cells of `width` bytes."""

    readonly = False

    def __init__(self, me: Actor, name: str, start: int, stop: int, width: int = 8) -> None:
        assert (stop - start) % width == 0
        self.me, self.name, self.start, self.width = me, name, start, width
        self.places: list[Address] = [(name, at) for at in range(start, stop, width)]

    def __len__(self) -> int:
        return len(self.places)

    def __bytes__(self) -> bytes:
        return b"".join(v.to_bytes(self.width, "little") for v in self.me.load(*self.places))

    tobytes = __bytes__

    def cast(self, form: str) -> SimulatedPart:
        width = {"I": 4, "Q": 8}[form]
        return SimulatedPart(self.me, self.name, self.start, self.start + len(self) * self.width, width)

    def release(self) -> None:
        pass

    def __iter__(self) -> Iterator[int]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: int) -> int:
        return self.me.load(self.places[index])[0]

    def __setitem__(self, index: int | slice, value: Any) -> None:
        if isinstance(index, slice):
            assert index == slice(None)
            self.me.store(*zip(self.places, _cut(bytes(value), self.width), strict=True))
        else:
            self.me.store((self.places[index], value))


def _cut(data: bytes, width: int) -> list[int]:
    return [int.from_bytes(data[i : i + width], "little") for i in range(0, len(data), width)]


class Whole:
    """All of a segment's memory: its parts, as words."""

    readonly = False

    def __init__(self, me: Actor, name: str) -> None:
        self.me, self.name = me, name

    def __getitem__(self, part: slice) -> SimulatedPart:
        width = 4 if part.stop - part.start == 4 else 8
        return SimulatedPart(self.me, self.name, part.start, part.stop, width)


class Words:
    """The words of a segment."""

    def __init__(self, me: Actor, name: str) -> None:
        self._me, self._name = me, name

    def __getitem__(self, index: int) -> int:
        return self._me.load((self._name, 8 * index))[0]

    def __setitem__(self, index: int, value: int) -> None:
        self._me.store(((self._name, 8 * index), value))


class Slots:
    """The slots of a ring as one array: the cells of a part of it are loaded at once, in any order."""

    dtype = np.dtype(f"V{PAIR.dtype.itemsize}")

    def __init__(self, segment: Segment) -> None:
        self._view, self._header = segment.view, segment.header

    def __getitem__(self, part: slice) -> NDArray[np.void]:
        size, first, stride = self.dtype.itemsize, self._header.first, self._header.stride
        slots = [self._view[first + k * stride : first + k * stride + size] for k in range(part.start, part.stop)]
        values = self._view.me.load(*(place for slot in slots for place in slot.places))
        return np.array(values, np.uint64).view(self.dtype)


class Segment:
    """Stands for trocar.shm.memory.segment.Segment, attached and checked."""

    fd = 0

    def __init__(self, real: Real, name: str, kind: str, schema: Schema, depth: int) -> None:
        self._me, self._real, self.name = real.me, real, name
        info = {"kind": "io", "commands": [{"name": row.name} for row in COMMANDS["io"]]}
        self.header = Header(kind, schema, info, FIRST, schema.stride, depth, FIRST + depth * schema.stride)
        self.view = Whole(real.me, name)

    def words(self, copied: int = 0) -> Any:
        words = Words(self._me, self.name)
        fenced = self._real.fenced or (self._real.large and copied)
        return self._real.order.FencedWords(words, self._me.fence) if fenced else words

    def claim(self, name: str) -> None:
        self._me.claim(("lock", -1))

    def keep(self, part: SimulatedPart) -> SimulatedPart:
        return part

    def at_close(self, callback: object, *, unlocks: bool = False) -> None:
        pass

    def close(self) -> None:
        pass


class Struct:
    """A struct.Struct that packs into and unpacks from simulated memory: zeros first, as CPython does, then values."""

    def __init__(self, real: struct.Struct) -> None:
        self._real, self.size = real, real.size
        self.pack, self.unpack = real.pack, real.unpack

    def pack_into(self, view: Whole, at: int, *values: Any) -> None:
        data = self._real.pack(*values)
        part = view[slice(at, at + self.size)]
        part[slice(None)] = bytes(self.size)
        part[slice(None)] = data

    def unpack_from(self, data: Any, at: int = 0) -> tuple[Any, ...]:
        if isinstance(data, Whole):
            return self._real.unpack(bytes(data[slice(at, at + self.size)]))
        return self._real.unpack_from(data, at)


class Number(int):
    """Stands for ctypes.c_uint32: an address is the offset it was made of."""

    @classmethod
    def from_buffer(cls, view: Whole, offset: int) -> Number:
        return cls(offset)


class Kernel:
    """Stands for ctypes, os, the futex call and the locks, as wakeup.py and locks.py use them."""

    c_uint32 = Number
    c_void_p = addressof = byref = staticmethod(lambda value: value)

    def __init__(self, real: Real) -> None:
        self._real = real

    def futex(self, number: int, at: int, what: int, value: int, *rest: Any) -> int:
        """A word of the page where wake-up words are."""
        place = ("page", int(at))
        if what == 1:
            return int(self._real.me.wake(place))
        self._real.me.sleep(place, int(value))
        return 0

    def lock(self, description: int, at: int) -> bool:
        return bool(self._real.me.lock(("lock", at), description))

    def unlock(self, description: int, at: int) -> None:
        self._real.me.unlock(description)


@cache
def _compiled(text: str, name: str) -> CodeType:
    return compile(text, name, "exec")


class Real:
    """The modules, changed; `me` is the Actor that runs them now (set it at the start of a program with `on`)."""

    def __init__(self, *changes: Change, fenced: bool = False, large: bool = False) -> None:
        """`fenced`: words have fences; `large`: those of who copies have, as for records that copies stream."""
        self.fenced, self.large = fenced, large
        self.me: Any = None
        for module, _, _ in changes:
            assert module in MODULES
        with patch.dict(sys.modules):
            read = (self._read(m, changes) for m in MODULES)
            self.order, self.ring, self.locks, self._map, _, self.mailbox, self.place, *rest = read
            self._wakeups, self.lockstep = rest
        self._join()

    def on(self, me: Actor) -> Real:
        """`me` runs from here."""
        self.me = me
        return self

    def _read(self, name: str, changes: Iterable[Change]) -> Any:
        path = Path(str(MODULES[name].__file__))
        text = path.read_text()
        if name == "ring":  # a memoryview copies from real buffers only: have the slot copied first
            text, count = re.subn(r"\] = ((?:self\._)?slot)\b(?=\s)", r"] = bytes(\1)", text)
            assert count >= 5, count
            # Each round of a retry restarts, whatever the last one found.
            text, count = re.subn(r"for (\w+) in range\(RETRIES\):\n", r"\g<0>            merge(self, \1)\n", text)
            assert count >= 2, count
        for where, old, new in (*SMALL, *changes):
            if where == name:
                assert text.count(old) >= 1, f"{path}: there is no {old!r}"
                text = text.replace(old, new)
        module = ModuleType(MODULES[name].__name__)
        exec(_compiled(text, f"{REAL}{path.name}"), module.__dict__)
        if name in ("mailbox_map", "received"):  # what follows from its numbers has to follow from these
            sys.modules[module.__name__] = module
        return module

    def _join(self) -> None:
        """Put the stand-ins in their places."""
        places, box, sender, kernel = self._map, self.mailbox, self.place, Kernel(self)
        places.Segment = lambda name, write: Segment(self, "mail", "mailbox", places.WHOLE, 1)
        places.HOLDER = Struct(places.HOLDER)
        box.COMMANDS_OF = tuple(map(Struct, box.COMMANDS_OF))
        box.REPLY_BODY = Struct(box.REPLY_BODY)
        for name in vars(sender):
            if name in vars(box) and not name.startswith("__"):
                setattr(sender, name, getattr(box, name))
        sender.Places, sender.AllTaken, sender.pause = self.locks.Places, self.locks.AllTaken, lambda seconds: None
        sender.monotonic_ns = box.monotonic_ns = lambda: 7
        self.locks._lock, self.locks._unlock = kernel.lock, kernel.unlock
        self._wakeups.ctypes, self._wakeups.SYSCALL = kernel, kernel.futex
        self.ring.slots = Slots
        self.ring.merge = lambda reader, round: self.me.merge((round, private(reader)))
        self._wakeups.full_fence = lambda: lambda: self.me.fence()
        steps = self.lockstep
        steps.Places, steps.full_fence, steps.monotonic_ns, steps.local_ns = (
            self.locks.Places, self._wakeups.full_fence, lambda: 7, lambda: 7)

    def writer(self, depth: int) -> Any:
        """A RingWriter."""
        return self.ring.RingWriter(Segment(self, "ring", "ring", PAIR, depth), "io")

    def reader(self, depth: int) -> Any:
        """A RingReader."""
        return self.ring.RingReader(Segment(self, "ring", "ring", PAIR, depth))

    def owner(self) -> Any:
        """A Mailbox."""
        return self.mailbox.Mailbox("s", "IO1", COMMANDS["io"])

    def sender(self) -> Any:
        """A Place, taken."""
        return self.place.take_place("s", "IO1")

    def stopper(self) -> Any:
        """A StopPlace."""
        return self.place.StopPlace("s", "IO1")

    def wakeup(self) -> Any:
        """A Nap, the first of the page."""
        return self._wakeups.Wakeup(self._page(), NAPS_AT)

    def member(self, name: str, table: Any) -> Any:
        """A Member of simulated time."""
        return self.lockstep.Member(*self._clock(table), name)

    def keeper(self, table: Any) -> Any:
        """Steps, as the supervisor has them."""
        return self.lockstep.Steps(*self._clock(table))

    def _clock(self, table: Any) -> Any:
        page = Segment(self, "clock", "clock", self.lockstep.SCHEMA, 1)
        page.header.info.clear()
        page.header.info.update(table.to_info())
        wakeups = [self._wakeups.Wakeup(self._page(), NAPS_AT + 4 * place) for place in range(len(table.members))]
        return page, wakeups, lambda: None

    def _page(self) -> Segment:
        return Segment(self, "page", "control", PAIR, 1)
