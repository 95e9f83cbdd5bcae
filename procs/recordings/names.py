"""What stands where in our recordings: the names of metadata, attachments and channels."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Final

FORMAT: Final = "1"
SYSTEM: Final = "trocar"
"""Metadata: `format`, what the recording is (`kind`, `name`, `reason`), of which system, by which versions, where."""
BOX, NAMED, FAULT, DUMP = "box", "named", "fault", "dump"
KINDS: Final = (BOX, NAMED, FAULT, DUMP)
DIED: Final = "died"
"""Files of kind DUMP that were made of a dead system are called so: of these only the newest stay."""
WORDS: Final = (*KINDS, DIED)
"""With these begin names of files that Trocar names by itself."""
TIME: Final = r"\d{8}-\d{6}\.\d{3}"
"""How a time of day looks in them (a regular expression)."""
CODE: Final = "code"
"""More of a fault, in SYSTEM: the code of the error that led to it."""
FIRST: Final = "first"
"""The same: not empty: all was well before it."""
LOSSES: Final = "losses"
"""Metadata: how many records of each topic are missing, and how many messages were dropped."""
DOCUMENT: Final = "document.json.gz"
"""Attachment: the frozen configuration."""
CLOCK: Final = "recorder/state"
"""The topic that says what time it was, once a second, by all three clocks: `system_ns`, `monotonic_ns`, `local_ns`."""

# metadata of a channel
INSTANCE, RING, KIND = "instance", "ring", "kind"
SCHEMA: Final = "schema"
"""The ring's own schema as JSON, which only channels of records have; `fingerprint` is its hash, `epoch` its writer."""
FINGERPRINT, EPOCH, INFO = "fingerprint", "epoch", "info"
TOPIC: Final = "topic"
"""The name as Trocar knows it; that of the channel is how ROS allows it."""
UNSUITABLE: Final = str.maketrans(" -.()[]", "_" * 7)


def utc(ns: int) -> str:
    """A time of day for a file's name, so that names are in order: 20260131-235959.123."""
    return f"{datetime.fromtimestamp(ns // 1_000_000_000, UTC):%Y%m%d-%H%M%S}.{ns // 1_000_000 % 1000:03d}"


def time_in(name: str) -> int:
    """The time of day in a file's name, ns: when it was begun, of a fault when that was; 0: there is none."""
    found = re.search(TIME, name)
    if found is None:
        return 0
    try:
        return round(datetime.strptime(f"{found[0]}+0000", "%Y%m%d-%H%M%S.%f%z").timestamp() * 1e3) * 1_000_000
    except ValueError:  # the 99th month: somebody's own name
        return 0


def channel_name(topic: str) -> str:
    """A topic as ROS allows it: /PSM1/measured_js."""
    return "/" + topic.translate(UNSUITABLE)
