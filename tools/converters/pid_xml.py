"""PID XML (`controller type="PID"`) to the PID JSON format 1: gains, limits of the integral, tolerances."""

from __future__ import annotations

import math

from trocar.procs.config import HEADS
from trocar.tools.converters.element import Element
from trocar.tools.converters.report import ConversionReport, Json, number_text
from trocar.tools.converters.units import PRISMATIC, REVOLUTE
from trocar.tools.converters.xmltext import XmlNode

_TYPES = {"Revolute": REVOLUTE, "Prismatic": PRISMATIC}
_INTERFACES = {"JointTorqueInterface": True}
_MAX_JOINTS = 16
_NO_LIMIT = 1e6  # of the integral state, rad or m times cycles: more than anything reaches
_ELSEWHERE = "the IO and kinematic files have the limits of positions; what an IO file lacks of them is reported there"
_JOINT_SPACE = "gains were for joints, today's are for actuators: compare where the two are coupled (MTM, instruments)"


def convert_pid(root: XmlNode, report: ConversionReport) -> Json:
    """The new file; of no use when the report has problems."""
    top = Element(root, "", report)
    top.take("type")
    top.word(_INTERFACES, "interface")
    count = top.integer("numofjoints", least=1, most=_MAX_JOINTS)
    joints = top.need("joints")
    listed = joints.children("joint")
    for extra in listed[count:]:
        extra.drop_all(f"numofjoints is {count}")
    if len(listed) < count:
        text = f"the file lists only {len(listed)} joint{'s' if len(listed) != 1 else ''}"
        report.error(root.line, "controller@numofjoints", str(count), text, f"{len(listed)}, or as many joints")
    report.converted(root.line, "controller@interface", "JointTorqueInterface", "actuators", _JOINT_SPACE)
    listed = listed[:count]
    while listed and listed[-1].is_word("type", "Inactive"):
        listed.pop().drop_all("an inactive joint, the MTM's gripper, has no controller")
    rows = [_joint(element, number) for number, element in enumerate(listed)]
    top.finish()
    return {**HEADS["pid"], "pid": rows}


def _joint(element: Element, number: int) -> Json:
    report = element.report
    index = element.take("index")
    if index is not None and index[1] != str(number):
        report.converted(element.line, element.key("index"), index[1], str(number), "counted as the original did")
    name = element.take("name")
    if name is None or not name[1]:
        report.defaulted(element.line, element.key("name"), f"joint_{number}", "the file has none")
    row: Json = {
        "index": number,
        "name": name[1] if name and name[1] else f"joint_{number}",
        "type": _type(element),
    }
    gains = element.need("pid")
    limits = element.child("limit")
    row |= _gains(gains)
    if limits is not None:
        row |= _limits(limits, slides=row["type"] == PRISMATIC)
    row |= _integral(element, limits, float(str(row["i_gain"])))
    row["pid_max_output"] = -1.0
    report.defaulted(element.line, f"{element.path}/pid_max_output", "-1", "no limit, as then; left out it would be 0")
    element.drop_child("pos", _ELSEWHERE)
    return row


def _type(element: Element) -> str:
    if element.has("type"):
        return element.word(_TYPES, "type") or REVOLUTE
    limits = element.child("pos")
    guess = PRISMATIC if limits is not None and limits.is_word("Units", "mm") else REVOLUTE
    why = "the file does not say; by the unit of its limits"
    element.report.defaulted(element.line, element.key("type"), guess, why)
    if limits is not None:
        limits.drop_all(_ELSEWHERE)
    return guess


def _gains(element: Element) -> Json:
    row: Json = {
        "p_gain": element.number("PGain"),
        "d_gain": element.number("DGain"),
        "i_gain": element.number("IGain"),
        "i_forget_rate": element.number("Forget", default=1.0),
        "offset": element.number("OffsetTorque", default=0.0),
    }
    if element.has("LowPassCutoff"):
        row["v_low_pass_cutoff"] = element.number("LowPassCutoff")
    if element.has("Nonlinear"):
        band = element.number("Nonlinear")
        if band > 0.0:
            reason = "efforts were scaled down within this error; today: p_deadband and p_deadband_outer, by hand"
            element.report.lost(element.line, element.key("Nonlinear"), number_text(band), reason)
        else:
            element.report.dropped(element.line, element.key("Nonlinear"), number_text(band), "it was switched off")
    return row


def _limits(element: Element, *, slides: bool) -> Json:
    """Tolerance and dead band. The original read all of `limit` as rad, or m, except the dead band: degrees, always."""
    row: Json = {}
    unit = "m" if slides else "rad"
    units = element.take("Units", "Unit")
    if units is not None and units[1] not in ("rad", "m"):
        text = f"was read as {unit} whatever the file says"
        element.report.error(element.line, element.key(units[0]), units[1], text, "rad, m")
    if element.has("ErrorLimit"):
        row["p_measured_setpoint_tolerance"] = element.number("ErrorLimit")
    band = element.number("Deadband", default=0.0)
    if band:
        row["p_deadband"] = math.radians(band)
        reason = "the original took it for degrees on slides, too" if slides else ""
        old, new = number_text(band, "deg"), number_text(math.radians(band), unit)
        element.report.converted(element.line, element.key("Deadband"), old, new, reason)
    return row


def _integral(joint: Element, element: Element | None, gain: float) -> Json:
    """The clamp of the integral: one number today. Without an integral gain it makes no difference."""
    report = joint.report
    if element is None or not element.has("MinILimit", "MaxILimit"):
        if not gain:
            return {}
        new = number_text(_NO_LIMIT)
        report.defaulted(joint.line, f"{joint.path}/limit@MaxILimit", new, "no limit, as then; left out it would be 0")
        return {"i_limit": _NO_LIMIT}
    least = element.number("MinILimit", default=-_NO_LIMIT)
    most = element.number("MaxILimit", default=_NO_LIMIT)
    limit = max(0.0, min(-least, most))
    if -least == most:
        return {"i_limit": limit}
    key, old = element.key("MinILimit"), f"{number_text(least)} to {number_text(most)}"
    if gain:
        report.lost(element.line, key, old, f"the two sides differ: i_limit is {number_text(limit)} for both")
    else:
        report.dropped(element.line, key, old, "the two sides differ; without IGain it makes no difference")
    return {"i_limit": limit}
