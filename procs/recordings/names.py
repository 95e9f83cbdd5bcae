"""Names in our recordings: of metadata, attachments, channels and files."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Final

FORMAT: Final = "1"
SYSTEM: Final = "trocar"
"""Metadata: `format`, the recording (`kind`, `name`, `reason`), its system, versions, and machine."""
BOX, NAMED, FAULT, DUMP = "box", "named", "fault", "dump"
KINDS: Final = (BOX, NAMED, FAULT, DUMP)
DIED: Final = "died"
"""File name of DUMPs made after the death of a system; only the newest of these are kept."""
WORDS: Final = (*KINDS, DIED)
"""First words of file names that Trocar assigns itself."""
TIME: Final = r"\d{8}-\d{6}\.\d{3}"
"""Regular expression of the time of day in file names."""
CODE: Final = "code"
"""Key in SYSTEM for faults: the code of the error that caused it."""
FIRST: Final = "first"
"""Key in SYSTEM for faults: not empty if the system was well before."""
LOSSES: Final = "losses"
"""Metadata: the numbers of missing records by topic, and of dropped messages."""
DOCUMENT: Final = "document.json.gz"
"""Attachment: the frozen configuration."""
CLOCK: Final = "recorder/state"
"""The topic with the time by all three clocks, once a second: `system_ns`, `monotonic_ns`, `local_ns`."""

# metadata of a channel
INSTANCE, RING, KIND = "instance", "ring", "kind"
SCHEMA: Final = "schema"
"""The ring's schema as JSON, only for channels of records; `fingerprint` is its hash, `epoch` that of its writer."""
FINGERPRINT, EPOCH, INFO = "fingerprint", "epoch", "info"
TOPIC: Final = "topic"
"""Trocar's name of the topic; the channel has a name that ROS allows."""
UNSUITABLE: Final = str.maketrans(" -.()[]", "_" * 7)


def utc(ns: int) -> str:
    """A time of day for a file's name, in sortable form: 20260131-235959.123."""
    return f"{datetime.fromtimestamp(ns // 1_000_000_000, UTC):%Y%m%d-%H%M%S}.{ns // 1_000_000 % 1000:03d}"


def time_in(name: str) -> int:
    """The time of day in a file's name, ns: of its begin, or of the fault; 0 if there is none."""
    found = re.search(TIME, name)
    if found is None:
        return 0
    try:
        return round(datetime.strptime(f"{found[0]}+0000", "%Y%m%d-%H%M%S.%f%z").timestamp() * 1e3) * 1_000_000
    except ValueError:  # e.g. month 99: a user's file
        return 0


def channel_name(topic: str) -> str:
    """The name of a topic in a form that ROS allows: /PSM1/measured_js."""
    return "/" + topic.translate(UNSUITABLE)
