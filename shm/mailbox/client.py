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
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np

from trocar.shm.mailbox.generations import Faults
from trocar.shm.mailbox.messages import Reply
from trocar.shm.mailbox.origins import ACTING, NO_ORIGIN, Origin, new_id, program_name
from trocar.shm.mailbox.place import STOP_TRIES, MailboxFull, Place, StopPlace
from trocar.shm.memory import private
from trocar.shm.memory.header import SegmentError
from trocar.shm.memory.segment import segment_name, status_of
from trocar.shm.time.clock import monotonic_ns

__all__ = ["Client", "LoopClient", "MailboxFull", "Reply", "begin"]

KEPT: Final = 1000  # commands without a final reply yet
STREAM_NS: Final = 100_000_000  # a stream that pauses this long has ended
Key = tuple[int, int, str]


class SharedPlace(Place):
    """The place of all handles of this process to one mailbox."""

    def __init__(self, system: str, instance: str, program: str) -> None:
        """Attach; SegmentError if there is no such mailbox."""
        super().__init__(system, instance, program)
        self._address = system, instance, program
        self._rows = {row.name: row for row in self.table}
        self.streams = {row.name for row in self.table if row.stream}
        self._faults: Faults | None = None
        self._knows_faults = False
        self._stops: StopPlace | None = None
        self._senders: dict[int, Client] = {}
        self.has_place = self._is_stopping = self.is_sending = False
        self.handles, self._pid, self._is_copy = 0, os.getpid(), False
        self.lock, self._stop_lock = threading.RLock(), threading.RLock()

    def claim(self) -> None:
        """Take the place; SegmentError names the holders if all are taken."""
        if self._is_copy:
            raise SegmentError(f"{self.instance}: this was opened by the process that forked us (pid {self._pid}); "
                               "open it here once more")
        super().claim()
        self.has_place = True

    def generation(self) -> int:
        """Number of faults of the system so far; 0 without a page of faults."""
        if not self._knows_faults:
            self._knows_faults = True
            with contextlib.suppress(SegmentError):
                self._faults = Faults(self._address[0])
        return self._faults.generation() if self._faults is not None else 0

    def send_for(self, handle: Client, name: str, values: Any, text: str, origin: Origin) -> int:
        """Send through our own place; MailboxFull or SegmentError if there is no room."""
        if not self.has_place:
            self.claim()
        sent_ns = handle.sent_ns
        if sent_ns and self._stops_something(name, values, text):
            sent_ns = 0
        number = self.send(name, values, text, origin, handle.peer, sent_ns=sent_ns)
        self.note(handle, (number,))
        return number

    def note(self, handle: Client, numbers: Iterable[int]) -> None:
        """Replies to these commands, sent in our place by code that is not Python, are for this handle."""
        for number in numbers:
            self._senders[number] = handle
            if len(self._senders) > KEPT:
                with contextlib.suppress(KeyError):  # an interrupting handler hands out replies as well
                    del self._senders[next(iter(self._senders))]

    def stop_for(self, handle: Client, name: str, values: Any, text: str, tries: int) -> int:
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
        return row is not None and row.is_stop(text, np.asarray(values, dtype=np.float64).reshape(-1))

    def hand_out(self) -> None:
        """Give each new reply to its sender; replies to unknown commands belonged to the place's previous client."""
        replies = self.poll() if self.has_place else []
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
        super().close()
        for part in (self._stops, self._faults):
            if part is not None:
                part.close()
        self._stops = self._faults = None


class SharedPlaces:
    """Those of this process, by the mailbox's file: a mailbox made again under the same name is another one.

    In a system private to this process, loops have places of their own, as processes do: by the names they report.
    """

    def __init__(self) -> None:
        self._places: dict[Key, SharedPlace] = {}
        self._lock = threading.RLock()

    def open(self, system: str, instance: str, called: str) -> SharedPlace:
        """The place for one more handle; SegmentError if there is no such mailbox."""
        own = called if private.is_kept(system) else ""
        with self._lock:
            place = self._places.get((*_file(system, instance), own))
            if place is None:
                place = SharedPlace(system, instance, called)
                self._places[*place.file, own] = place
            place.handles += 1
            return place

    def leave(self, place: SharedPlace) -> None:
        """A handle is closed; with the last one the place is free."""
        with self._lock:
            place.handles -= 1
            if not place.handles and place in self._places.values():  # else it was closed by a fork
                self._places = {key: each for key, each in self._places.items() if each is not place}
                place.close()

    def forked(self) -> None:
        """We are in a child."""
        self._lock = threading.RLock()
        for place in self._places.values():
            place.forked()
        self._places.clear()


def _file(system: str, instance: str) -> tuple[int, int]:
    try:
        status = status_of(segment_name(system, instance, "mailbox"))
    except OSError:
        return 0, 0
    return status.st_dev, status.st_ino


PLACES: Final = SharedPlaces()
os.register_at_fork(after_in_child=PLACES.forked)


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
        self.origin: Origin = NO_ORIGIN
        """Of the last command sent."""
        self.seen: int | None = None
        """Number of faults that a remote person, informed late, knows of; None: all."""
        self.sent_ns = 0
        """When such a person sent the next command at the earliest, on CLOCK_MONOTONIC; 0: when it is sent here. A stop
        always counts from then: it concerns all that was sent before.
        """
        self._whole: Origin | None = None
        self._stream, self._streamed_ns = NO_ORIGIN, -STREAM_NS
        self.inbox: list[Reply] = []
        """Replies that were fetched, also by another handle, and are not collected yet."""
        self._place = PLACES.open(system, instance, holder or called or program_name())
        self.program, self._closed = called or program_name(), False
        """The name that others see in its next commands."""

    @property
    def commands(self) -> list[dict[str, Any]]:
        """The owner's command table, as its mailbox describes it."""
        return self._place.commands

    def on_behalf(self, origin: Origin) -> None:
        """From now on commands are steps of this one command of a person, see `begin`."""
        self.origin = self._whole = origin

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its number, not 0; KeyError: no such command.

        `values` are at most 64 numbers, a sequence or an array, `text` at most 64 bytes of UTF-8. Except for a stop:
        MailboxFull if the owner does not keep up, SegmentError if all places are taken.
        """
        place = self._place
        try:
            with place.lock:
                origin = self._own_origin(name in place.streams)
                if place.is_sending:
                    raise MailboxFull(f"{self.instance}: another command is being sent")
                place.is_sending = True
                try:
                    return place.send_for(self, name, values, text, origin)
                finally:
                    place.is_sending = False
        except (MailboxFull, SegmentError):
            if number := place.stop_for(self, name, values, text, STOP_TRIES):
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
        generation = self._place.generation() if self.seen is None else self.seen
        self.origin = origin = Origin(self._new_number(), generation, self.program)
        if streams:
            self._stream = origin
        return origin

    def pass_over(self) -> None:
        """A goal of a stream is not sent; the next one continues the stream."""
        self._own_origin(True)

    def join(self) -> None:
        """A stream that is under way now began before we came: its goals have no origin until it pauses."""
        self._stream, self._streamed_ns = NO_ORIGIN, self._time_ns()

    def begin(self) -> None:
        """Take the place now, and look for the page of faults, which is else done with the first command."""
        with self._place.lock:
            self._place.generation()
            if not self._place.has_place:
                self._place.claim()

    def poll(self) -> list[Reply]:
        """Replies to our commands since the last call, in order."""
        with self._place.lock:
            self._place.hand_out()
            found, self.inbox = self.inbox, []
        return found

    def replies_to(self, number: int) -> list[Reply]:
        """Replies to one command that were not collected yet; those to others wait, the newest KEPT of them."""
        with self._place.lock:
            self._place.hand_out()
            found = [reply for reply in self.inbox if reply.id == number]
            if found or len(self.inbox) > KEPT:
                self.inbox = [reply for reply in self.inbox if reply.id != number][-KEPT:]
        return found

    def forget(self) -> None:
        """Forget all sent commands: waiting replies and a stream under way are no longer ours."""
        self.origin, self._whole, self._stream, self._streamed_ns = NO_ORIGIN, None, NO_ORIGIN, -STREAM_NS
        self.inbox = []

    def close(self) -> None:
        """With the last handle the place is free."""
        if not self._closed:
            self._closed = True
            PLACES.leave(self._place)


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
            if not self._place.has_place:
                self._place.claim()
        except BaseException:
            self.close()
            raise

    def send(self, name: str, values: Any = (), text: str = "") -> int:
        """Queue a command, returns its number; 0 without room, or after its time limit."""
        if self._is_over():
            return 0
        place = self._place
        try:
            return place.send_for(self, name, values, text, self.origin)
        except MailboxFull:
            try:
                return place.stop_for(self, name, values, text, 1)
            except (MailboxFull, SegmentError):
                return 0

    @property
    def own_place(self) -> Place | None:
        """The place, for code that sends in it; None: other handles may send there, too."""
        return self._place if self._place.handles == 1 else None

    def note(self, numbers: Iterable[int]) -> None:
        """Receive the replies to commands that such code has sent."""
        self._place.note(self, numbers)
