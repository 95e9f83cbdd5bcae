"""PID files (`saw-controllers-pid.schema.json`, version "1"): gains of every actuator of one robot."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.procs.config.read.validate import Rows, SafetySection, Section, VersionAsText, keys_of
from trocar.procs.document.gains import PidAxis


@keys_of(PidAxis)
class PidKeys(SafetySection):
    """The gains of one actuator; N·m/rad, N·m·s/rad or N/m, N·s/m."""

    index: int = Field(ge=0, le=15)
    name: str = Field(min_length=1)
    type: Literal["REVOLUTE", "PRISMATIC"]


class PidFile(Section):
    """The whole file."""

    id: Literal["saw-controllers-pid.schema.json"] = Field(alias="$id")
    version: Annotated[Literal["1"], VersionAsText] = Field(alias="$version")
    pid: Rows[PidKeys] = Field(min_length=1)
