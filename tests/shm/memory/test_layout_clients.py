"""A client and a sleeper made from nothing but docs/shared-memory.md are served and woken."""

from __future__ import annotations

import fcntl
import mmap
import os
import re
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.shm.memory.layout_page import TEXT, Row, records, table, tables
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox import mailbox_map, received
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import QUEUES_AT, create_mailbox
from trocar.shm.mailbox.place import take_place
from trocar.shm.memory.segment import SegmentError, path_of, segment_name
from trocar.shm.system.subscriptions import Clearing, Subscriptions
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.topics import EVENTS

ARM = [command.name for command in COMMANDS["arm"]]


@pytest.fixture
def system(world: Any) -> Iterator[str]:
    """Name of a system whose segments are removed behind the test."""
    yield world.name
    world.remove()


class ByThePage:
    """A segment seen through nothing but the numbers of the page."""

    def __init__(self, name: str) -> None:
        self.fd = os.open(path_of(name), os.O_RDWR)
        rows = {row["name"]: (int(row["size"]), int(row["offset"])) for row in table("Header", "offset", "size")}
        self.first = int.from_bytes(os.pread(self.fd, *rows["first"]), "little")
        self.map = mmap.mmap(self.fd, int.from_bytes(os.pread(self.fd, *rows["size"]), "little"))

    def lock(self, at: int) -> bool:
        (row,) = [row for t in tables() if "in the code" in t.columns for row in t.rows
                  if row.get("constant") == "F_OFD_SETLK"]
        try:
            fcntl.fcntl(self.fd, int(row["value"]), struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, at, 1, 0))
        except BlockingIOError:
            return False
        return True

    def close(self) -> None:
        self.map.close()
        os.close(self.fd)


def offset(rows: dict[str, Row], field: str) -> int:
    return int(rows[field]["offset"])


class MailByThePage(ByThePage):
    """A mailbox seen so."""

    def __init__(self, system: str, instance: str) -> None:
        super().__init__(segment_name(system, instance, "mailbox"))
        self.layout = [(int(row["offset from B"]), int(row["bytes each"])) for row in table("Mailbox", "offset from B")]
        (self.sent, _), (self.taken, _), (self.answered, _), (self.locks, _), (self.holders, _), (self.queues, _) = [
            (self.first + 16 + at, size) for at, size in self.layout]
        self.commands, self.command_bytes = map(int, re.findall(r"command slot n mod (\d+), (\d+) bytes each", TEXT)[0])
        self.replies, self.reply_bytes = map(int, re.findall(r"reply slot n mod (\d+), (\d+) bytes each", TEXT)[0])

    def sign(self, place: int, pid: int, program: bytes) -> None:
        struct.pack_into("<I60s", self.map, self.holders + place * self.layout[4][1], pid, program)

    def send(self, place: int, n: int, code: int, values: tuple[float, ...], stamp_ns: int) -> None:
        at, fields = self.queues + place * self.layout[5][1] + n % self.commands * self.command_bytes, records(1)
        for form, field, value in (("<q", "stamp_ns", stamp_ns), ("<Q", "id", n), ("<H", "code", code),
                                   ("<H", "count", len(values)), ("64s", "text", b"by hand"),
                                   (f"<{len(values)}d", "values", values)):
            struct.pack_into(form, self.map, at + offset(fields, field), *np.atleast_1d(value).tolist())
        struct.pack_into("<Q", self.map, self.sent + 8 * place, n)

    def reply(self, place: int, n: int) -> tuple[int, int, int, bytes]:
        """Sequence, id, outcome and text of a reply."""
        at = self.queues + place * self.layout[5][1] + self.commands * self.command_bytes
        at, fields = at + n % self.replies * self.reply_bytes, records(2)
        text = at + offset(fields, "text")
        numbers = (struct.unpack_from("<Q", self.map, at + offset(fields, name))[0] for name in ("sequence", "id"))
        return (*numbers, self.map[at + offset(fields, "outcome")],
                self.map[text : text + int(fields["text"]["size"])].rstrip(b"\0"))


def test_a_client_made_from_the_page_is_served(system: str) -> None:
    create_mailbox(system, "PSM1", "arm", COMMANDS["arm"])
    owner, seen = Mailbox(system, "PSM1", COMMANDS["arm"]), MailByThePage(system, "PSM1")
    assert [size for _, size in seen.layout[:4]] == [8, 8, 8, 1]
    assert seen.layout[5] == (QUEUES_AT, seen.commands * seen.command_bytes + seen.replies * seen.reply_bytes)
    ours = take_place(system, "PSM1")  # has place 0
    assert not seen.lock(seen.locks) and seen.lock(seen.locks + 1)
    for n in range(1, 40):
        seen.send(1, n, ARM.index("move_jp"), (n, 0.5), 5)
        (got,) = owner.drain()
        assert (got.name, got.id, got.sent_ns, got.text, got.values.tolist()) == ("move_jp", n, 5, "by hand", [n, 0.5])
        assert struct.unpack_from("<Q", seen.map, seen.taken + 8) == (n,)
        got.refuse(f"no {n}")
        assert struct.unpack_from("<Q", seen.map, seen.answered + 8) == (n,)
        assert seen.reply(1, n) == (n, n, received.REFUSED, f"no {n}".encode())
    assert ours.poll() == []
    for end in (ours, owner, seen):
        end.close()


def test_who_has_a_place_by_the_page_can_be_named_and_stopped(system: str) -> None:
    create_mailbox(system, "PSM1", "arm", COMMANDS["arm"])
    owner, seen = Mailbox(system, "PSM1", COMMANDS["arm"]), MailByThePage(system, "PSM1")
    for place in range(mailbox_map.CLIENTS):
        assert seen.lock(seen.locks + place)
        seen.sign(place, os.getpid(), "größer".encode())
    with pytest.raises(SegmentError, match=rf"taken: größer \(pid {os.getpid()}, 16 places\); close one"):
        take_place(system, "PSM1")
    seen.send(3, 1, ARM.index("move_jp"), (1.0,), 5)
    stops = mailbox_map.RESERVED
    assert seen.lock(seen.locks + stops)
    seen.sign(stops, os.getpid(), b"by hand")
    seen.send(stops, 1, ARM.index("hold"), (), 6)
    assert [got.name for got in owner.drain()] == ["hold"]
    assert seen.reply(3, 1) == (1, 1, received.REFUSED, f"stopped by by hand (pid {os.getpid()})".encode())
    for end in (owner, seen):
        end.close()


def test_a_sleeper_made_from_the_page_is_woken(system: str) -> None:
    create_control(system, "PSM1")
    page, seen = ControlPage(system, "PSM1", write=True), ByThePage(segment_name(system, "PSM1", "control"))
    word = seen.first + offset(records(0), "wakeup")
    seen.map[word : word + 4] = struct.pack("<I", 1)
    page.wakeup().wake()
    assert struct.unpack_from("<I", seen.map, word) == (0,)
    seen.close()
    page.close()


def test_a_subscriber_made_from_the_page_is_counted_while_it_lives(system: str) -> None:
    create_control(system, "PSM1", topics=(EVENTS,))
    page, seen = ControlPage(system, "PSM1", write=True), ByThePage(segment_name(system, "PSM1", "control"))
    subscriptions, clearing, cells = Subscriptions(page), Clearing(page), records(0)
    at = seen.first + offset(cells, "wanted") + 5 * 8
    assert seen.lock(seen.first + offset(cells, "place") + 5)  # C1
    seen.map[at : at + 8] = struct.pack("<Q", 1)  # C2, D1
    assert clearing.clear() == 0 and subscriptions.look() and subscriptions.wanted == subscriptions.bits("events")
    seen.close()
    assert clearing.clear() == 1 and subscriptions.look() and not subscriptions.wanted
    page.close()
