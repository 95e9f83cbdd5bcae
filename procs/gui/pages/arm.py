"""The page of an arm: joints and tip, jog, moves with a preview, jaw, instrument or endoscope."""

from __future__ import annotations

from typing import Final

from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import SCENE, record
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, button, choice, columns, head, live, reason, state_buttons
from trocar.procs.gui.pages.poses import TURNS, axes, numbers, turned
from trocar.procs.gui.pages.scene import arm_scene
from trocar.procs.kinematics.endoscopes import NAMES
from trocar.procs.tables.arm_types import ARM_TYPES

ROOM: Final = 8
"""Joints that a record has room for."""
FORCE: Final = {"r": "N·m", "p": "N"}
"""Unit of the effort of a joint that turns, and of one that slides."""


def arm_page(document: SystemConfig, arm: ArmConfig) -> None:
    """Its content."""
    state = record(arm.name)
    slides = [link.joint_type == "prismatic" for link in arm.chain.links]
    slides += [False] * (ROOM - len(slides))
    for name in ("arm.js", "tip.js"):
        script(name)
    with box("armpage", data_arm=arm.name, data_slides="".join("1" if slide else "0" for slide in slides)):
        with box():
            _head(arm, state)
            _joints(state, slides)
            if arm.type == "PSM":
                _jaw(arm.name, state)
            if arm.type == "MTM":
                _gripper(state)
            _carried(arm, state)
            _base(arm, state)
        with box():
            with box("card", data_source=SCENE):
                arm_scene(document, arm.name)
            _tip(arm, state)


def _head(arm: ArmConfig, state: str) -> None:
    with box("card", data_source=state, id=f"arm-{arm.name}"):
        with head("span", "title", arm.name, kind=f"{arm.type} {arm.generation}, {arm.serial or 'no serial number'}"):
            Part("span", "light", "homed", data_on=f"{state}.is_homed")
            Part("span", "light", "busy", data_on=f"{state}.is_busy")
            live(f"{state}.state", classes="chip", data_tone="")
        with box("row quiet"):
            live(f"{state}.sub_state")
            Part("span", "", "wanted:")
            live(f"{state}.desired_state")
        reason(arm.name, state)
        state_buttons(arm.name, "enable", "home", "resume", "unhome", ends=("pause", "disable"))


def _joints(state: str, slides: list[bool]) -> None:
    with box("card", data_source=state):
        with head("h2", "", "Joints", has_age=False):
            Part("label", "quiet", "Jog", for_="jog-speed")
            Part("input", type="range", id="jog-speed", min="2", max="100", value="20", aria_label="Speed of a jog")
            Part("span", "quiet", id="jog-shown")
            Part("button", "", "deg, mm / rad, m", type="button", data_does="units")
        with box("scroll"), Part("table", "joints", data_valid=f"{state}.valid"):
            columns(("joint", "measured", "setpoint", "velocity", "effort", "hold to jog", "goal", ""))
            with Part("tbody"):
                for i, slide in enumerate(slides):
                    _joint(state, i, "p" if slide else "r")
        with box("row"):
            Part("button", "", "Read", type="button", data_does="read", title="Use the measured positions as goal")
            Part("button", "primary commands", "Move", type="button", data_does="move")
            Part("span", "reason", id="preview-says")
            box("spacer")
            Part("label", "quiet", "Speed of moves", for_="ratio")
            Part("input", type="range", id="ratio", min="1", max="100", value="100")
            live(f"{state}.trajectory_ratio", "pct:0")
            Part("span", "quiet", "%")


def _joint(state: str, i: int, kind: str) -> None:
    form = f"joint:{kind}"
    with Part("tr", data_show=f"{state}.count>{i}"):
        live(f"{state}.names.{i}", tag="td")
        for field in ("position", "setpoint_position"):
            live(f"{state}.{field}.{i}", form, tag="td")
        with Part("td"):
            live(f"{state}.velocity.{i}", form)
            with Part("span", "unit"):
                Part("span", "", data_unit=kind)
                Part("span", "", "/s")
        with Part("td"):
            live(f"{state}.effort.{i}", "num:3")
            Part("span", "unit", FORCE[kind])
        with Part("td"):
            for text, sign in (("−", -1), ("+", 1)):
                Part("button", "jog commands", text, type="button", data_joint=str(i), data_sign=str(sign),
                     aria_label=f"Jog joint {i + 1} {text}")
        with Part("td"):
            Part("input", type="text", inputmode="decimal", data_goal=str(i), data_typed=kind, autocomplete="off",
                 aria_label=f"Goal of joint {i + 1}")
        Part("td", "quiet", data_unit=kind)


def _jaw(arm: str, state: str) -> None:
    with_jaw = f"{state}.has_jaw"
    with box("card", data_source=state, data_show=with_jaw, data_valid=with_jaw), box("row"):
        Part("h2", "", "Jaw")
        live(f"{state}.jaw_position", "joint:r")
        Part("span", "quiet", data_unit="r")
        Part("span", "quiet", "setpoint")
        live(f"{state}.jaw_setpoint_position", "joint:r")
        Part("span", "quiet", "effort")
        live(f"{state}.jaw_effort", "num:3")
        Part("span", "quiet", FORCE["r"])
        Part("a", "", "Plot the effort", href=f"/plots#{arm}/state.jaw_effort,{arm}/state.jaw_setpoint_effort")
        box("spacer")
        Part("input", type="text", inputmode="decimal", id="jaw-goal", value="0", size="6", aria_label="Jaw goal",
             data_typed="r")
        Part("span", "quiet", data_unit="r")
        Part("button", "", "Read", type="button", data_does="read-jaw", title="Use the measured angle as goal")
        Part("button", "commands", "Move jaw", type="button", data_does="jaw")


def _gripper(state: str) -> None:
    with box("card", data_source=state, data_valid=f"{state}.gripper_valid"), box("row"):
        Part("h2", "", "Gripper")
        live(f"{state}.gripper_position", "joint:r")
        Part("span", "quiet", data_unit="r")


def _tip(arm: ArmConfig, state: str) -> None:
    with box("card", data_source=state):
        with head("h2", "", "Tip", has_age=False):
            Part("span", "quiet", "in")
            live(f"{state}.reference_frame", classes="quiet")
        with box("numbers"):
            axes()
            _inputs("Goal of the tip", "tip", "go to")
        with box("row"):
            Part("button", "", "Read", type="button", data_does="read-tip", title="Use the measured pose as goal")
            Part("button", "primary commands", "Move tip", type="button", data_does="move-tip")
            Part("span", "reason", id="tip-says")
        with box("part numbers"):
            _poses(state)
        with box("row", data_valid=f"{state}.reference_valid"):
            Part("span", "quiet", "quaternion x y z w")
            for i in range(3, 7):
                live(f"{state}.measured_cp.{i}", "num:4")
            box("spacer")
            wrench = ",".join(f"{arm.name}/state.body_measured_cf[{i}]" for i in range(6))
            Part("a", "", "Plot the wrench", href=f"/plots#{wrench}")
        with box("part"):
            with box("row"):
                Part("span", "quiet", "Hold to jog in axes of")
                choice((("", "the frame of its poses"), ("tip", "the tip")), id="jog-axes", aria_label="Axes of a jog")
            with box("jogs"):
                for kind, names in (("linear", ("x", "y", "z")), ("angular", ("turn x", "turn y", "turn z"))):
                    for axis, text in enumerate(names):
                        for sign, word in ((-1, "−"), (1, "+")):
                            Part("button", "jog commands", f"{text} {word}", type="button", data_twist=kind,
                                 data_axis=str(axis), data_sign=str(sign))


def _poses(state: str) -> None:
    """Rows of a table of x, y, z: poses in the base frame are valid even if the base pose is unknown."""
    known, in_base = f"{state}.reference_valid", f"{state}.cartesian_valid"
    for text, field, valid in (("measured", "measured_cp", known), ("setpoint", "setpoint_cp", known),
                               ("in its base", "local_measured_cp", in_base),
                               ("its setpoint", "local_setpoint_cp", in_base)):
        numbers(f"{text}, mm", f"{state}.{field}", "mm:2", data_valid=valid)
        turned(f"{state}.{field}", data_valid=valid)
    numbers("velocity, mm/s", f"{state}.measured_cv", "mm:1", data_valid=known)
    numbers("turning, °/s", f"{state}.measured_cv", "deg:1", 3, data_valid=known)


def _inputs(what: str, pose: str, place: str) -> None:
    """Two rows of a table of x, y, z: a pose as people type it."""
    for text, kind, first in ((place, "p", 0), ("turned about", "r", 3)):
        with Part("span", title=TURNS if first else ""):
            Part("span", "", f"{text}, ")
            Part("span", "", data_unit=kind)
        for i, axis in enumerate("xyz"):
            Part("input", type="text", inputmode="decimal", autocomplete="off", size="7", data_pose=pose,
                 data_typed=kind, data_part=str(first + i),
                 aria_label=f"{what}: {'turn about ' if first else ''}{axis}")


def _base(arm: ArmConfig, state: str) -> None:
    """Pose of the base in the frame in which its poses are given."""
    with box("card seldom", data_source=state):
        with head("h2", "", "Base frame", has_age=False):
            Part("span", "quiet", "in")
            live(f"{state}.reference_frame", classes="quiet")
        with box("numbers", data_valid=f"{state}.reference_valid"):
            axes()
            numbers("position, mm", f"{state}.base_frame", "mm:2")
            turned(f"{state}.base_frame")
        if arm.base_from:
            Part("p", "quiet", f"{arm.base_from} gives it.")
            return
        with Part("details"):
            Part("summary", "", "Set another one")
            with box("numbers"):
                _inputs("Base", "base", "place")
            with box("row"):
                Part("label", "quiet", "in frame", for_="base-in")
                Part("input", type="text", id="base-in", size="10", maxlength="31", autocomplete="off",
                     placeholder="as it is", pattern=r"[!-~]*")
                Part("button", "", "Read", type="button", data_does="read-base", title="Use the present one")
                Part("button", "commands", "Set", type="button", data_does="set-base")
                button("Not known", [[(arm.name, "set_base_frame", [], "")]], "quiet",
                       confirm=f"Forget the base frame of {arm.name}? Only poses in its base stay valid.")


def _carried(arm: ArmConfig, state: str) -> None:
    if ARM_TYPES[arm.type].has_endoscope:
        _chosen("Endoscope", "endoscope", NAMES, "set_endoscope_type", state)
    elif arm.type == "PSM":
        tools = tuple(dict.fromkeys(tool.name for tool in arm.tools))
        _chosen("Instrument", "instrument", tools, "set_tool_type", state)


def _chosen(title: str, name: str, choices: tuple[str, ...], command: str, state: str) -> None:
    with box("card seldom", data_source=state):
        with box("row"):
            Part("h2", "", title)
            live(f"{state}.tool", classes="tool")
        if choices:
            with box("row"):
                choice(zip(choices, choices, strict=True), id=name, aria_label=title)
                Part("button", "commands", "Set", type="button", data_says=command, data_with=name,
                     data_confirm=f"Report to the arm that this {name} is attached?")
