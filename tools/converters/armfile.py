"""Arm files from before dVRK 2.4 (no `$id`, keys with dashes) to today's."""

from __future__ import annotations

import math
import re
from pathlib import PurePosixPath

from trocar.procs.config import HEADS, OWN_KEYS, arm_kind
from trocar.procs.config.models.arm_file import ArmFile, EcmFile, MtmFile, PsmFile
from trocar.procs.config.read.jsontext import Parsed
from trocar.procs.kinematics.endoscopes import NAMES
from trocar.tools.converters.keys import Keys
from trocar.tools.converters.report import ConversionReport, Json

_CHAINS = {
    "psm": "PSM", "psm-si": "PSM_Si", "psm-si-physical": "PSM_Si_physical",
    "ecm": "ECM", "ecm-si": "ECM_Si", "mtml": "MTML", "mtmr": "MTMR",
}
_MODELS: dict[str, type[ArmFile]] = {"ecm": EcmFile, "psm": PsmFile, "mtm": MtmFile}
_MODEL = re.compile(r"_(\d{6})\Z")
_VERSION = re.compile(r"\[(\d+)\]\Z")
_PITCH = {"Classic": -math.pi / 4, "Si": math.radians(-70.0)}  # on the setup joints


def looks_like_arm(data: dict[str, object]) -> bool:
    """Whether an object is an arm file of old: it names its kinematics and has no `$id`."""
    return isinstance(data.get("kinematic"), str) and not {"$id", "DH", "arms"} & set(data)


def convert_arm(parsed: Parsed, file: str, report: ConversionReport) -> Json:
    """The new arm file; `file` is the old one's name. Not usable if the report has problems."""
    keys = Keys(parsed.data, parsed.lines, report)
    old = keys.text("kinematic")
    stem = PurePosixPath(old).stem.lower()
    kind = _kind(keys, stem, file)
    row: Json = {**HEADS[kind], "kinematic": _kinematic(keys, old, stem, file)}
    generation = keys.text("generation")
    if not generation:
        generation = "Si" if "-si" in stem else "Classic"
        keys.defaulted("generation", generation, "by the name of the kinematic file")
    row["generation"] = generation
    row |= keys.read(_MODELS[kind], skip=("tool", "endoscope"))
    row |= _tool(keys) | (_endoscope(keys, generation, row) if kind == "ecm" else {})
    keys.finish()
    return row


def _kind(keys: Keys, stem: str, file: str) -> str:
    kind = arm_kind([name for names in OWN_KEYS.values() for name in names if keys.has(name)], stem, file)
    if kind:
        return kind
    allowed = ", ".join(name for names in OWN_KEYS.values() for name in names)
    keys.report.error(keys.line(), "", "", "nothing says which kind of arm this is", f"one of {allowed}")
    return "psm"


def _kinematic(keys: Keys, old: str, stem: str, file: str) -> str:
    if stem == "mtm":
        stem = "mtmr" if "mtmr" in file.lower() else "mtml"
    new = _CHAINS.get(stem, "")
    if not new:
        return old
    new = f"kinematic/{new}.json"
    if new != old:
        keys.converted("kinematic", old, new, "today's name of the stock chain")
    return new


def _tool(keys: Keys) -> Json:
    old = keys.text("tool")
    if not old:
        return {}
    new = _MODEL.sub(r":\1", _VERSION.sub(r":\1", old))
    new = re.sub(r"\A5MM_NEEDLE", "NEEDLE", new)
    if new != old:
        keys.converted("tool", old, new, "today: NAME:MODEL or NAME:MODEL:VERSION")
    return {"tool": new}


def _endoscope(keys: Keys, generation: str, row: Json) -> Json:
    old = keys.text("endoscope")
    new = f"{generation}_{old or 'SD_STRAIGHT'}"
    if old in NAMES or new not in NAMES:  # already a present name; or unknown, which the check of the new file reports
        new = old
    if not old:
        keys.defaulted("endoscope", new, "the file does not say: check it")
    elif new != old:
        keys.converted("endoscope", old, new, "today's name")
    added: Json = {"endoscope": new}
    if "mounting_pitch" not in row:
        pitch = round(_PITCH.get(generation, 0.0), 6)
        keys.defaulted("mounting_pitch", f"{pitch} rad", "as on setup joints: check it")
        added["mounting_pitch"] = pitch
    return added
