"""The recorder in the document, and its properties, which can change these settings at run time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal, get_args

from trocar.procs.document.keys import Key, keys_in
from trocar.procs.document.user_process import Property, UserProcess

NAME: Final = "recorder"
Compression = Literal["zstd", "lz4", "none"]
COMPRESSIONS: Final = get_args(Compression)
MAX_RATE_HZ: Final = 50.0


@dataclass(frozen=True, slots=True)
class Recorder:
    """Settings of the recorder and its black box; `folder`: of the recordings; empty: with the system's logs."""

    folder: Annotated[str, Key(max_length=200, text="a folder with one for each system, or none")] = ""
    rate_hz: Annotated[float, Key(1.0, MAX_RATE_HZ, "Hz")] = 50.0
    minutes: Annotated[float, Key(0.1, 1440.0, "min that the black box goes back")] = 10.0
    size_mb: Annotated[float, Key(1.0, 1e6, "MB of the black box's files together")] = 500.0
    compression: Annotated[Compression, Key()] = "zstd"
    faults: Annotated[int, Key(1, 1000, "recordings of faults that are kept")] = 10

    @property
    def declared(self) -> UserProcess:
        """Its properties, declared like those of users' processes."""
        of = {field.name: (key.low, key.high) for field, _, key in keys_in(Recorder)}
        return UserProcess(NAME, "", 1.0 / MAX_RATE_HZ, properties=(
            Property("rate_hz", "float", self.rate_hz, *of["rate_hz"], "Hz", "records of the black box in a second"),
            Property("minutes", "float", self.minutes, *of["minutes"], "min", "how far back the black box goes"),
            Property("size_mb", "float", self.size_mb, *of["size_mb"], "MB", "all files of the black box together"),
            Property("faults", "int", self.faults, *of["faults"], "", "recordings of faults that are kept"),
            Property("compression", "text[8]", text=" or ".join(COMPRESSIONS), words=self.compression)))
