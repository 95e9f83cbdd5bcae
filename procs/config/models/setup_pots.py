"""Potentiometers of the setup arm under an Si arm, since 2026 in one file an arm."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from trocar.procs.config.read.sections import Rows, SafetySection, VersionAsText


class PotLineKeys(SafetySection):
    """Position of a joint, m or rad: offset + scale · count of the 12-bit converter; absent until calibrated."""

    scale: float | None = None
    offset: float | None = None


class SiPotsFile(SafetySection):
    """The potentiometers of one setup arm, joint by joint; `arm_name` and `serial_number` are those of the Si arm."""

    # a development state of sawRobotIO1394 looks for the second one
    id: Literal["saw-robot-io-suj-si.schema.json", "saw-robot-io-SUJ-Si.schema.json"] = Field(alias="$id")
    version: Annotated[Literal["1"], VersionAsText] = Field(alias="$version")
    arm_name: str = Field(min_length=1)
    serial_number: str = ""
    primary_measured_js: Rows[PotLineKeys] = ()
    secondary_measured_js: Rows[PotLineKeys] = ()
