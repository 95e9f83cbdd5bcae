"""`trocar compare A B`: what is different in two recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trocar.tools.analysis.choosing import FromOption, ToOption, TopicsOption, opened, stretch
from trocar.tools.analysis.comparing import DIFFERENT, EQUAL, Comparing, RecordingDifference, as_dict
from trocar.tools.analysis.differences import ALIGNMENTS, STAMP, FieldDifference, TopicDifference
from trocar.tools.analysis.figure import plot
from trocar.tools.analysis.tolerances import parsed
from trocar.tools.output.errors import Misuse
from trocar.tools.output.printing import emit, note, number, progress, table, tell
from trocar.tools.verbs.options import JsonOption

MAX_ROWS = 40


def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="First recording.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Second recording.")],
    topics: TopicsOption = None,
    tolerance: Annotated[list[str] | None, typer.Option(
        "--tolerance", metavar="[FIELD=]NUMBER[UNIT]", help="Tolerance, e.g. position=0.1deg or 0.1mm; repeatable."),
    ] = None,
    align: Annotated[str, typer.Option("--align", help="Records are paired by stamp, start or sequence.")] = STAMP,
    common: Annotated[bool, typer.Option("--common", help="Compare only the time that both have.")] = False,
    begin: FromOption = 0.0,
    end: ToOption = None,
    picture: Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="Plot the differences.")] = None,
    as_json: JsonOption = False,
) -> int:
    """Compare two recordings by topic and field: the largest difference, RMS, the first difference.

    "equal" means bit for bit (NaN equals NaN), except for fields that contain real time; these are listed. Exit
    code 0: equal, or within the tolerances; 1: different.

    Example: trocar compare monday.mcap tuesday.mcap --align start --tolerance position=0.1deg
    """
    if align not in ALIGNMENTS:
        raise Misuse(f"--align {align}: allowed are {', '.join(ALIGNMENTS)}")
    how = Comparing(align, topics, tuple(parsed(text) for text in tolerance or ()), common)
    with opened(a) as one, opened(b) as other, progress(f"compare {a.name} and {b.name}") as say:
        found = how.of(one, other, (stretch(one, begin, end), stretch(other, begin, end)), say)
        drawn = plot(str(picture), one, other, found.topics, align) if picture is not None else []
    if as_json:
        emit(as_dict(found))
    else:
        show(found)
    if picture is not None:
        note(f"{picture}: {', '.join(drawn) or 'no number differs'}")
    return 1 if found.outcome == DIFFERENT else 0


def show(found: RecordingDifference) -> None:
    """For eyes."""
    for text in found.problems:
        note(f"problem: {text}")
    for text in found.left_out:
        tell(f"not compared: {text}")
    rows = [(f"{topic.name}.{field.name}", *_cells(field)) for topic in found.topics for field in topic.fields]
    if rows:
        columns = ("field", "records", "beyond", "largest", "RMS", "unit", "first at s", "A", "B")
        table("", columns, rows[:MAX_ROWS], ("records", "beyond", "largest", "RMS", "first at s"))
        if len(rows) > MAX_ROWS:
            tell(f"… and {len(rows) - MAX_ROWS} more fields: --topics, --json")
    for topic in found.topics:
        for text in _missing(topic):
            tell(f"{topic.name}: {text}")
    for names, where in ((found.only_a, "A"), (found.only_b, "B")):
        if names:
            tell(f"only {where} has {', '.join(names)}")
    compared = found.compared
    if found.outcome == EQUAL:
        tell(f"equal: {compared} records of {len(found.topics)} topics, bit for bit")
    elif not found.topics:
        tell("different: they have no topic in common")
    elif not compared:
        tell("different: nothing was compared, since no record of one pairs with one of the other")
    else:
        bad = [topic.name for topic in found.topics if not topic.is_within]
        same = sum(topic.is_equal for topic in found.topics)
        tell(f"{'different' if found.outcome == DIFFERENT else 'within the tolerances'}: {compared} records compared, "
              f"{same} of {len(found.topics)} topics equal" + (f"; different: {', '.join(bad)}" if bad else ""))


def _cells(field: FieldDifference) -> tuple[str, ...]:
    first = field.first
    element = "" if first["element"] is None else f"[{first['element']}] "
    return (str(field.count), str(field.beyond), number(field.most, ".3g"), number(field.rms, ".3g"), field.unit,
            f"{first['stamp_ns'] * 1e-9:.6f}", f"{element}{first['a']}", str(first["b"]))


def _missing(topic: TopicDifference) -> list[str]:
    alone = ((topic.only_a, "A", topic.first_only_a_ns), (topic.only_b, "B", topic.first_only_b_ns))
    said = [f"{count} records are only in {where}, the first at {(at or 0) * 1e-9:.6f} s"
            for count, where, at in alone if count]
    return said + ([f"other layouts: {', '.join(topic.unknown)}"] if topic.unknown else [])
