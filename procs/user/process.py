"""The base class of users' processes: setup, then main or an update each period, quit. See docs/write-a-process.md.

A process is a single thread. It handles commands, subscriptions and watched files only while it waits, in `tick` and
`wait`; only these two report that it must end.
"""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Protocol

from numpy.typing import NDArray

from trocar.procs.crtk.names import Unknown, none_such
from trocar.procs.crtk.user_rows import arguments_of, handler_of
from trocar.procs.document.user_process import PROPERTIES, SAVE_PROPERTIES, SET_PROPERTY, UserProcess
from trocar.procs.machine.paths import NoStateFolder, log_folder, made_log_folder
from trocar.procs.machine.verb_lines import REMEDY
from trocar.procs.node.node import Node
from trocar.procs.node.runtime import Loop
from trocar.procs.tables import codes
from trocar.procs.tables.manifest import proc
from trocar.procs.user.classes import classes_in, module_named
from trocar.procs.user.properties import Properties
from trocar.procs.user.subscription import SLOWEST_NS, Subscription
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.generations import Cell
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.mailbox.received import Received
from trocar.shm.memory.layout import shorten
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber
from trocar.shm.time.clock import monotonic_ns

BEAT_NS: Final = 50_000_000
SIMULATED_NS: Final = 2_000_000  # interval of reading the simulated time
NOT_YOURS: Final = "every trocar.Process has an attribute of this name; choose another one"
READ, WRITE, EXCEPT = select.POLLIN, select.POLLOUT, select.POLLPRI


TO_OVERRIDE: Final = frozenset((
    "setup", "update", "main", "quit", "guard", "property_changed", "check_commands",
    "error", "request", "held_up_s", "carries_out", "_acting"))  # these five are set while it runs


def _is_ours(kind: type) -> bool:
    """Whether a class is Trocar's or Python's; a bridge's module runs as `__main__`."""
    spec = getattr(sys.modules.get(kind.__module__), "__spec__", None)
    return f"{kind.__module__ if spec is None else spec.name}.".startswith(("trocar.", "builtins."))


class Watchable(Protocol):
    """An open file, serial line or socket."""

    def fileno(self) -> int:
        """Its descriptor."""


class UserLoop(Loop):
    """Base class: override `setup`, `update` (or `main`), `quit`, and add `on_NAME` for each command NAME."""

    LATER: Final = object()
    """A handler's return value if it answers `self.request` later, by `done` or `fail`."""

    def __init__(self, node: Node) -> None:
        """Claim its rings. ValueError: it is not a user process."""
        super().__init__(node)
        self.system, self.name, self.time = node.system, node.name, node.clock
        declared = self.declared = node.document.user(self.name) or _bare(node)
        self.log, self.stop = node.log, node.stop
        """`stop(reason)` ends the process at its next `tick` or `wait`."""
        of_kind = [directory.topic_of(node.kind, topic) for topic in proc(node.kind).topics]
        topics = {row.name: [field.name for field in row.fields] for rows in (declared.topics, of_kind) for row in rows}
        self._rings = {topic: node.writes(topic) for topic in topics}
        self._fields = {topic: {name: self._rings[topic].field(name) for name in names}
                        for topic, names in topics.items()}
        self.properties = Properties(declared.properties, node.writes(PROPERTIES) if declared.properties else None,
                                     self.time)
        self._saved = log_folder(os.environ, self.system) / f"{self.name}.properties.json"
        self.properties.load(self._saved, self.log)
        self._mailbox, self._wakeup = node.mailbox(self.guard()), node.page.wakeup()
        self._commands = {row.name: row for row in declared.commands}
        if taken := self._commands.keys() & {row.name for row in COMMANDS.get(node.kind, ())}:
            raise ValueError(f"{', '.join(sorted(taken))}: every {node.kind} has this command; it needs another name")
        self.carries_out: Callable[[Received], object] = self._nothing_else
        """Executes the commands of its kind, besides those that the system file declares."""
        self._subscriptions: list[Subscription] = []
        self._poll, self._files = select.poll(), set[int]()
        self._acting = ACTING.origin
        self.request: Received | None = None
        """The command that is being executed."""
        self.listening = node.listening
        """The sockets of its `listen`, non-blocking: `watch` them, and accept."""
        self.held_up_s = 0.0
        """Length of a stall before this period, s; otherwise 0."""
        self._keep_names()

    _kept = frozenset[str]()

    def _keep_names(self) -> None:
        """From now on, an error for a program's attribute that would replace one of ours, e.g. `node`."""
        kept = {*vars(self), *dir(UserLoop)} - TO_OVERRIDE
        for each in type(self).__mro__:
            for name in vars(each).keys() & kept:
                if not (name.startswith("__") or _is_ours(each)):
                    raise ValueError(f"{each.__name__}.{name}: {NOT_YOURS}")
        self._kept = frozenset(kept)

    if not TYPE_CHECKING:

        def __setattr__(self, name: str, value: object) -> None:
            if name in self._kept:
                raise AttributeError(f"self.{name}: {NOT_YOURS}")
            object.__setattr__(self, name, value)

    # to override

    def guard(self) -> Cell | None:
        """Faults after which its power or motion commands need a new operator command; None: no such commands."""
        return None

    # timing

    def tick(self) -> bool:
        """End this period, execute commands meanwhile; False when the process must end. Periods are system time."""
        self.node.tick(self._serve)
        self.process_messages()
        self._restart_after_stall()
        return not self.stop_reason

    def _serve(self, left_ns: int) -> bool:
        """Execute commands; without any, sleep."""
        if not self.process_messages():
            self._rest(max(left_ns, 200_000) if self.time.simulated else left_ns, False)
        return True

    def look_for_stall(self) -> None:
        """Begin a period; a stalled process restarts if its kind must not continue after a stall."""
        self.node.held_up_ns = self.node.pauses.next(self.node.pacing.period_ns)
        self._restart_after_stall()

    def _restart_after_stall(self) -> None:
        """Continue as if killed and restarted, with the same values, because `main` is the user's."""
        node, self.held_up_s = self.node, self.node.held_up_ns * 1e-9
        if node.held_up_ns:
            if proc(node.kind).pause_ends:
                for ring in self._rings.values():
                    ring.claim_again()
                node.begin_anew()
                node.begin()
            node.held_up_ns = 0
            node.pauses.begin()

    def wait(self, timeout: float) -> bool:
        """Wait for news (a command, subscribed record or watched file), at most `timeout` s; False: it must end."""
        end = monotonic_ns() + round(timeout * 1e9)
        while not self.node.stopped() and not self.has_news() and (left := end - monotonic_ns()) > 0:
            self._rest(left, True)
        return not self.stop_reason

    def has_news(self) -> bool:
        """Whether a command, a subscribed record or a watched file is waiting."""
        if self._mailbox.has_news or any(s.has_news for s in self._subscriptions):
            return True
        return bool(self._files) and bool(self._poll.poll(0))

    @property
    def stop_reason(self) -> str:
        """The reason of its end; empty while it runs."""
        return self.node.stop_reason

    def _rest(self, left_ns: int, looks: bool) -> None:
        """Sleep until a command arrives, at most `left_ns`, and only until the next poll of sources without wake-up."""
        most = SIMULATED_NS if self.time.simulated and not looks else BEAT_NS
        if looks and self._subscriptions:
            most = min(each.slice_ns for each in self._subscriptions)
        if looks and self._files:
            self._poll.poll(min(left_ns, most, SLOWEST_NS) / 1e6)
        else:
            self._wakeup.sleep(lambda: self._mailbox.has_news or bool(self.stop_reason), min(left_ns, most))

    # output

    def publish(self, topic: str, **fields: Any) -> None:
        """Write a record of one of its topics; other fields keep their values.

        KeyError lists the existing topics or fields; ValueError names the field whose value does not fit.
        """
        cells = self.cells(topic)
        for name, value in fields.items():
            try:
                cells[name][...] = value.encode() if isinstance(value, str) else value
            except KeyError:
                raise KeyError(none_such("field", name, cells, f"{self.name}/{topic}")) from None
            except (TypeError, ValueError) as error:
                raise ValueError(f"{self.name}/{topic}, field {name}: {error}") from None
        ring = self._rings[topic]
        ring.publish(max(self.time.now_ns(), ring.stamp_ns + 1))

    def cells(self, topic: str) -> dict[str, NDArray[Any]]:
        """The fields of the next record of one of its topics; get them again after a pause."""
        if topic not in self._fields:
            raise KeyError(none_such("topic", topic, self._fields, self.name))
        return self._fields[topic]

    def beat(self) -> None:
        """Update the heartbeat; `tick`, `wait` and `step` do so, too."""
        self.node.beat()

    def is_wanted(self, topic: str) -> bool:
        """Whether one of its topics has subscribers; others need not be computed."""
        subscriptions = self.node.subscriptions
        subscriptions.look()
        return bool(subscriptions.wanted & subscriptions.bits(topic))

    def status(self, text: str) -> None:
        """Publish a status message for operators."""
        self.node.events.status(text, self.name)

    def event(self, name: str, text: str = "", value: float = float("nan")) -> None:
        """Emit an event of this name, for programs."""
        self.node.events.emit(name, text, code=name, component=self.name, value=value)

    @property
    def error(self) -> str:
        """Its present problem, as shown by `trocar status`; empty if there is none."""
        return bytes(self.node.page.field("error")[()]).rstrip(b"\0").decode(errors="replace")

    @error.setter
    def error(self, text: str) -> None:
        if text and text != self.error:
            self.node.events.report(codes.USER_ERROR, text, self.name, has_remedy=REMEDY in text)
        self.node.page.field("error")[...] = shorten(text, 399)

    # input

    def subscribe(self, topic: str, *groups: str) -> Subscription:
        """Subscribe to INSTANCE/TOPIC; its records end a `wait`. SegmentError when there is none.

        Fields that are computed on demand (docs/topics.md) are NaN until their group is requested in `groups`.
        """
        instance, _, ring = topic.partition("/")
        if instance not in (known := directory.instances(self.system)):
            raise Unknown(none_such("process", instance, known))
        subscriber = self.node.hold(Subscriber(self.system, instance, self.name, every=True))
        subscriber.want(ring, *groups)
        found = Subscription(self.node.hold(directory.reader(self.system, instance, ring)), subscriber, topic)
        self._subscriptions.append(found)
        return found

    def unsubscribe(self, subscription: Subscription) -> None:
        """End a subscription."""
        self._subscriptions.remove(subscription)
        subscription.subscriber.drop(subscription.topic.partition("/")[2])

    def watch(self, file: int | Watchable, events: int = READ) -> None:
        """Let `wait` end when the file can be read (or as `events` says: READ | WRITE | EXCEPT)."""
        self._files.add(number := _number(file))
        self._poll.register(number, events)

    def unwatch(self, file: int | Watchable) -> None:
        """Stop watching a file; call this before the file is closed."""
        self._files.discard(number := _number(file))
        self._poll.unregister(number)

    def is_ready(self, file: int | Watchable) -> bool:
        """Whether a watched file is readable now, or another of its watched events is pending."""
        return _number(file) in dict(self._poll.poll(0))

    def process_messages(self, most: int = 64) -> int:
        """Execute waiting commands, at most `most`; returns their number. `tick` does so, too."""
        count, waiting = 0, None
        while count < most and self._mailbox.has_news:
            for request in self._mailbox.drain(0 if self.time.simulated else monotonic_ns()):
                count += 1
                if waiting is not None and waiting.name == request.name:
                    waiting.done("replaced by a newer one")
                elif waiting is not None:
                    self._carry_out(waiting)
                waiting = None
                if request.command.latest:
                    request.accept()  # if we die now, the next process finds it answered
                    waiting = request
                else:
                    self._carry_out(request)
                if count >= most:
                    break
        if waiting is not None:
            self._carry_out(waiting)
        return count

    def _carry_out(self, request: Received) -> None:
        if request.needs_operator and ACTING.origin is not None:
            ACTING.origin = request.origin  # commands that result from it have the same origin
        self.request, is_accepted = request, request.command.latest
        refuse = request.fail if is_accepted else request.refuse
        try:
            answer = self._answer(request)
        except (ValueError, NoStateFolder) as error:
            refuse(str(error))
        except Exception as error:
            self.log.exception("%s ended by an error", request.name)
            refuse(f"{type(error).__name__}: {error}")
        else:
            if answer is not self.LATER:
                request.done("" if answer is None else str(answer))
            elif not is_accepted:
                request.accept()
        finally:
            self.request = None

    def _answer(self, request: Received) -> object:
        if request.name == SET_PROPERTY:
            return self.property_changed(self.properties.ask(request.text, request.values))
        if request.name == SAVE_PROPERTIES:
            return self._save_properties()
        command = self._commands.get(request.name)
        if command is None:
            return self.carries_out(request)
        if why := request.command.objection(request.values):
            raise ValueError(f"{request.name}: {why}")
        return handler_of(self, self.name, command)(*arguments_of(command, request.values, request.text))

    def check_commands(self) -> None:
        """Raise ValueError if a declared command has no suitable handler."""
        for command in self.declared.commands:
            handler_of(self, self.name, command)

    def _nothing_else(self, request: Received) -> object:
        raise ValueError(f"{self.name} does not carry out {request.name}")

    def property_changed(self, name: str) -> str | None:
        """Called when a command has set a property; may return the answer."""

    def _save_properties(self) -> str:
        made_log_folder(os.environ, self.system)
        self.properties.save(self._saved)
        return str(self._saved)[-100:]

    # start and end

    def begin(self) -> None:
        """Call `setup`, and show the process as running."""
        self.setup()
        self.check_commands()
        self.node.ready(self.error)
        self.node.pauses.end()  # its program decides when the first period begins

    def step(self) -> None:
        """One period of a filter in a shared process: execute commands, then `update`, with the filter's own origin."""
        ACTING.origin = self._acting
        self.beat()
        self.node.pacing.called(self.time.now_ns())
        self.process_messages()
        self.update()
        self.node.pacing.end_of_work(self.time.now_ns())
        self._acting = ACTING.origin


class FunctionLoop(UserLoop):
    """A user's process that is a function `main` instead of a class."""

    function: Callable[[UserLoop], object]

    def check_commands(self) -> None:
        """See UserLoop; no check, because the function itself makes the handlers."""

    def main(self) -> None:
        """Call the function."""
        type(self).function(self)


def class_in(name: str) -> type[UserLoop]:
    """The subclass of Process in the module of this name, or one that runs its function `main`; ImportError if there is
    not just one.
    """
    module = module_named(name)
    classes = classes_in(module, UserLoop)
    if len(classes) == 1:
        return classes[0]
    if not classes and callable(main := getattr(module, "main", None)):
        return type("Function", (FunctionLoop,), {"function": main})
    raise ImportError(f"{module.__name__} has {len(classes)} subclasses of trocar.Process; there must be one, or a "
                      "function main(process)")


def _bare(node: Node) -> UserProcess:
    """A user's process without declarations; ValueError if the process is not a user's."""
    if not proc(node.kind).declared:
        raise ValueError(f"{node.name} is no process that the system file declares with a module")
    return UserProcess(node.name, "", node.row.period_s)


def _number(file: int | Watchable) -> int:
    return file if isinstance(file, int) else file.fileno()
