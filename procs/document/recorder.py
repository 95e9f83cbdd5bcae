"""The recorder as the document has it, and its properties, with which what the document says can be changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trocar.procs.document.user_process import Property, UserProcess

NAME: Final = "recorder"
COMPRESSIONS: Final = ("zstd", "lz4", "none")
MAX_RATE_HZ: Final = 50.0


@dataclass(frozen=True, slots=True)
class Recorder:
    """What the black box keeps; `folder`: where; empty: with the system's logs."""

    folder: str = ""
    rate_hz: float = 50.0
    minutes: float = 10.0
    size_mb: float = 500.0
    compression: str = "zstd"
    faults: int = 10

    @property
    def declared(self) -> UserProcess:
        """Its properties, as processes of users' own declare theirs."""
        return UserProcess(NAME, "", 1.0 / MAX_RATE_HZ, properties=(
            Property("rate_hz", "float", self.rate_hz, 1.0, MAX_RATE_HZ, "Hz", "records of the black box in a second"),
            Property("minutes", "float", self.minutes, 0.1, 1440.0, "min", "how far back the black box goes"),
            Property("size_mb", "float", self.size_mb, 1.0, 1e6, "MB", "all files of the black box together"),
            Property("faults", "int", self.faults, 1, 1000, "", "recordings of faults that are kept"),
            Property("compression", "text[8]", text=" or ".join(COMPRESSIONS), words=self.compression)))
