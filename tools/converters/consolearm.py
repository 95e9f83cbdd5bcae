"""Arms of old console files, and the arm files they need if the console itself named a kinematic chain."""

from __future__ import annotations

import math
import re
from pathlib import PurePosixPath

from trocar.procs.config import HEADS
from trocar.procs.config.models.system_file import ArmKeys
from trocar.tools.converters.keys import Keys
from trocar.tools.converters.names import plain
from trocar.tools.converters.report import Json
from trocar.tools.converters.teleops import interface

_TYPES = {"SUJ": "SUJ_Classic"}
_DRIVEN = re.compile(r"(MTM|PSM|ECM)(_DERIVED)?\Z|SUJ_Classic\Z|FOCUS_CONTROLLER\Z")
_JOINTED = re.compile(r"(MTM|PSM|ECM)(_DERIVED)?\Z")
_STOCK_PID = re.compile(r"sawControllersPID-(PSM|PSM-Si|MTM|MTML|MTMR|ECM|ECM-Si)\.(xml|json)\Z")
_LEFT_RIGHT = re.compile(r"MTM[LR]")  # today both have the same gains
_SERIAL = re.compile(r"-(\d{4,6})(?=[-_.]|\Z)")
_TOOLS = {
    "psm-large-needle-driver": "LARGE_NEEDLE_DRIVER:400006",
    "psm-pro-grasp": "PROGRASP_FORCEPS:400093",
    "psm-5mm-needle-driver": "NEEDLE_DRIVER:400117",
}
_CHAINS = {  # kinematic files shipped with the first versions
    "PSM": {"dvpsm", "psm", "psm-large-needle-driver-tip", *_TOOLS},
    "ECM": {"dvecm", "ecm", "ecm-straight"},
    "MTM": {"dvmtm", "mtm", "mtml", "mtmr", "mtm-deprecated", "mtml-deprecated", "mtmr-deprecated"},
}
_NO_SOCKETS = "there are no socket arms in today's files"
_PITCH_ON_CART = -math.pi / 4


class Arms:
    """The rows `arms` of a system file, and the arm files made for them, by their names."""

    def __init__(self, arms: list[Keys], bus: str, system_name: str) -> None:
        """`bus` is the name of the bus of all real arms; `system_name` goes into the names of new arm files."""
        self._bus = bus
        self._system = system_name
        self.files: dict[str, Json] = {}
        self.use_bus = False
        self.rows = [row for row in (self._arm(keys) for keys in arms) if row]

    def _arm(self, keys: Keys) -> Json:
        name, kind = keys.text("name"), keys.text("type")
        for what, value in (("name", name), ("type", kind)):
            if not value:
                keys.report.error(keys.line(), keys.key(what), "", "this key is required", "a text")
        if kind == "PSM_SOCKET":
            keys.report.lost(keys.line("type"), keys.key("type"), kind, f"{_NO_SOCKETS}: the arm is left out")
            for key in ("remote-ip", "port", "serial", "arm", "kinematic", "io", "pid"):
                keys.drop(key, "of an arm that is left out")
            return {}
        if kind in _TYPES:
            keys.converted("type", kind, _TYPES[kind], "today's name")
        kind = _TYPES.get(kind, kind)
        row: Json = {"name": name, "type": kind}
        simulated = _simulation(keys, row)
        files = _files(keys)
        real = bool(_DRIVEN.match(kind)) and not simulated
        serial = _serial(keys, files, real)
        row |= {"IO": self._bus} if real else {}
        row |= {"serial": serial} if serial else {}
        self.use_bus |= real
        row |= files
        arm_file = self._arm_file(keys, name, kind, serial)
        row |= {"arm_file": arm_file} if arm_file else {}
        _frame(keys, row)
        _component(keys, row)
        _lose(keys)
        return row | keys.read(ArmKeys, skip_ROS_bridge="skip-ros-bridge")

    def _arm_file(self, keys: Keys, name: str, kind: str, serial: str) -> str:
        """The arm file: the one that is named, or a new one where a kinematic chain is named in its place."""
        file = keys.text("arm")
        if file:
            keys.drop("kinematic", "there is an arm file, too")
            keys.lose("gravity-compensation", "belongs into the arm file, as gravity_compensation")
            return keys.followed("arm", file)
        chain = keys.text("kinematic")
        stem = PurePosixPath(chain).stem.lower()
        family = kind.split("_")[0]
        own = PurePosixPath(chain).suffix == ".rob" or stem in _CHAINS.get(family, ())
        if not chain or not own or not _JOINTED.match(kind):
            keys.lose("gravity-compensation", "belongs into the arm file, as gravity_compensation")
            return keys.followed("kinematic", chain) if chain else ""
        new = f"{plain(f'{name}-{serial or self._system}')}.json"
        keys.converted("kinematic", chain, new, "the console named the chain itself: an arm file is made for it")
        self.files[new] = _ARM_FILES[family](keys, name, stem)
        if stem not in _CHAINS[family]:
            reason = "not a stock chain: convert it, and name it in the arm file"
            keys.report.lost(keys.line("kinematic"), keys.key("kinematic"), chain, reason)
        return new


def _simulation(keys: Keys, row: Json) -> bool:
    simulation = keys.text("simulation")
    if simulation == "DYNAMIC":
        keys.report.lost(keys.line("simulation"), keys.key("simulation"), simulation, "today: NONE or KINEMATIC")
    elif simulation:
        row["simulation"] = simulation
    return simulation == "KINEMATIC"


def _files(keys: Keys) -> Json:
    row: Json = {}
    for old, new in (("io", "IO_file"), ("io-gripper", "IO_gripper_file"), ("pid", "PID_file")):
        name = keys.text(old)
        if old == "pid" and _STOCK_PID.match(PurePosixPath(name).name):
            reason = "the stock gains of today, for actuators, are used"
            keys.report.dropped(keys.line(old), keys.key(old), name, reason)
            keys.refer(old, name, f"pid/{_LEFT_RIGHT.sub('MTM', PurePosixPath(name).stem)}.json")
        elif name:
            row[new] = keys.followed(old, name)
    return row


def _serial(keys: Keys, files: Json, real: bool) -> str:
    serial = keys.text("serial")
    found = _SERIAL.search(str(files.get("IO_file", "")))
    if serial or not real or found is None:
        return serial
    keys.defaulted("serial", found.group(1), "from the name of the IO file")
    return found.group(1)


def _frame(keys: Keys, row: Json) -> None:
    frame = keys.inside("base-frame")
    if frame is None:
        return
    if frame.has("transform"):
        row["base_frame"] = {"reference_frame": frame.text("reference-frame"), "transform": frame.take("transform")}
    else:
        row["base_frame"] = {"component": frame.text("component"), "interface": interface(frame)}


def _component(keys: Keys, row: Json) -> None:
    """Component and interface; default for a third-party arm: its name and `Arm`."""
    foreign = str(row["type"]).endswith(("_GENERIC", "_DERIVED"))
    for key, default in (("component", str(row["name"])), ("interface", "Arm")):
        if keys.has(key):
            row[key] = interface(keys) if key == "interface" else keys.text(key)
        elif foreign:
            row[key] = default
            keys.defaulted(key, default, "as in the original software")


def _lose(keys: Keys) -> None:
    keys.lose("system", "a folder to look for the arm's files in: write it into settings.path")
    for name in ("socket-server", "remote-ip", "port"):
        keys.lose(name, _NO_SOCKETS)
    for name in ("shared-library", "class-name", "constructor-arg"):
        keys.lose(name, "components are created by component_manager")


def _new(keys: Keys, kind: str, kinematic: str) -> Json:
    keys.defaulted("generation", "Classic", "the first versions knew no other")
    return {**HEADS[kind], "kinematic": f"kinematic/{kinematic}.json", "generation": "Classic"}


def _psm_file(keys: Keys, name: str, stem: str) -> Json:
    row = _new(keys, "psm", "PSM")
    if stem in _TOOLS:
        keys.defaulted("tool", _TOOLS[stem], "the tool of that chain, fixed as it was")
        return row | {"tool_detection": "FIXED", "tool": _TOOLS[stem]}
    keys.defaulted("tool_detection", "MANUAL", "the chain names no tool")
    return row | {"tool_detection": "MANUAL"}


def _ecm_file(keys: Keys, name: str, stem: str) -> Json:
    on_cart = "SUJ" in str(keys.peek("base-frame"))
    pitch = _PITCH_ON_CART if on_cart else 0.0
    why = "as on setup joints" if on_cart else "no setup joints are named"
    keys.defaulted("mounting_pitch", f"{pitch:.6f} rad", f"{why}: check it")
    keys.defaulted("endoscope", "Classic_SD_STRAIGHT", "the chain does not say: check it")
    return _new(keys, "ecm", "ECM") | {"endoscope": "Classic_SD_STRAIGHT", "mounting_pitch": round(pitch, 6)}


def _mtm_file(keys: Keys, name: str, stem: str) -> Json:
    row = _new(keys, "mtm", "MTML" if name.upper().startswith("MTML") else "MTMR")
    gravity = keys.text("gravity-compensation")
    return row | ({"gravity_compensation": gravity} if gravity else {})


_ARM_FILES = {"PSM": _psm_file, "ECM": _ecm_file, "MTM": _mtm_file}
