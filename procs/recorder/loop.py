"""The recorder: a black box of the last minutes, recordings on request, and recordings of faults.

It only reads rings, so no writer is affected; the disk has a thread of its own; messages that cannot be written are
dropped and counted. If it dies or hangs, the robot is not affected. docs/recordings.md.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from trocar.procs.document.recorder import COMPRESSIONS, Recorder
from trocar.procs.machine.paths import made_recordings_folder
from trocar.procs.node import runtime
from trocar.procs.node.requests import has_left
from trocar.procs.recorder.box import BlackBox, BoxLimits
from trocar.procs.recorder.disk import Disk, DiskFile, no_room_made
from trocar.procs.recorder.fault import FaultRecording
from trocar.procs.recorder.files import NAME, path_of
from trocar.procs.recorder.keeping import ASKED, FaultKeeper
from trocar.procs.recorder.named import NamedRecording, chosen
from trocar.procs.recorder.sources import LocalTimes, SystemSources
from trocar.procs.recorder.watch import FaultWatch, SeenFault
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import COMPRESSIONS as METHODS
from trocar.procs.recordings.facts import document_of, facts_of
from trocar.procs.recordings.writing import ChannelTable
from trocar.procs.tables import codes
from trocar.procs.user.process import UserLoop
from trocar.shm.mailbox.received import Received
from trocar.shm.memory.layout import cut_text, shorten

TOLD_NS: Final = 60_000_000_000
"""Minimum interval between warnings of the same kind."""
SHOWN_NS: Final = 1_000_000_000
SOON_NS: Final = 200_000_000
"""Interval of its record during a recording on request; otherwise SHOWN_NS."""
KEEP_S: Final = 1.0
END_S: Final = 2.0
MAX_CHOSEN: Final = 200


class RecorderLoop(UserLoop):
    """The recorder's process, see above."""

    def setup(self) -> None:
        """Open all rings; the disk is not checked before the first write."""
        self._named: NamedRecording | None = None
        self._asked: list[Received] = []
        self._client: tuple[Received, int] | None = None
        """The client whose end also ends the recording: its command, and its process id."""
        self._chosen: dict[tuple[int, int], list[str]] = {}
        self._problem, self._fault_path, self._named_path = "", "", ""
        self._fault_span_ns, self._missing = (0, 0), ""
        self._shown_ns = self._told_ns = self._dropped = self._dropped_before = 0
        document = self.node.document
        row = document.recorder or Recorder()
        self._folder = made_recordings_folder(os.environ, self.system, row.folder)
        self._times, self._table, self._disk = LocalTimes(self.time), ChannelTable(), Disk()
        self._document = document_of(self.system)
        self._sources = SystemSources(self.system, self._table, self.name)
        self._watch = FaultWatch(self._sources)
        self._box = BlackBox(self._folder, self._disk, self._sources, self._times, BoxLimits(1.0, 1.0, 1.0, ""),
                             self._begin_file)
        self._keeper = FaultKeeper(self._folder, self._disk, self._sources, self._times, self._box, self._begin_fault,
                                   self._tell_fault)
        self.property_changed("")
        self.carries_out = self._carry_out_own
        for problem in self._sources.problems:
            self.log.warning("not recorded: %s", problem)
        self.log.info("records into %s", self._folder)

    def update(self) -> None:
        """Do the work of a period."""
        times = self._times
        times.look()
        self._box.step()
        for fault in self._watch.look():
            with suppress(ValueError):  # the queue is full: the next file will include this fault
                self._keeper.saw(fault)
        if self._named is not None:
            self._go_on_with_named(self._named)
        self._keeper.step(self._compression, int(self.properties["faults"]))
        if times.monotonic_ns - self._shown_ns >= (SOON_NS if self._named is not None else SHOWN_NS):
            self._show()

    # the properties

    def property_changed(self, name: str) -> str | None:
        """Apply the properties, from the next record on."""
        values = self.properties
        if name == "compression" and values[name] not in COMPRESSIONS:
            wrong, values[name] = values[name], COMPRESSIONS[0]
            raise ValueError(f"no compression {wrong}; allowed are {', '.join(COMPRESSIONS)}")
        self._compression = METHODS.get(values["compression"], METHODS[COMPRESSIONS[0]])
        self._box.limits = BoxLimits(values["rate_hz"], values["minutes"], values["size_mb"], self._compression)
        return None

    # the commands

    def _carry_out_own(self, request: Received) -> object:
        if request.name == "choose":
            self._choose((request.place, request.pid), request.text)
            return None
        if request.name == "record":
            return self._record(request)
        if request.name == "stop":
            return self._stop_named(request)
        if request.name == "keep":
            self._keeper.saw(SeenFault(ASKED, request.text or "on request"), request)
            return self.LATER
        return self._nothing_else(request)

    def _choose(self, who: tuple[int, int], topic: str) -> None:
        """Choose a topic for the next recording of this client, given by its mailbox place and process id."""
        self._chosen = {key: topics for key, topics in self._chosen.items() if key[0] != who[0] or key == who}
        entries = self._chosen.pop(who, [])  # a refusal discards all choices
        chosen(self._sources, [topic])
        if len(entries) >= MAX_CHOSEN:
            raise ValueError(f"{MAX_CHOSEN} topics at most can be chosen; choose none to record all")
        self._chosen[who] = [*entries, topic]

    def _record(self, request: Received) -> object:
        topics = self._chosen.pop((request.place, request.pid), [])
        seconds = float(request.values[0]) if len(request.values) else 0.0
        is_tied = len(request.values) > 1 and bool(request.values[1])
        if self._named is not None:
            raise ValueError(f"{self._named.name} is being recorded; trocar record --stop {self._named.name} ends it")
        if not NAME.fullmatch(request.text) or request.text.split("-")[0] in names.WORDS:
            raise ValueError(f"{request.text[:60]!r} is no name; allowed are up to 60 letters, digits, . _ and -, but "
                             f"not {'-…, '.join(names.WORDS)}-…: these name other files")
        if not 0.0 <= seconds <= 86400.0:
            raise ValueError(f"for {seconds:g} s; allowed are 0 (until it is stopped) to 86400")
        entries = chosen(self._sources, topics)
        path = path_of(self._folder, names.NAMED, self._times.local_ns, request.text)
        file = self._begin_file(path, names.NAMED, request.text)
        self._named = NamedRecording(request.text, self._sources, entries, file, self._times, seconds,
                                     self._compression)
        self._asked, self._named_path = [request], str(path)
        self._client = (request, request.pid) if is_tied else None
        self._show()
        return self.LATER

    def _stop_named(self, request: Received) -> object:
        name, named = request.text, self._named
        if named is None or named.is_ending or (name and name != named.name):
            raise ValueError(f"{name or 'nothing'} is not being recorded"
                             + (f"; {named.name} is" if named is not None else ""))
        self._asked.append(request)
        named.end()
        return self.LATER

    def _go_on_with_named(self, named: NamedRecording) -> None:
        if not named.is_ending:
            named.step()
            if named.is_over or (self._client is not None and has_left(*self._client)):
                named.end()
        elif named.is_written:
            self._tell_end(named)

    def _tell_end(self, named: NamedRecording) -> None:
        """Answer the commands that started and stopped it, and report its end."""
        said = (f"{named.passed_s:.1f} s of the system's time, {named.file.messages} messages, {named.lost} lost: "
                f"{named.file.path}")
        asked, self._asked, self._named = self._asked, [], None
        self._show(named)  # before the answers, so that clients can read the result
        for request in asked:
            request.done(said)
        self.node.events.status(f"recording {named.name} has ended: {said}", self.name)

    # files and errors

    def _begin_file(self, path: Path, kind: str, name: str = "", reason: str = "",
                    make_room: Callable[[], bool] = no_room_made, **more: str) -> DiskFile:
        return DiskFile(self._disk, path, self._table, facts_of(self.system, kind, name, reason, **more),
                        self._document, self._times.local_ns, make_room=make_room)

    def _begin_fault(self, fault: FaultRecording) -> DiskFile:
        """Begin a file for a fault, which may remove the oldest files of the black box to make room."""
        fault.faults = [self._watch.explained(each) for each in fault.faults]
        who = fault.faults[0].instance
        path = path_of(self._folder, names.FAULT, self._times.local_ns, who)
        return self._begin_file(path, names.FAULT, who, fault.reason, self._box.remove_oldest,
                                **{names.CODE: fault.code, names.FIRST: "yes" if fault.is_first else ""})

    def _tell_fault(self, fault: FaultRecording) -> None:
        file, who = fault.file, fault.faults[0].instance
        if file is None:
            return
        why = file.problem or "the disk is too slow"
        is_fault = bool(fault.span_ns[1])  # otherwise a request, which is answered
        is_kept = file.is_ended and file.size > 0
        if file.is_complete:
            self._missing = ""
        elif is_fault:
            said = "the recording of the last fault is not complete" if is_kept else "the last fault was not recorded"
            self._missing = f"{said}: {why}"
        if not is_kept:
            self.node.events.report(codes.RECORDING_DROPPED, f"{fault.reason}: could not be kept: {why}", who,
                                   value=float(file.dropped))
        else:
            if is_fault:
                self._fault_path, self._fault_span_ns = str(file.path), fault.span_ns
            missing = "" if file.is_complete else f", not all of it: {why}"
            self.node.events.report(codes.FAULT_RECORDED, f"{fault.reason}: kept in {file.path}{missing}", who)
        self._show()

    def _show(self, ended: NamedRecording | None = None) -> None:
        """Publish the record `state`: recordings, time by all clocks, and losses."""
        times, box, named = self._times, self._box, self._named or ended
        self._shown_ns = times.monotonic_ns
        dropped = box.all_dropped + self._keeper.dropped
        if self._problem != self._disk.problem or dropped > self._dropped:
            self._tell(dropped)
        self._show_loss(dropped > self._dropped_before)
        self._dropped_before = dropped
        values = {"system_ns": times.system_ns, "monotonic_ns": times.monotonic_ns, "local_ns": times.local_ns,
                  "box_bytes": box.size, "box_messages": box.written, "dropped": dropped,
                  "waiting_bytes": self._disk.waiting, "problem": cut_text(self._problem, 200),
                  "fault_path": cut_text(self._fault_path, 300), "path": cut_text(self._named_path, 300),
                  "fault_first_ns": self._fault_span_ns[0], "fault_last_ns": self._fault_span_ns[1]}
        values |= {"name": "" if named is None or named is ended else named.name}
        if named is not None:
            values |= {"passed_s": named.passed_s, "bytes": named.file.size, "messages": named.file.messages,
                       "lost": named.lost}
        self.publish("state", **values)

    def _show_loss(self, loses: bool) -> None:
        """Show missing recordings as the error of this process until all is recorded again."""
        text = f"not all is recorded: {self._sources.problems[0]}" if self._sources.problems else ""
        if self._missing:
            text = self._missing
        if loses or self._disk.problem:
            why = self._disk.problem or "the disk is too slow"
            text = f"nothing is recorded into {self._folder} at present: {why}"
        self.node.page.field("error")[...] = shorten(text, 399)

    def _tell(self, dropped: int) -> None:
        """Report losses in words, at most once per TOLD_NS."""
        if self._times.monotonic_ns - self._told_ns < TOLD_NS and self._told_ns:
            return
        problem, before = self._disk.problem, self._problem
        lost, self._dropped, self._problem = dropped - self._dropped, dropped, problem
        if problem or (lost and not before):
            self._told_ns = self._times.monotonic_ns
            why = problem or "the disk is too slow"
            self.node.events.report(codes.RECORDING_DROPPED, f"{lost} messages were not recorded into {self._folder}: "
                                   f"{why}", self.name, value=float(lost))
        elif before:
            self.node.events.status(f"recording has resumed; {lost} messages before that are missing", self.name)

    def quit(self) -> None:
        """End all files properly, if the disk is fast enough."""
        if not hasattr(self, "_keeper"):
            return
        self._times.look()
        if self._named is not None and not self._named.is_ending:
            self._named.end()
        self._keeper.end(self._compression, int(self.properties["faults"]), KEEP_S)
        self._box.close()
        if not self._disk.close(END_S):
            self.log.warning("the disk was too slow: the last messages are not recorded")
        self._keeper.close()
        if self._named is not None:
            self._tell_end(self._named)
        self._watch.close()
        self._sources.close()


def main() -> None:
    """Run the recorder."""
    runtime.run("recorder", RecorderLoop)


if __name__ == "__main__":
    main()
