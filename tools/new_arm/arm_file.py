"""Arm and system file of a new arm: text with comments, because a person edits them."""

from __future__ import annotations

from math import radians

from trocar.tools.new_arm.arm_numbers import CLASSIC, SI
from trocar.tools.new_arm.io_file import NewArm

DETECTION = '''    , "tool_detection": "AUTOMATIC"
    // , "tool_detection": "MANUAL"
    // , "tool_detection": "FIXED"
'''
ENDOSCOPE = '''    , "endoscope": "{generation}_HD_STRAIGHT" // or UP or DOWN
    // , "endoscope": "Classic_SD_STRAIGHT" // or UP or DOWN
'''
GRAVITY = '''    // , "gravity_compensation": "{file}" // once it is there; without it, default masses
'''


def arm_file(arm: NewArm) -> str:
    """The arm file."""
    kind, numbers = arm.numbers.type, arm.numbers
    text = f'''{{
    "$id": "dvrk-{kind.lower()}.schema.json",
    "$version": "1",
    "kinematic": "kinematic/{numbers.kinematic}.json",
    "generation": "{arm.generation}"
'''
    text += {"PSM": DETECTION, "ECM": ENDOSCOPE.format(generation=arm.generation),
             "MTM": GRAVITY.format(file=f"gc-{arm.name}-{arm.serial}.json")}[kind]
    if numbers.mounting_pitch:
        degrees = numbers.mounting_pitch
        text += f'    , "mounting_pitch": {radians(degrees):.5f} // {degrees:g}° on its setup arm\n'
    return text + "}\n"


def system_file(arm: NewArm) -> str:
    """A system of this arm alone."""
    return f'''{{
    "$id": "dvrk-system.schema.json",
    "$version": "1",
    "IOs": [
        {{
            "name": "IO1",
            "port": "{arm.port}" // fw, udpfw or udp
        }}
    ],
    "arms": [
        {{
            "name": "{arm.name}",
            "type": "{arm.numbers.type}",
            "serial": "{arm.serial}",
            "IO": "IO1"
        }}
    ]
}}
'''


def uncalibrated(arm: NewArm) -> list[str]:
    """The values that calibration has to replace, one line each."""
    found = []
    if arm.generation == CLASSIC:
        motors = "motors and brakes" if arm.numbers.brakes else "motors"
        found.append(f"current offsets of the {motors} are nominal: trocar commission, stage currents, measures them; "
                     "until then the arm starts in calibration mode only")
        found.append("potentiometers have the manufacturer's values: trocar commission, stage calibrate, refines them")
    if arm.generation == SI:
        found.append("the table of the potentiometers is missing: trocar commission, stage tables, makes it; until "
                     "then the arm starts in calibration mode only")
    if arm.numbers.type == "MTM":
        found.append("the gripper has scale and offset 0: trocar commission, stage calibrate, measures both")
        found.append("gravity compensation has default masses: trocar commission, stage gravity, measures it")
    if arm.generation == CLASSIC and arm.numbers.type == "PSM":
        found.append("the insertion offset is the manufacturer's: trocar commission, stage depth, measures it")
    return found
