"""The connected pages: their data, their requests, and which of them has control."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections import deque
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
from starlette.websockets import WebSocket

from trocar.procs.crtk.calls import Calls, ClientCounts, CommandOwner
from trocar.procs.crtk.held import HeldDown
from trocar.procs.crtk.messages import MAX_BYTES, Message, WrongMessage, parsed, said
from trocar.procs.crtk.plain import plain
from trocar.procs.document.bridges import Rights
from trocar.procs.gui.control import BrowserControl, Ticks
from trocar.procs.gui.messages import OPS
from trocar.procs.gui.past import Past
from trocar.procs.gui.scene_source import ArmModels
from trocar.procs.gui.sources import Sources
from trocar.procs.kinematics.poses import POSE
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingError
from trocar.shm.time.clock import local_ns, monotonic_ns

LATE_NS: Final = 1_000_000_000
"""Maximum age of a request on arrival, as in mailboxes."""
HELD_LATE_NS: Final = 300_000_000
"""The same for requests repeated while a button is held: over a slow connection the action may last that much longer
after the release. A shorter limit would end it at every short delay of a computer or network: ticks are 50 ms apart,
and a page draws between them.
"""
PENDING: Final = 5
"""Ticks that a browser has not taken; then it gets the newest of all instead."""
WAITING: Final = 256
"""Answers that a browser has not taken."""
A_TICK_NS: Final = 10_000_000
"""Part of a tick in which one page's messages are handled; the rest waits for the next tick. A page of ours needs a
tenth of it, and a page that sends thousands of messages delays no other.
"""
PERSON: Final = Rights(True, True, True)
NUMBERS: Final = itertools.count(1)


@dataclass(frozen=True, slots=True)
class ConsoleService:
    """Shared by all pages."""

    system: str
    owners: Mapping[str, CommandOwner]
    sources: Sources
    is_over: Callable[[], bool]
    models: ArmModels
    run: str
    """Name of the pages that this server has: a page of another name is not its own."""
    generation: Callable[[], int]
    """Number of faults of the system so far."""
    ends: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    """Steps of Stop and of Power off: a page of other pages than these uses them, too."""
    past: Past | None = None
    ticks: Ticks = field(default_factory=Ticks)
    control: BrowserControl = field(default_factory=BrowserControl)
    counts: ClientCounts = field(default_factory=ClientCounts)
    persons: dict[str, str] = field(default_factory=dict)
    """Names of operators, once given, by browser; several browsers may have the same."""

    def person(self, browser: str) -> str:
        """Name of its operator, by default its address and port; empty: no browser."""
        return self.persons.get(browser, browser)

    def calls(self) -> Calls:
        """Access to all owners, for a person's commands."""
        made = Calls(self.system, self.owners, PERSON, self.is_over, "gui")
        made.program = "gui"
        return made


class Browser:
    """One page that is connected."""

    def __init__(self, served: ConsoleService, held: HeldDown, socket: WebSocket, name: str, *,
                 is_outdated: bool = False) -> None:
        """`name`: its address and port, which no other one has; `is_outdated`: its pages are not those of this run."""
        self.name, self._is_outdated = name, is_outdated
        self.wants: tuple[str, ...] = ()
        self.has_control = False
        """As last reported to the page."""
        self._served, self._held, self._socket = served, held, socket
        self._calls = served.calls()
        self._answers: deque[bytes] = deque()
        self._ticks: deque[bytes] = deque()
        self._news = asyncio.Event()
        self._has_time, self._left_ns = asyncio.Event(), A_TICK_NS
        self._has_time.set()
        self._shown: dict[str, bytes] = {}
        self._is_over = False
        self._end: asyncio.Future[None] | None = None
        self._ops: dict[str, Callable[[Message, int], None]] = {
            "want": self._want, "beat": self._beat, "control": self._control, "call": self._call,
            "preview": self._preview, "jog": self._jog, "past": self._past}
        self._remembered: asyncio.Future[bytes] | None = None
        """The answer to a question about the past, until it is sent: a page has one at a time."""
        self._say("hello", run=served.run, name=name, system=served.system, **served.ends,
                  now=local_ns() // 1_000_000)

    # -- messages from the page

    async def listen(self, receive: Callable[[], Awaitable[str]]) -> None:
        """Handle incoming messages within this tick's time limit; until `receive` ends it."""
        while True:
            text = await receive()
            await self._has_time.wait()
            begin_ns = monotonic_ns()
            self.handle(text)
            self._left_ns -= monotonic_ns() - begin_ns
            if self._left_ns <= 0:
                self._has_time.clear()

    def begin(self) -> None:
        """A new tick."""
        self._left_ns = A_TICK_NS
        self._has_time.set()

    def handle(self, text: str) -> None:
        """Handle one message; an error in it is answered, and has no other effect."""
        if self._is_over:
            return
        number: Any = None
        try:
            if len(text) > MAX_BYTES:
                raise WrongMessage(f"a message has {MAX_BYTES} bytes at most")
            asked = parsed(text, OPS)
            number = asked.id
            self._ops[asked.op](asked, monotonic_ns())
        except WrongMessage as error:
            self._refuse(error.id if number is None else number, str(error))
        except (SegmentError, RingError, OSError, ValueError) as error:
            self._refuse(number, str(error))

    def _refuse(self, number: Any, why: str) -> None:
        self._served.counts.refused += 1
        self._say("reply", number, outcome="refused", text=why)

    def _want(self, asked: Message, now_ns: int) -> None:
        wants = tuple(dict.fromkeys(asked.parts["sources"]))
        self._served.sources.change(self.wants, wants)
        self.wants = wants
        self._shown.clear()

    def _beat(self, asked: Message, now_ns: int) -> None:
        served = self._served
        heard = served.ticks.heard(asked.parts["tick"])
        if heard is not None:
            served.control.beat(self.name, now_ns, heard.sent_ns)

    def _control(self, asked: Message, now_ns: int) -> None:
        control, expected = self._served.control, asked.parts["from"]
        holder = control.holder(now_ns)
        if not asked.parts["take"]:
            control.drop(self.name)
        elif self._is_outdated:
            raise WrongMessage("this page is outdated: load it again")
        elif expected and holder not in ("", self.name) and self._served.person(holder) != expected:
            raise WrongMessage(f"{self._served.person(holder)} has control now, not {expected}; press it again")
        elif control.take(self.name, now_ns, over=asked.parts["over"]) != self.name:
            raise WrongMessage("another page has control")
        if asked.parts["person"]:
            self._served.persons[self.name] = asked.parts["person"]
        if asked.id is not None:
            self._say("reply", asked.id, outcome="done", text="")

    def _call(self, asked: Message, now_ns: int) -> None:
        served, parts = self._served, asked.parts
        since = parts["since"]
        to, command, values, text = parts["to"], parts["command"], list(parts["values"]), parts["text"]
        owner = self._calls.owner(to)
        row = owner.rows.get(command)
        only_stops = row is not None and row.is_stop(text, values)  # any page may stop something, without control
        is_held = row is not None and row.stream
        seen = None if only_stops else self._seen(asked, now_ns, HELD_LATE_NS if is_held else LATE_NS)
        if since and seen is not None and served.ticks.generation(since) != served.generation():
            raise WrongMessage("a fault has come since this was pressed; press it again")
        self._calls.send(asked.id, to, command, values, text, seen)
        served.counts.commands += 1
        self._held.note(self.name, to, command, values, text)

    def _preview(self, asked: Message, now_ns: int) -> None:
        """Link positions of an arm at these joints, or with its tip at this pose; no command is sent to the arm."""
        arm, pose = self._served.models.arm(asked.parts["arm"]), np.array(asked.parts["pose"])
        if len(pose) not in (0, POSE):
            raise WrongMessage(f"a pose has {POSE} numbers: x y z and a quaternion x y z w")
        found = arm.reaching(pose) if len(pose) else arm.at(np.array(asked.parts["position"]))
        self._say("reply", asked.id, outcome="done", text=json.dumps(plain(found)))

    def _past(self, asked: Message, now_ns: int) -> None:
        """The data of sources at a time, and samples of some."""
        if self._served.past is None or self._remembered is not None:
            raise WrongMessage("one question about the past at a time")
        self._remembered = asyncio.wrap_future(self._served.past.ask(asked.parts, asked.id))
        self._remembered.add_done_callback(partial(self._remember, asked.id))

    def _remember(self, number: Any, found: asyncio.Future[bytes]) -> None:
        if found.cancelled():
            return
        error = found.exception()
        if error is not None:
            self._remembered = None
            self._refuse(number, str(error))
        else:
            self._answers.append(found.result())
            self._news.set()

    def _jog(self, asked: Message, now_ns: int) -> None:
        """Joint velocities for a motion of the tip; the arm ends it 0.1 s after the last one."""
        parts, seen = asked.parts, self._seen(asked, now_ns, HELD_LATE_NS)
        twist = np.array(parts["twist"])
        if twist.shape != (6,):
            raise WrongMessage("a twist has 6 numbers")
        velocity = self._served.models.arm(parts["arm"]).velocity(twist, parts["in_tip"])
        self._calls.send(asked.id, parts["arm"], "servo_jv", velocity.tolist(), "", seen)
        self._served.counts.commands += 1

    def _seen(self, asked: Message, now_ns: int, late_ns: int) -> int:
        """Number of faults that the person knew of at this request; WrongMessage if it is late or lacks control.

        The arrival time proves nothing: the network may hold a message for seconds, and deliver it after the button was
        released, or after a fault.
        """
        if self._served.control.holder(now_ns) != self.name:
            raise WrongMessage("take control first: this page is read-only")
        heard = self._served.ticks.heard(asked.parts["tick"])
        if heard is None or now_ns - heard.sent_ns > late_ns:
            raise WrongMessage(f"it came too late: more than {late_ns * 1e-9:g} s after the data that this page had; "
                               "the connection to the console is slow")
        return heard.generation

    # -- messages to the page

    def _say(self, op: str, number: Any = None, **parts: Any) -> None:
        if len(self._answers) < WAITING:
            self._answers.append(said(op, number, **parts))
            self._news.set()

    def look(self) -> None:
        """Pass on the replies to its commands."""
        for call, reply in self._calls.replies():
            self._say("reply", call.id, to=call.to, command=call.command, outcome=reply.outcome, text=reply.text)

    def show(self, number: int, holder: str, person: str) -> None:
        """Queue the changes of its data; all of the data if the page does not take its messages.

        `holder`, `person`: browser in control, and its operator.
        """
        counts, parts = self._served.counts, []
        if len(self._ticks) == PENDING:
            counts.lost += PENDING
            self._ticks.clear()
            self._shown.clear()
        for name in self.wants:
            part = self._served.sources.part(name)
            if self._shown.get(name) != part:
                self._shown[name] = part
                parts.append(part)
        self.has_control = holder == self.name
        head = said("tick", number, control=person, you=self.has_control)[:-1]
        self._ticks.append(head + b',"data":{' + b",".join(parts) + b"}}")
        counts.sent += 1
        self._news.set()

    async def deliver(self) -> None:
        """Send all queued messages, as fast as the page takes them; until cancelled."""
        while True:
            await self._news.wait()
            self._news.clear()
            while self._answers:
                answer = self._answers.popleft()
                await self._socket.send_text(answer.decode())
                if self._remembered is not None and self._remembered.done() and answer is self._remembered.result():
                    self._remembered = None
            while self._ticks:
                await self._socket.send_text(self._ticks.popleft().decode())

    def forget(self, why: str) -> None:
        """Disconnect it, and ignore its further messages."""
        self._is_over = True
        self._end = asyncio.ensure_future(self._socket.close(1012, why))

    def gone(self) -> None:
        """The page has left: control and held buttons are released, subscriptions end. Commands under way finish."""
        self._served.control.drop(self.name)
        self._served.persons.pop(self.name, None)
        self._served.sources.leave(self.wants)
        self.wants = ()
        self._calls.close()
        if self._remembered is not None:
            self._remembered.cancel()


class Browsers:
    """All connected browsers."""

    def __init__(self, served: ConsoleService) -> None:
        self.served = served
        self.all: set[Browser] = set()
        self._held = HeldDown(served.calls())

    def come(self, socket: WebSocket, peer: str, run: str = "") -> Browser:
        """A page connects; `run`: the name of its pages, if it gives one."""
        browser = Browser(self.served, self._held, socket, peer, is_outdated=run not in ("", self.served.run))
        self.all.add(browser)
        return browser

    def leave(self, browser: Browser) -> None:
        """A page has left."""
        self.all.discard(browser)
        browser.gone()

    def person(self, holder: str) -> str:
        """Name of the operator in control; empty: there is none."""
        return self.served.person(holder)

    def tick(self, now_ns: int) -> None:
        """Once a cycle: one message to each page with all its data; each value is read once for all pages."""
        served = self.served
        holder, number = served.control.holder(now_ns), served.ticks.add(now_ns, served.generation())
        self._held.tick(holder, served.control.is_free(now_ns))
        served.sources.begin(now_ns)
        person = self.person(holder)
        for browser in self.all:
            browser.begin()
            browser.look()
            # A hidden page is also informed when it gains or loses control.
            if browser.wants or browser.name == holder or browser.has_control:
                browser.show(number, holder, person)

    def forget(self, why: str) -> None:
        """Messages received meanwhile are out of date: all pages are disconnected, none has control."""
        for browser in self.all:
            self.served.control.drop(browser.name)
            browser.forget(why)

    def close(self) -> None:
        """The console ends: release all held buttons."""
        self._held.end()
        self._held.close()
