"""Files of setup joints (SUJ) from before dVRK 2.4: today's values, keys with dashes."""

from __future__ import annotations

from trocar.procs.config.read.jsontext import Parsed
from trocar.procs.config.read.problem import KeyPath, key_text, value_text
from trocar.tools.converters.report import ConversionReport, Json

_OLD = {"plug-number", "serial-number", "brake-release-current", "primary-offsets", "simulated-position", "measured-cp",
        "world-origin-to-suj", "suj-tip-to-tool-origin"}
_TODAY = {"world_origin_to_suj": "world_origin_to_SUJ", "suj_tip_to_tool_origin": "SUJ_tip_to_tool_origin"}


def looks_like_setup(data: Json) -> bool:
    """Whether an object is a file of setup joints of old, by the keys of its arms."""
    arms = data.get("arms")
    rows = [row for row in arms if isinstance(row, dict)] if isinstance(arms, list) else []
    return any(_OLD & set(row) for row in rows)


def convert_setup(parsed: Parsed, report: ConversionReport) -> Json:
    """The same values under the names of today."""
    renamed = _renamed(parsed.data, (), parsed, report)
    return renamed if isinstance(renamed, dict) else {}


def _renamed(value: object, key: KeyPath, parsed: Parsed, report: ConversionReport) -> object:
    if isinstance(value, list):
        return [_renamed(item, (*key, number), parsed, report) for number, item in enumerate(value)]
    if not isinstance(value, dict):
        return value
    row: Json = {}
    for name, item in value.items():
        here = (*key, name)
        dashed = name.replace("-", "_")
        new = _TODAY.get(dashed, dashed)
        if new != name and new in value:
            report.dropped(parsed.lines.get(here, 0), key_text(here), value_text(item), f"{new} is there, too")
            continue
        if new != name:
            report.converted(parsed.lines.get(here, 0), key_text(here), "", new, "today's name")
        row[new] = _renamed(item, here, parsed, report)
    return row
