"""The witness: a process of its own that writes down every record of the boards until it is told to end.

    python -m tests.soak.recorder SYSTEM FILE

FILE gets the records as they are, each with the writer's epoch in front; FILE.json what they look like and how many
were lost. It ends on SIGTERM, after all that is there.
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from shm import directory
from shm.clock import pause
from tests.soak.motion import Truth

POLL_S = 0.01


def main() -> None:
    """Record."""
    system, path = sys.argv[1], Path(sys.argv[2])
    asked: list[int] = []

    def hear(number: int, frame: FrameType | None) -> None:
        asked.append(number)

    signal.signal(signal.SIGTERM, hear)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    reader = directory.reader(system, "boards", "state", "boards")
    described: dict[str, Any] = {"fields": [list(field) for field in reader.dtype.descr],
                                 "itemsize": reader.dtype.itemsize}
    with path.open("wb") as file:
        print("recording", flush=True)
        over = False
        while not over:
            over = bool(asked)  # what came before is still taken
            epoch = reader.epoch.to_bytes(8, "little")
            while reader.next():
                file.write(epoch + bytes(reader.record))
            pause(POLL_S)
    described["lost"] = reader.lost
    path.with_suffix(".json").write_text(json.dumps(described))


def read(path: Path) -> tuple[Truth, int]:
    """All records of a file, and how many were lost."""
    described = json.loads(path.with_suffix(".json").read_text())
    names, formats, offsets, at = ["epoch"], ["<u8"], [0], 8
    for name, kind, *shape in described["fields"]:
        form = np.dtype((kind, tuple(shape[0]))) if shape else np.dtype(kind)
        if name:  # else padding
            names.append(name)
            formats.append(form)  # type: ignore[arg-type]
            offsets.append(at)
        at += form.itemsize
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 8 + described["itemsize"]})
    return np.fromfile(path, dtype=dtype), int(described["lost"])


if __name__ == "__main__":
    main()
