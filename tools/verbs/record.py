"""`trocar record NAME [TOPICS…]`: a recording, whose progress is shown until it has ended."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from typing import Annotated, Any, Final

import typer

from trocar.procs.document.recorder import NAME as RECORDER
from trocar.procs.machine.end_signals import ended_as_by_ctrl_c
from trocar.shm.commands import ENDINGS
from trocar.shm.mailbox.client import MailboxFull
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Misuse, Problem, Refused
from trocar.tools.output.printing import Say, answer, emit, note, number, plain, progress
from trocar.tools.systems.find import chosen_system
from trocar.tools.verbs.options import JsonOption, SystemOption

POLL_S: Final = 0.05
LINE_NS: Final = 1_000_000_000
SILENT_NS: Final = 3_000_000_000
END_S: Final = 20.0
SHOWN: Final = ("name", "path", "passed_s", "bytes", "messages", "lost", "problem")


@ended_as_by_ctrl_c()
def record(
    name: Annotated[str, typer.Argument(
        metavar="[NAME]", help="Name of the recording. Its file is NAME-TIME.mcap.")] = "",
    topics: Annotated[list[str] | None, typer.Argument(
        metavar="[TOPICS]...",
        help="Topics, or processes with all their topics. Default: all arms, io and consoles.")] = None,
    seconds: Annotated[float, typer.Option(
        "--for", min=0.0, max=86400.0, help="Seconds to record, in the system's time; 0: until Ctrl-C.")] = 0.0,
    stop: Annotated[bool, typer.Option("--stop", help="End the running recording of this name.")] = False,
    detach: Annotated[bool, typer.Option(
        "--detach", help="Return when the recording has begun. --stop ends the recording.")] = False,
    keep: Annotated[bool, typer.Option(
        "--keep", help="Make the recorder save its last minutes, as after a fault; NAME is stored as reason.")] = False,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Record topics to a file, with every event and command. Ctrl-C ends the recording.

    If this program ends, e.g. because its terminal is closed, the recording also ends. With --detach, it continues
    until --stop, or until the time of --for has passed. docs/recordings.md describes the files. Exit code 1: records
    are missing.

    Example: trocar record grasp PSM1 IO1/state --for 2
    """
    chosen, is_new = chosen_system(system), not (stop or keep)
    if not is_new and (topics or seconds or detach or (stop and keep)):
        raise Misuse("--stop and --keep take a name at most, and nothing else")
    if is_new and not name:
        raise Misuse("it takes a name: trocar record NAME")
    with ExitStack() as stack:
        remote = stack.enter_context(_recorder(chosen))
        state = stack.enter_context(closing(directory.reader(chosen, RECORDER, "state", often=False)))
        remote.wait_until_it_runs()
        if not is_new:
            text = _settled(remote, "stop" if stop else "keep", name)
            return _ended(text, _seen(state), as_json) if stop else _kept(text, as_json)
        for topic in topics or ():
            remote.ask("choose", text=topic)
        number = remote.send("record", [seconds, float(not detach)], name)
        with _stopped_where_it_fails(remote, name):
            _begun(remote, number)
            if detach:
                found = _seen(state)
                answer(found, f"recording {name} into {found['path']}; trocar record {name} --stop", as_json)
                return 0
            recorder = RecorderWatch(state, stack.enter_context(SystemTime(chosen)))
            with progress(f"recording {name}") as say:
                said = _watch(remote, number, state, name, seconds, as_json, say, recorder)
        return _ended(said, _seen(state), as_json)


def _recorder(system: str) -> Remote:
    try:
        return Remote(system, RECORDER)
    except SegmentError as error:
        raise Problem(f"{error}; {system} has no recorder (trocar.recorder.on)") from None


def _settled(remote: Remote, command: str, name: str) -> str:
    """The answer to a command that has ended; Refused if it was not carried out."""
    reply = remote.settled(command, text=name, timeout=END_S)
    if reply.outcome != "done":
        raise Refused(reply.text)
    return reply.text


@contextmanager
def _stopped_where_it_fails(remote: Remote, name: str) -> Iterator[None]:
    """Nothing goes on recording when we end early: interrupted, or since nobody reads what we say."""
    try:
        yield
    except Refused:  # there is nothing of ours to be stopped
        raise
    except BaseException:
        with suppress(SegmentError, MailboxFull):
            remote.send("stop", text=name)
        raise


def _begun(remote: Remote, number: int) -> None:
    end = monotonic_ns() + round(END_S * 1e9)
    while monotonic_ns() < end:
        for reply in remote.replies_to(number):
            if reply.outcome != "accepted":
                raise Refused(reply.text)
            return
        pause(POLL_S)
    raise Problem("the recorder did not answer; is it running? (trocar status)")


class RecorderWatch:
    """The recorder that records: another one, or one that shows nothing any more, will not tell us the end."""

    def __init__(self, state: RingReader, time: SystemTime) -> None:
        """From now on."""
        self._state, self._time, self._epoch = state, time, state.epoch
        self._head, self._real_ns, self._system_ns = -1, 0, 0

    def problem(self) -> str:
        """What is wrong with it, in words; empty: nothing. Where simulated time stands still nobody shows anything."""
        if self._state.epoch != self._epoch:
            return "the recorder died, and was started again"
        real_ns, system_ns = monotonic_ns(), self._time.now_ns()
        if self._state.head != self._head:
            self._head, self._real_ns, self._system_ns = self._state.head, real_ns, system_ns
        silent_ns = min(real_ns - self._real_ns, system_ns - self._system_ns)
        return "" if silent_ns <= SILENT_NS else (f"the recorder has shown nothing for {SILENT_NS * 1e-9:.0f} s: "
                                                  f"{self._state.gone or 'it hangs'}")


def _watch(remote: Remote, number: int, state: RingReader, name: str, seconds: float, as_json: bool, say: Say,
           recorder: RecorderWatch) -> str:
    """Until it has ended, by itself or by Ctrl-C; what the recorder said then. Problem where it never will."""
    line_ns, stop, path = monotonic_ns() + LINE_NS, 0, ""
    while True:
        try:
            found = _seen(state)
            path = found.get("path") or path
            replies = [*remote.replies_to(number), *(remote.replies_to(stop) if stop else ())]
            said: list[str] = [reply.text for reply in replies if reply.outcome == "done"]
            if said:
                return said[0]
            if problem := next((reply.text for reply in replies if reply.outcome in ENDINGS), recorder.problem()):
                raise Problem(f"{problem}; the recording up to then is in {path}")
            if found.get("name") == name:
                say(_in_words(found), min(1.0, found["passed_s"] / seconds) if seconds else None)
                if as_json and monotonic_ns() >= line_ns:
                    line_ns = monotonic_ns() + LINE_NS
                    emit(found)
            pause(POLL_S)
        except KeyboardInterrupt:
            if stop:
                raise
            stop = remote.send("stop", text=name)


def _seen(state: RingReader) -> dict[str, Any]:
    """What the recorder shows."""
    if not state.newest():
        return {}
    return {key: plain(state.field(key)[()]) for key in SHOWN}


def _in_words(found: dict[str, Any]) -> str:
    return (f"{number(found['passed_s'], '.0f')} s of the system's time, {found['bytes'] / 1e6:.1f} MB, "
            f"{found['messages']} messages, {found['lost']} lost")


def _ended(said: str, found: dict[str, Any], as_json: bool) -> int:
    """The last word; 1 where something is missing."""
    answer(found, said, as_json)
    if found.get("problem"):
        note(f"the disk: {found['problem']}")
    return int(bool(found.get("lost")))


def _kept(said: str, as_json: bool) -> int:
    path = said.removeprefix("kept in ")
    answer({"path": path}, f"kept in {path}", as_json)
    return 0
