"""`trocar export FILE`: a recording for other programs."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path
from typing import Annotated

import typer

from trocar.tools.analysis.choosing import (
    FromOption,
    Stretch,
    ToOption,
    TopicsOption,
    chosen_topics,
    no_records,
    opened,
    spans,
    stretch,
    tables_of,
)
from trocar.tools.analysis.exporting import CSV, PARQUET, ROSBAG2, STDOUT, RecordingTables, arrow
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import answer, note, progress
from trocar.tools.verbs.options import JsonOption

FORMATS = (CSV, PARQUET, ROSBAG2)


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording.")],
    to: Annotated[str, typer.Option(
        "--to-folder", "-o", metavar="FOLDER", help="New folder; -: one topic as CSV to standard output.")] = "",
    form: Annotated[str, typer.Option("--format", metavar="FORMAT", help="csv, parquet or rosbag2.")] = CSV,
    topics: TopicsOption = None,
    begin: FromOption = 0.0,
    end: ToOption = None,
    as_json: JsonOption = False,
) -> int:
    """Write a recording as CSV or Parquet, one file for each topic, or as a bag that rosbag2 and its tools open.

    In tables an array has a column for each element, named after its joint; topics without records are left out unless
    --topics names them. Parquet needs pyarrow.

    Example: trocar export monday.mcap --topics PSM1/state -o -
    """
    if form not in FORMATS:
        raise Misuse(f"--format {form}: allowed are {', '.join(FORMATS)}")
    if to == STDOUT and form != CSV:
        raise Misuse(f"-o -: only csv goes to the output, not {form}")
    with opened(file) as recording, progress(f"export {file.name}") as say:
        wanted = chosen_topics(recording.topics, topics) if form == ROSBAG2 else tables_of(recording, topics, form)
        part = stretch(recording, begin, end)
        if part != Stretch() and not spans(recording, wanted, part):
            raise no_records(recording, wanted)
        table = RecordingTables(recording, wanted, part, all_of_them=bool(topics))
        if to == STDOUT:
            if len(wanted) != 1:
                raise Misuse(f"-o - exports one topic; choose it with --topics: {', '.join(recording.record_topics)}")
            table.to_stdout(say)
            return _told(recording.problems)
        if form == PARQUET:
            arrow()  # before there is a folder
        folder = Path(to) if to else file.with_suffix("")
        try:
            folder.mkdir(parents=True)
            with contextlib.ExitStack() as undo:
                undo.callback(shutil.rmtree, folder, ignore_errors=True)  # half of it helps no further
                if form == ROSBAG2:
                    from trocar.tools.analysis.rosbag import to_rosbag2  # with YAML, which only a bag asks for

                    written = to_rosbag2(recording, folder, wanted, part, say)
                else:
                    written = table.to_parquet(folder, say) if form == PARQUET else table.to_csv(folder, say)
                if not written:
                    raise no_records(recording, wanted)
                undo.pop_all()
        except FileExistsError:
            raise Misuse(f"{folder} is there already; -o names a new folder") from None
        except OSError as error:
            raise Problem(f"{error.filename or folder}: {error.strerror}") from None
        code = _told(recording.problems)
    answer({"folder": str(folder), "files": [str(path) for path in written], "topics": wanted},
           f"{folder}: {', '.join(path.name for path in written)}", as_json)
    return code


def _told(problems: list[str]) -> int:
    """What was wrong with the recording; what could be read is written."""
    for text in problems:
        note(f"problem: {text}")
    return 1 if problems else 0
