"""A recording as a bag of ROS 2: a folder with the recording and the `metadata.yaml` that rosbag2 requires.

The recording is already such a bag's file (MCAP, profile ros2); it is copied, or rewritten for a part.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader

from trocar.procs.recordings.chunks import ZSTD, Chunk, packed
from trocar.procs.recordings.reading import RecordingReader
from trocar.procs.recordings.writing import ChannelTable, RecordingFile
from trocar.tools.analysis.choosing import END_NS, Stretch
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say

VERSION: Final = 5  # which every ROS 2 since Humble reads
CHUNK_BYTES: Final = 1 << 20


def to_rosbag2(recording: RecordingReader, folder: Path, topics: Sequence[str], part: Stretch, say: Say) -> list[Path]:
    """Write the bag into `folder`; Problem if the recording cannot be read."""
    file = folder / f"{folder.name}.mcap"
    try:
        if set(topics) == set(recording.topics) and part == Stretch() and recording.is_whole:
            shutil.copyfile(recording.path, file)
        else:
            _part_of(recording, file, topics, part, say)
        about = folder / "metadata.yaml"
        about.write_text(yaml.safe_dump(_metadata(file), sort_keys=False), encoding="utf-8")
    except McapError as error:
        raise Problem(f"{recording.path}: {error}") from None
    return [file, about]


def _part_of(recording: RecordingReader, file: Path, topics: Sequence[str], part: Stretch, say: Say) -> None:
    """A recording with these topics and this stretch of stamps; metadata and configuration are kept."""
    table, chunk = ChannelTable(), Chunk()
    with file.open("wb", buffering=0) as stream:
        made = RecordingFile(stream, table, recording.metadata, recording.attachments())
        for done, name in enumerate(topics):
            say(name, done / len(topics))
            known: dict[int, int] = {}
            for number, sequence, log_ns, publish_ns, data in recording.raw(name):
                if not part.begin_ns <= publish_ns < part.end_ns:
                    continue
                if number not in known:
                    known[number] = table.channel(name, *recording.channel(number))
                chunk.add(known[number], sequence, log_ns, publish_ns, data)
                if len(chunk.data) >= CHUNK_BYTES:
                    made.put(packed(chunk, ZSTD))
                    chunk = Chunk()
        if chunk.count:
            made.put(packed(chunk, ZSTD))
        made.finish()


def _metadata(file: Path) -> dict[str, Any]:
    """Metadata of a bag for rosbag2."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None:
        raise Problem(f"{file}: has no summary")
    found, begin_ns = summary.statistics, min(summary.statistics.message_start_time, END_NS)
    begin, duration = {"nanoseconds_since_epoch": begin_ns}, {"nanoseconds": found.message_end_time - begin_ns}
    counts: dict[str, dict[str, Any]] = {}
    for number, channel in summary.channels.items():
        row = counts.setdefault(channel.topic, {
            "topic_metadata": {"name": channel.topic, "type": summary.schemas[channel.schema_id].name,
                               "serialization_format": "cdr", "offered_qos_profiles": ""}, "message_count": 0})
        row["message_count"] += found.channel_message_counts.get(number, 0)
    return {"rosbag2_bagfile_information": {
        "version": VERSION, "storage_identifier": "mcap", "duration": duration, "starting_time": begin,
        "message_count": found.message_count, "topics_with_message_count": list(counts.values()),
        "compression_format": "", "compression_mode": "", "relative_file_paths": [file.name],
        "files": [{"path": file.name, "starting_time": begin, "duration": duration,
                   "message_count": found.message_count}]}}
