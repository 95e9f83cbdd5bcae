"""What was said and asked for while a recording was made, as `trocar logs` shows it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trocar.shm.system.events import STATUS
from trocar.tools.analysis.choosing import opened
from trocar.tools.inspect.messages import asked_line, line
from trocar.tools.output.printing import note


@dataclass(frozen=True, slots=True)
class SaidLine:
    """One message or command, as data and in words."""

    row: dict[str, Any]
    text: str


def recorded_lines(file: Path, instance: str | None, most: int, commands: bool) -> list[SaidLine]:
    """The newest messages, or commands with what became of them, of all processes or one, oldest first.

    What the process `system` repeats of others is left out.
    """
    with opened(file) as recording:
        rows = recording.commands() if commands else recording.events()
        for problem in recording.problems:
            note(f"{file}: {problem}")
        kinds = {topic.instance: topic.kind for topic in recording.topics.values() if topic.kind}
    found = []
    for row in rows:
        name = row["instance"]
        if instance not in (None, name):
            continue
        data = {"process": name, **{key: value for key, value in row.items() if key not in ("instance", "sequence")}}
        if "values" in data:
            data["values"] = data["values"][: data.pop("count")]
        if commands:
            found.append(SaidLine(data, asked_line(data)))
        elif int(row["severity"]) >= STATUS and (kinds.get(name) != "system" or instance is not None):
            found.append(SaidLine(data, f"{name}  {line(data)}"))
    return found[-most:] if most else []
