"""The `consoles` of a system: what they need and which arms their tele-operations join. Checked, not started yet."""

from __future__ import annotations

from procs.lib.config.context import Context
from procs.lib.config.problem import Key
from procs.lib.config.source import Source
from procs.lib.config.system_file import ConsoleKeys, SystemFile

_NEEDS = {
    "PEDALS_ONLY": ("IO_pedals",),
    "PEDALS_ISI_HEAD_SENSOR": ("IO_pedals", "IO_head_sensor"),
    "PEDALS_DVRK_HEAD_SENSOR": ("IO_pedals", "IO_head_sensor"),
    "PEDALS_GOOVIS_HEAD_SENSOR": ("IO_pedals", "HID_file"),
    "SIMULATED": (),
    "COMPONENTS": ("clutch", "camera", "operator_present"),
}


def check_consoles(context: Context, source: Source, content: SystemFile) -> None:
    """Missing parts, unknown arms, tele-operations listed twice; a note for everything that waits."""
    families = {arm.name: arm.type.split("_")[0] for arm in content.arms}
    teleops: dict[str, str] = {}
    for index, console in enumerate(content.consoles):
        key: Key = ("consoles", index)
        context.notes.append(f"not started yet: console {console.name}")
        for name in _NEEDS[console.input_type]:
            if not getattr(console, name):
                context.error(source, (*key, name), f"this key is required with input_type {console.input_type}")
        for where, parts in _teleops(console):
            for role, arm in parts.items():
                _check_arm(context, source, (*key, *where, role), role, arm, families)
            teleop = "_".join(parts.values())
            context.notes.append(f"not started yet: teleop {teleop}")
            if teleop in teleops:
                context.error(source, (*key, *where), f"teleop {teleop} is listed twice, first in {teleops[teleop]}")
            teleops.setdefault(teleop, f"console {console.name}")
        _check_parameters(context, source, key, console)


def _teleops(console: ConsoleKeys) -> list[tuple[Key, dict[str, str]]]:
    rows: list[tuple[Key, dict[str, str]]] = []
    for number, psm in enumerate(console.teleop_PSMs):
        rows.append((("teleop_PSMs", number), {"MTM": psm.MTM, "PSM": psm.PSM}))
    for number, ecm in enumerate(console.teleop_ECMs):
        rows.append((("teleop_ECMs", number), {"MTML": ecm.MTML, "MTMR": ecm.MTMR, "ECM": ecm.ECM}))
    return rows


def _check_arm(context: Context, source: Source, key: Key, role: str, arm: str, families: dict[str, str]) -> None:
    family = role[:3]
    if families.get(arm) == family:
        return
    known = [name for name, other in families.items() if other == family]
    text = f"no {family}" if arm in families else "no arm of this name"
    context.error(source, key, text, f"one of {', '.join(known)}" if known else f"a {family} listed under arms")


def _check_parameters(context: Context, source: Source, key: Key, console: ConsoleKeys) -> None:
    for number, teleop in enumerate(console.teleop_PSMs):
        given = teleop.configure_parameter
        where = (*key, "teleop_PSMs", number, "configure_parameter")
        if given is None:
            continue
        if given.align_MTM and not given.MTM_is_haptic:
            context.error(source, (*where, "align_MTM"), "an MTM that is not haptic cannot align", "false")
        if given.gripper_scaling.zero == given.gripper_scaling.max:
            context.error(source, (*where, "gripper_scaling", "max"), "equal to zero's value", "another angle")
