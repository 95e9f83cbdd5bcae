"""The witness: a process of its own that writes down every record of the boards until it is told to end.

    python -m tests.soak.recorder SYSTEM FILE [INSTANCE.TOPIC:KIND:FIELD,FIELD ...]

FILE gets the records of the boards as they are, each with the writer's epoch in front; FILE.json what they look like
and how many were lost. Beside it, in INSTANCE-TOPIC.FILE, are these fields of other records. It ends on SIGTERM, after
all that is there.
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from tests.soak.motion import Truth
from trocar.shm.system import directory
from trocar.shm.time.clock import pause

POLL_S = 0.01


class RingWitness:
    """One ring, and the file that its records go to; `fields`: only these of them."""

    def __init__(self, system: str, name: str, kind: str, path: Path, fields: tuple[str, ...] = ()) -> None:
        """`name`: instance.topic."""
        instance, topic = name.split(".")
        self._reader, self._path = directory.reader(system, instance, topic, kind), path
        dtype = self._reader.dtype
        assert dtype.fields is not None
        places = [dtype.fields[name] for name in ("sequence", "stamp_ns", *fields)] if fields else []
        self._parts = [slice(at, at + form.itemsize) for form, at, *_ in places] or [slice(None)]
        self._described: dict[str, Any] = {"fields": [list(field) for field in dtype.descr], "itemsize": dtype.itemsize}
        if fields:
            rows = [[name, form.base.str, list(form.shape)] for name, (form, *_) in
                    zip(("sequence", "stamp_ns", *fields), places, strict=True)]
            self._described = {"fields": rows, "itemsize": sum(form.itemsize for form, *_ in places)}
        self._file = path.open("wb")

    def take(self) -> None:
        """All that is there."""
        epoch = self._reader.epoch.to_bytes(8, "little")
        while self._reader.next():
            record = bytes(self._reader.record)
            self._file.write(epoch + b"".join([record[part] for part in self._parts]))

    def close(self) -> None:
        """Say what was written."""
        self._file.close()
        described = {**self._described, "lost": self._reader.lost, "info": self._reader.info}
        self._path.with_suffix(".json").write_text(json.dumps(described))


def beside(path: Path, name: str) -> Path:
    """The file of another record than the boards'."""
    return path.with_name(f"{name.replace('.', '-')}.{path.name}")


def main() -> None:
    """Record."""
    system, path = sys.argv[1], Path(sys.argv[2])
    asked: list[int] = []

    def hear(number: int, frame: FrameType | None) -> None:
        asked.append(number)

    signal.signal(signal.SIGTERM, hear)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    witnesses = [RingWitness(system, "boards.state", "boards", path)]
    for name, kind, fields in (words.split(":") for words in sys.argv[3:]):
        witnesses.append(RingWitness(system, name, kind, beside(path, name), tuple(fields.split(","))))
    print("recording", flush=True)
    over = False
    while not over:
        over = bool(asked)  # what came before is still taken
        for witness in witnesses:
            witness.take()
        pause(POLL_S)
    for witness in witnesses:
        witness.close()


def read(path: Path) -> tuple[Truth, int]:
    """All records of a file, and how many were lost."""
    described = json.loads(path.with_suffix(".json").read_text())
    names, formats, offsets, at = ["epoch"], ["<u8"], [0], 8
    for name, kind, *shape in described["fields"]:
        form = np.dtype((kind, tuple(shape[0]))) if shape and shape[0] else np.dtype(kind)
        if name:  # else padding
            names.append(name)
            formats.append(form)  # type: ignore[arg-type]
            offsets.append(at)
        at += form.itemsize
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 8 + described["itemsize"]})
    return np.fromfile(path, dtype=dtype), int(described["lost"])


def info(path: Path) -> dict[str, Any]:
    """What the writer of a file's records says about them: names of robots, outputs and so on."""
    found: dict[str, Any] = json.loads(path.with_suffix(".json").read_text())["info"]
    return found


if __name__ == "__main__":
    main()
