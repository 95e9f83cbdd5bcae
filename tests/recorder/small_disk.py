"""A recorder whose folder is on a disk that others fill, and make room on again: `python -m tests.recorder.small_disk`.

Run in a mount namespace of its own, with FOLDER a small file system. Prints what the recorder showed and said.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.tools.robot import ScriptedRobot
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.recorder import box, loop
from trocar.procs.recorder.watch import SeenFault
from trocar.procs.recordings.reading import open_recording
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.remote import Remote

PATIENCE_NS = 60_000_000_000


class SmallDiskRecorder:
    """The recorder, stepped by us, and what it shows."""

    def __init__(self, system: str, folder: Path) -> None:
        self.robot, self.folder = ScriptedRobot(system, folder), folder
        self.loop = loop.RecorderLoop(Node(document_of(system), "recorder"))
        self.loop.begin()
        self.state = directory.reader(system, "recorder", "state")
        self.events = directory.reader(system, "recorder", "events")

    def until(self, met: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Goes on until what it shows is so."""
        end = monotonic_ns() + PATIENCE_NS
        while monotonic_ns() < end:
            self.robot.show_arm(0.5, "ENABLED", homed=True)
            self.loop.step()
            pause(0.002)
            if self.state.newest():
                shown = {name: self.state.field(name).item() for name in ("dropped", "box_messages", "messages")}
                shown["problem"] = self.state.field("problem").item().decode()
                shown["error"] = self.loop.error
                if met(shown):
                    return shown
        raise TimeoutError("it did not come to that")

    def fill(self) -> Path:
        """A file of somebody else's that takes all there is."""
        filler = self.folder / "filler"
        with filler.open("wb", buffering=0) as stream:
            try:
                while True:
                    stream.write(bytes(os.statvfs(self.folder).f_bsize))
            except OSError:
                return filler

    def said(self, text: str, since: int = 0) -> bool:
        """Whether it has told this, in another than the first so many events."""
        return any(text in bytes(row["text"]).decode() for row in self.events.last(200)[since:])

    def fault(self) -> str:
        """The file that is shown after one; it is waited until something is said of it."""
        before = len(self.events.last(200))
        self.loop._keeper.saw(SeenFault("PSM1", "PSM1 is in FAULT", monotonic_ns()))
        self.until(lambda shown: self.said("PSM1 is in FAULT:", before))
        self.state.newest()
        path: str = self.state.field("fault_path").item().decode()
        return path

    def close(self) -> None:
        """End all."""
        self.state.close()
        self.events.close()
        self.loop.quit()
        self.loop.node.close()
        self.robot.close()


def main(system: str, folder: Path) -> dict[str, Any]:
    """Full, and room again, with a recording that somebody asked for meanwhile."""
    box.CHUNK_NS, loop.SHOWN_NS, loop.TOLD_NS = 50_000_000, 50_000_000, 100_000_000  # type: ignore[misc]
    recorder = SmallDiskRecorder(system, folder)
    try:
        before = recorder.until(lambda shown: shown["box_messages"] > 50)
        filler = recorder.fill()
        full = recorder.until(lambda shown: shown["dropped"] > 20 and shown["problem"])
        with Remote(system, "recorder") as remote:
            number = remote.send("record", [0.0], "grasp")
            recorder.until(lambda shown: bool(remote.replies_to(number)))
        recorder.until(lambda shown: shown["messages"] > 0 or recorder.said("No space left"))
        not_kept = recorder.fault(), recorder.said("PSM1 is in FAULT: could not be kept: No space left on device")
        filler.unlink()
        again = recorder.until(lambda shown: not shown["problem"] and recorder.said("recording has resumed"))
        later = recorder.until(lambda shown: shown["box_messages"] > again["box_messages"] + 100)
        told = recorder.said("messages were not recorded into")
        kept = recorder.fault()
    finally:
        recorder.close()
    rows = {}
    for path in (folder / system).glob("*.mcap"):
        with open_recording(path) as recording:
            rows[path.name.partition("-")[0]] = (recording.is_whole, recording.problems,
                                                 len(recording.records("PSM1/state").rows))
    return {"before": before, "full": full, "again": again, "later": later, "told": told, "files": rows,
            "not_kept": not_kept, "kept": kept}


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], Path(sys.argv[2]))))
