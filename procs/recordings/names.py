"""What stands where in our recordings: the names of metadata, attachments and channels."""

from __future__ import annotations

from typing import Final

FORMAT: Final = "1"
SYSTEM: Final = "trocar"
"""Metadata: `format`, what the recording is (`kind`, `name`, `reason`), of which system, by which versions, where."""
BOX, NAMED, FAULT, DUMP = "box", "named", "fault", "dump"
KINDS: Final = (BOX, NAMED, FAULT, DUMP)
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


def channel_name(topic: str) -> str:
    """A topic as ROS allows it: /PSM1/measured_js."""
    return "/" + topic.translate(UNSUITABLE)
