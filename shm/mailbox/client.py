"""Handles for commands to one owner. All handles of a process to one mailbox share one place in it
(shm/mailbox/place.py).

Commands through a Client are a person's commands (shm/mailbox/origins.py); a LoopClient passes on commands that
originate elsewhere.

The first command takes the place, closing the last handle gives it back. A stop that does not fit into the mailbox or
into our own queue is sent through the place reserved for stops. Each handle gets the replies to its own commands.
Handles may be used by several threads and by signal handlers: a stop sent by a signal handler is sent, whatever code
the handler interrupted. In a forked child, handles raise an error: the place is the parent's.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from trocar.shm.mailbox.generations import Faults
from trocar.shm.mailbox.messages import Reply
from trocar.shm.mailbox.origins import ACTING, NOBODY, Origin, new_id, program_name
from trocar.shm.mailbox.place import STOP_TRIES, MailboxFull, Place, StopPlace
from trocar.shm.memory import private
from trocar.shm.memory.header import SegmentError
from trocar.shm.memory.segment import path_of, segment_name
from trocar.shm.time.clock import monotonic_ns

__all__ = ["Client", "LoopClient", "MailboxFull", "Reply", "begin"]

KEPT: Final = 1000  # commands without a final reply yet
STREAM_NS: Final = 100_000_000  # a stream that pauses this long has ended
Key = tuple[int, int, str]


class MailboxShare:
    """Shared by all handles of this process to one mailbox."""

    def __init__(self, system: str, instance: str, program: str) -> None:
        """Attach; SegmentError if there is no such mailbox."""
        self._address = system, instance, program
        self.instance = instance
        self.place = Place(system, instance, program)
        self.key = _key(self.place.file, system, program)
        self._rows = {row.name: row for row in self.place.table}
        self.streams = {row.name for row in self._rows.values() if row.stream}
        self._faults: Faults | None = None
        self._knows_faults = False
        self._stops: StopPlace | None = None
        self._senders: dict[int, Client] = {}
        self.has_place = self._is_stopping = self.is_sending = False
        self.handles, self._pid, self._is_copy = 0, os.getpid(), False
        self.lock, self._stop_lock = threading.RLock(), threading.RLock()

    def take_place(self) -> None:
        """Take the place; SegmentError names the holders if all are taken."""
        if self._is_copy:
            raise SegmentError(f"{self.instance}: this was opened by the process that forked us (pid {self._pid}); "
                               "open it here once more")
        self.place.claim()
        self.has_place = True

    def generation(self) -> int:
        """Number of faults of the system so far; 0 without a page of faults."""
        if not self._knows_faults:
            self._knows_faults = True
            with contextlib.suppress(SegmentError):
                self._faults = Faults(self._address[0])
        return self._faults.generation() if self._faults is not None else 0

    def send(self, handle: Client, name: str, values: Any, text: str, origin: Origin) -> int:
        """Send through our own place; MailboxFull or SegmentError if there is no room."""
        if not self.has_place:
            self.take_place()
        sent_ns = handle.sent_ns
        if sent_ns and self._stops_something(name, values, text):
            sent_ns = 0
        number = self.place.send(name, values, text, origin, handle.peer, sent_ns=sent_ns)
        self._senders[number] = handle
        if len(self._senders) > KEPT:
            self._forget_oldest()
        return number

    def stop(self, handle: Client, name: str, values: Any, text: str, tries: int) -> int:
        """Through the place for stops; 0 when it is no stop. MailboxFull or SegmentError when there is no room either.
        """
        if self._is_copy or not self._stops_something(name, values, text):
            return 0
        numbers = np.asarray(values, dtype=np.float64).reshape(-1)
        with self._stop_lock:
            if self._is_stopping:
                raise MailboxFull(f"{self.instance}: another stop is being sent")
            self._is_stopping = True
            try:
                if self._stops is None:
                    self._stops = StopPlace(*self._address)
                number = self._stops.stop(name, numbers, text, tries, handle.origin, handle.peer)
                self._senders[number] = handle
                return number
            finally:
                self._is_stopping = False

    def _stops_something(self, name: str, values: Any, text: str) -> bool:
        row = self._rows.get(name)
        numbers = np.asarray(values, dtype=np.float64).reshape(-1)
        return row is not None and row.is_stop(text, numbers)

    def _forget_oldest(self) -> None:
        with contextlib.suppress(KeyError):  # an interrupting handler hands out replies as well
            del self._senders[next(iter(self._senders))]

    def hand_out(self) -> None:
        """Give each new reply to its sender; replies to unknown commands belonged to the place's previous client."""
        replies = self.place.poll() if self.has_place else []
        if self._stops is not None:
            with self._stop_lock:
                replies += [] if self._is_stopping else self._stops.answers()
        for reply in replies:
            under_way = reply.outcome == "accepted"
            sender = self._senders.get(reply.id) if under_way else self._senders.pop(reply.id, None)
            if sender is not None:
                sender.inbox.append(reply)

    def forked(self) -> None:
        """We are in a forked child of the process that has the place."""
        self._is_copy = True
        self.lock, self._stop_lock = threading.RLock(), threading.RLock()  # their holders do not exist here
        self.close()

    def close(self) -> None:
        """Unmap, and free the place."""
        self.has_place = False
        self.place.close()
        for part in (self._stops, self._faults):
            if part is not None:
                part.close()
        self._stops = self._faults = None


class Desks:
    """This process's shares, by the mailbox's file: a mailbox made again under the same name is another one.

    In a system private to this process, loops have desks of their own, as processes do: by the names they report.
    """

    def __init__(self) -> None:
        self._desks: dict[Key, MailboxShare] = {}
        self._lock = threading.RLock()

    def open(self, system: str, instance: str, called: str) -> MailboxShare:
        """The desk for one more handle; SegmentError if there is no such mailbox."""
        with self._lock:
            desk = self._desks.get(_key(_file(system, instance), system, called))
            if desk is None:
                desk = MailboxShare(system, instance, called)
                self._desks[desk.key] = desk
            desk.handles += 1
            return desk

    def leave(self, desk: MailboxShare) -> None:
        """A handle is closed; with the last one the place is free."""
        with self._lock:
            desk.handles -= 1
            if not desk.handles and self._desks.get(desk.key) is desk:
                del self._desks[desk.key]
                desk.close()

    def forked(self) -> None:
        """We are in a child."""
        self._lock = threading.RLock()
        for desk in self._desks.values():
            desk.forked()
        self._desks.clear()


def _key(file: tuple[int, int], system: str, called: str) -> Key:
    return *file, called if private.is_kept(system) else ""


def _file(system: str, instance: str) -> tuple[int, int]:
    path = path_of(segment_name(system, instance, "mailbox"))
    try:
        status = path.stat() if private.is_kept(system) else path.lstat()
    except OSError:
        return 0, 0
    return status.st_dev, status.st_ino


DESKS: Final = Desks()
os.register_at_fork(after_in_child=DESKS.forked)


def begin(system: str) -> Origin:
    """A person's command that takes several steps, see Client.on_behalf: after a fault none of them is carried out."""
    if (acting := ACTING.in_system(system)) is not None:
        return acting
    generation = 0
    with contextlib.suppress(SegmentError), contextlib.closing(Faults(system)) as faults:
        generation = faults.generation()
    return Origin(new_id(), generation, program_name())


class Client:
    """One handle. Its place is taken with the first command."""

    def __init__(self, system: str, instance: str, called: str = "", time_ns: Callable[[], int] = monotonic_ns,
                 number: Callable[[], int] = new_id, peer: int = 0, holder: str = "") -> None:
        """SegmentError when the instance has no mailbox; `called`: the name that others see, default our program's.

        `time_ns` tells whether a stream has paused, `number` numbers the person's commands. `peer`: which client of a
        bridge, see SenderId; `holder`: the bridge's own name, as holder of the place that its clients share.
        """
        self._system, self.instance, self.peer = system, instance, peer
        self._time_ns, self._new_number = time_ns, number
        self.origin: Origin = NOBODY
        """Of the last command sent."""
        self.seen: int | None = None
        """Number of faults that a remote person, informed late, knows of; None: all."""
        self.sent_ns = 0
        """When such a person sent the next command at the earliest, on CLOCK_MONOTONIC; 0: when it is sent here. A stop
        always counts from then: it concerns all that was sent before.
        """
        self._whole: Origin | None = None
        self._stream, self._streamed_ns = NOBODY, -STREAM_NS
        self.inbox: list[Reply] = []
        """Replies that another handle has fetched for this one."""
        self._desk = DESKS.open(system, instance, holder or called or program_name())
        self._program, self._closed = called or program_name(), False

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The owner's command table, as its mailbox describes it."""
        return self._desk.place.commands

    @property
    def lost(self) -> int:
        """Replies to any of our handles that were overwritten before they were read."""
        return self._desk.place.lost

    def on_behalf(self, origin: Origin) -> None:
        """From now on commands are steps of this one command of a person, see `begin`."""
        self.origin = self._whole = origin

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its number, not 0; KeyError: no such command.

        `values` are at most 64 numbers, a sequence or an array, `text` at most 64 bytes of UTF-8. Except for a stop:
        MailboxFull if the owner does not keep up, SegmentError if all places are taken.
        """
        desk = self._desk
        try:
            with desk.lock:
                origin = self._own_origin(name in desk.streams)
                if desk.is_sending:
                    raise MailboxFull(f"{self.instance}: another command is being sent")
                desk.is_sending = True
                try:
                    return desk.send(self, name, values, text, origin)
                finally:
                    desk.is_sending = False
        except (MailboxFull, SegmentError):
            if number := desk.stop(self, name, values, text, STOP_TRIES):
                return number
            raise

    def _own_origin(self, streams: bool) -> Origin:
        """A stream is one command of a person: if begun before a fault, it must not continue after it."""
        if (acting := ACTING.in_system(self._system)) is not None:
            self.origin = acting
            return acting
        if self._whole is not None:
            return self._whole
        if streams:
            now_ns = self._time_ns()
            sent_ns, last_ns = self.sent_ns or now_ns, self._streamed_ns
            self._streamed_ns = now_ns
            if sent_ns - last_ns < STREAM_NS:
                return self._stream
        generation = self._desk.generation() if self.seen is None else self.seen
        self.origin = origin = Origin(self._new_number(), generation, self._program)
        if streams:
            self._stream = origin
        return origin

    def pass_over(self) -> None:
        """A goal of a stream is not sent; the next one continues the stream."""
        self._own_origin(True)

    def join(self) -> None:
        """A stream that is under way now began before we came: its goals have no origin until it pauses."""
        self._stream, self._streamed_ns = NOBODY, self._time_ns()

    def begin(self) -> None:
        """Take the place now, and look for the page of faults, which is else done with the first command."""
        with self._desk.lock:
            self._desk.generation()
            if not self._desk.has_place:
                self._desk.take_place()

    def poll(self) -> list[Reply]:
        """Replies to our commands since the last call, in order."""
        with self._desk.lock:
            self._desk.hand_out()
            found, self.inbox = self.inbox, []
        return found

    def forget(self) -> None:
        """Forget all sent commands: waiting replies and a stream under way are no longer ours."""
        self.origin, self._whole, self._stream, self._streamed_ns = NOBODY, None, NOBODY, -STREAM_NS
        self.inbox = []

    def close(self) -> None:
        """With the last handle the place is free."""
        if not self._closed:
            self._closed = True
            DESKS.leave(self._desk)


class LoopClient(Client):
    """A handle for loops, for one thread: loops repeat their requests, so a full mailbox is not an error.

    It has no origin of its own: it passes on another person's command (`on_behalf`).
    """

    def __init__(self, system: str, instance: str, called: str = "", is_over: Callable[[], bool] = bool) -> None:
        """SegmentError when the instance has no mailbox, or all its places are taken.

        `is_over`: our cycle began so long ago that its commands must not be sent any more.
        """
        super().__init__(system, instance, called)
        self._is_over = is_over
        try:
            if not self._desk.has_place:
                self._desk.take_place()
        except BaseException:
            self.close()
            raise

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its number; 0 without room, or after its time limit."""
        if self._is_over():
            return 0
        desk = self._desk
        try:
            return desk.send(self, name, values, text, self.origin)
        except MailboxFull:
            try:
                return desk.stop(self, name, values, text, 1)
            except (MailboxFull, SegmentError):
                return 0

    def poll(self) -> list[Reply]:
        """Replies to our commands since the last call, in order."""
        self._desk.hand_out()
        found, self.inbox = self.inbox, []
        return found
