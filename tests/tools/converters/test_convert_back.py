"""Old files that say the same as today's: a site's own IO files written out as XML, and files broken at random."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.old import config, joint, matrix, only, pid, three
from tests.tools.converters.test_convert_console import ARM, EMBEDDED, KEYBOARD, TELEOPS
from tests.tools.converters.test_convert_rob import FULL
from trocar.tools.converters import convert_file, to_json

SITE = "dvrk-site"
ROBOTS = (
    "jhu-dVRK/sawRobotIO1394-PSM1-28007.json",
    "jhu-dVRK/sawRobotIO1394-MTML-22723.json",
    "jhu-daVinci/sawRobotIO1394-ECM-29738.json",
    "jhu-daVinci/sawRobotIO1394-SUJ.json",
    "jhu-daVinci-Si/sawRobotIO1394-PSM1-292409.json",
    "jhu-daVinci-Si/sawRobotIO1394-ECM-438610.json",
)


class Writer:
    """IO JSON as XML of version 4 (degrees, mm) or 5 (SI)."""

    def __init__(self, version: int) -> None:
        self.old = version < 5
        self.version = version

    def text(self, data: dict[str, Any]) -> bytes:
        parts = [self.robot(robot) for robot in data.get("robots") or []]
        for row in data.get("digital_inputs") or []:
            trigger = {(True, True): "all", (True, False): "press", (False, True): "release", (False, False): "none"}
            edges = trigger[row["trigger_when_pressed"], row["trigger_when_released"]]
            pressed = int(row["pressed_value"])
            parts.append(f'<DigitalIn {self.place(row, "Bit")} Name="{row["name"]}" Pressed="{pressed}" '
                         f'Trigger="{edges}" Debounce="{row["debounce_time"]!r}" DebounceClick="0"/>')
        for row in data.get("digital_outputs") or []:
            times = {"HighDuration": "high_duration", "LowDuration": "low_duration", "Frequency": "PWM_frequency"}
            reported = " ".join(f'{name}="{row[key]!r}"' for name, key in times.items() if key in row)
            parts.append(f'<DigitalOut {self.place(row, "Bit")} Name="{row["name"]}" {reported}/>')
        for row in data.get("dallas_chips") or []:
            parts.append(f'<DallasChip Board{self.id}="{row["board_id"]}" Name="{row["name"]}"/>')
        return config("\n".join(parts), self.version)

    @property
    def id(self) -> str:
        return "ID" if self.old else "Id"

    def place(self, row: dict[str, Any], second: str) -> str:
        return f'Board{self.id}="{row["board_id"]}" {second}{self.id}="{row[f"{second.lower()}_id"]}"'

    def robot(self, row: dict[str, Any]) -> str:
        brakes = list(row.get("brakes") or [])
        actuators = []
        for actuator in row["actuators"]:
            brake = self.brake(brakes.pop(0)) if brakes else ""
            actuators.append(self.actuator(actuator, brake))
        types = [actuator.get("joint_type", "REVOLUTE") for actuator in row["actuators"]]
        serial = "SN" if self.old else "SerialNumber"
        kind = ' Type="io-only"' if row.get("only_IO") else ""
        return (f'<Robot Name="{row["name"]}" {serial}="{row["serial_number"]}" '
                f'HardwareVersion="{row["hardware_version"]}" '
                f'NumOfActuator="{row["number_of_actuators"]}"{kind}>{"".join(actuators)}'
                f'{self.potentiometers(row["potentiometers"], types)}</Robot>')

    def actuator(self, row: dict[str, Any], brake: str) -> str:
        kind = row.get("joint_type", "REVOLUTE")
        word = f'Type="{kind.capitalize()}"' if self.old else f'JointType="{kind}"'
        inside = f'<Drive>{self.drive(row["drive"])}</Drive>'
        if row.get("encoder"):
            encoder = row["encoder"]
            limits = encoder["position_limits_soft"]
            soft = self.measure(kind, Lower=limits["lower"], Upper=limits["upper"])
            inside += (f'<Encoder VelocitySource="{encoder["velocity_source"]}">'
                       f'<BitsToPosSI {self.measure(kind, Scale=encoder["bits_to_position"]["scale"])}/>'
                       f'<PositionLimitsSoft {soft}/></Encoder>')
        if row.get("potentiometer"):
            pot = row["potentiometer"]
            position = pot.get("voltage_to_position")
            inside += f'<AnalogIn>{linear("BitsToVolts", pot["bits_to_voltage"])}'
            if position:
                numbers = {"Scale": position["scale"], "Offset": position["offset"]}
                inside += f"<VoltsToPosSI {self.measure(kind, **numbers)}/>"
            inside += "</AnalogIn>"
        return f'<Actuator {self.place(row, "Axis")} {word}>{inside}{brake}</Actuator>'

    def measure(self, kind: str, **numbers: float) -> str:
        turns = kind == "REVOLUTE"
        unit = {(True, True): "deg", (True, False): "mm", (False, True): "rad", (False, False): "m"}[self.old, turns]
        factor = (180 / math.pi if turns else 1000.0) if self.old else 1.0
        return " ".join(f'{name}="{value * factor!r}"' for name, value in numbers.items()) + f' Unit="{unit}"'

    def drive(self, row: dict[str, Any]) -> str:
        effort = row.get("effort_to_current")
        tag = "NmToAmps" if self.old else "EffortToCurrent"
        return (f'{linear("AmpsToBits", row["current_to_bits"])}{linear("BitsToFeedbackAmps", row["bits_to_current"])}'
                f'<MaxCurrent Value="{row["maximum_current"]!r}" Unit="A"/>'
                + (f'<{tag} Scale="{effort["scale"]!r}"/>' if effort else ""))

    def brake(self, row: dict[str, Any]) -> str:
        names = {"ReleaseCurrent": "release_current", "ReleaseTime": "release_time",
                 "ReleasedCurrent": "released_current", "EngagedCurrent": "engaged_current"}
        values = "".join(f'<{tag} Value="{row[key]!r}"/>' for tag, key in names.items())
        drive = dict(row["drive"], effort_to_current=None)
        return f'<AnalogBrake {self.place(row, "Axis")}>{self.drive(drive)}{values}</AnalogBrake>'

    def potentiometers(self, row: dict[str, Any], types: list[str]) -> str:
        inside = "".join(
            f'<Tolerance Axis="{number}" {self.measure(kind, Distance=tolerance["distance"])} '
            f'Latency="{tolerance["latency"]!r}"/>'
            for number, (tolerance, kind) in enumerate(zip(row.get("tolerances") or [], types, strict=False)))
        rows = (row.get("coupling") or {}).get("JointToActuatorPosition")
        inside += matrix("JointToActuatorPosition", rows) if rows else ""
        table = row.get("lookup_table_file")
        return f'<Potentiometers{f" LookupTable={chr(34)}{table}{chr(34)}" if table else ""}>{inside}</Potentiometers>'


def linear(tag: str, row: dict[str, float]) -> str:
    return f'<{tag} Scale="{row["scale"]!r}" Offset="{row.get("offset", 0.0)!r}"/>'


def same(found: Any, wanted: Any, where: str = "") -> None:
    """Every key of `wanted` is in `found`, numbers to 1e-12; what counts as absent may be."""
    if isinstance(wanted, dict):
        for key, value in wanted.items():
            if value not in (None, [], {}, "") and key not in ("brake", "actuator_id", "brake_id"):
                assert key in found, f"{where}.{key}"
                same(found[key], value, f"{where}.{key}")
    elif isinstance(wanted, list):
        assert len(found) == len(wanted), where
        for number, (a, b) in enumerate(zip(found, wanted, strict=True)):
            same(a, b, f"{where}[{number}]")
    elif isinstance(wanted, float):
        assert found == pytest.approx(wanted, rel=1e-12, abs=1e-15), where
    else:
        assert found == wanted, where


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("version", [4, 5])
def test_a_site_s_files_survive_the_old_formats(data: Callable[[str], Path], name: str, version: int) -> None:
    wanted = json.loads(data(f"{SITE}/{name}").read_text())
    same(only(Writer(version).text(wanted)), wanted)


SAMPLES = (
    config(three(inside='<Potentiometers Position="Joints"><Tolerance Axis="0" Distance="5" Latency="0" Unit="deg"/>'
                        '</Potentiometers><Coupling Value="1"/>')),
    pid(joint(0) + joint(1, kind="Prismatic"), 2),
    FULL.encode(),
    json.dumps({"arms": [EMBEDDED], "io": {"footpedals": "a.xml"}, "console-inputs": KEYBOARD, **TELEOPS}).encode(),
    json.dumps(ARM).encode(),
)
PIECES = (
    b"", b"1e999", b"-", b"9" * 5000, b"\xff", b"<", b">", b'"', b"null", b"[]", b"{}", b"true", "²".encode(), b"\n",
)


@pytest.mark.parametrize("sample", SAMPLES, ids=["io", "pid", "rob", "console", "arm"])
def test_whatever_is_broken_is_told_and_never_raises(sample: bytes) -> None:
    chance = random.Random(7)
    for _ in range(200):
        start = chance.randrange(len(sample))
        end = min(len(sample), start + chance.choice((0, 1, 3, 12, 60)))
        broken = sample[:start] + chance.choice(PIECES) + sample[end:]
        result = convert_file("old", broken)
        assert bool(result.problems) != bool(result.outputs)
        for output in result.outputs:
            json.loads(to_json(output.data))
