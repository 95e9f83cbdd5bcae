"""The page Teleoperation: pending conditions of each teleoperation, its scale and locks."""

from __future__ import annotations

from typing import Final

from trocar.procs.document.consoles import TeleopEcmConfig, TeleopPsmConfig
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.catalogue import record
from trocar.procs.gui.pages.console import PEDALS, SCALES, teleop_buttons
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, button, head, live, teleop_reason
from trocar.procs.gui.pages.poses import axes, numbers, turned

ALIGNS: Final = "The master may move to align."
LOCKS: Final = (("Lock rotation", "Rotation locked", "rotation_locked", "lock_rotation", "", f"Unlock it? {ALIGNS}"),
                ("Lock translation", "Translation locked", "translation_locked", "lock_translation", "", ""),
                ("Align master", "Aligns master", "align_mtm", "set_align_MTM", f"Align? {ALIGNS}", ""))
"""Label of a button when off and on; its status field, the command, confirmations before on and off."""


def teleop_page(document: SystemConfig) -> None:
    """Its content."""
    rows: tuple[TeleopPsmConfig | TeleopEcmConfig, ...] = (*document.teleop_psms, *document.teleop_ecms)
    for console in document.consoles:
        _enabling(console.name)
    with box("teleops"):
        for row in rows:
            _teleop(row)


def _enabling(name: str) -> None:
    """A console in a line: whether its teleoperations are enabled, and its operator's presence."""
    state = record(name)
    with box("card", data_source=state), box("row"):
        Part("a", "title", name, href="/console")
        Part("span", "light", "teleoperation requested", data_on=f"{state}.teleop_enabled")
        for text, field, _ in PEDALS:
            Part("span", "light", text, data_on=f"{state}.{field}")
        Part("span", "age")
        box("spacer")
        teleop_buttons(name)


def _teleop(row: TeleopPsmConfig | TeleopEcmConfig) -> None:
    state = record(row.name)
    with box("card", data_source=state, id=f"teleop-{row.name}"):
        with head("span", "title", row.name):
            Part("span", "light", "following", data_on=f"{state}.following")
            live(f"{state}.state", classes="chip", data_tone="")
        teleop_reason(state)
        with box("row facts"):
            for text, field in (("clutched", "clutched"), ("operator active", "operator_active")):
                Part("span", "light", text, data_on=f"{state}.{field}")
            Part("span", "quiet", "wanted:")
            live(f"{state}.desired_state", classes="quiet")
        if isinstance(row, TeleopPsmConfig):
            _frames(state)
        else:
            _arms_of(row)
        with box("row quiet"):
            Part("span", "", "scale")
            live(f"{state}.scale", "num:2")
            for scale in SCALES:
                button(f"{scale:g}", [[(row.name, "set_scale", [scale], "")]], "small",
                       data_on=f"{state}.scale={scale:g}")
            if isinstance(row, TeleopPsmConfig):
                Part("span", "", "orientation error")
                live(f"{state}.angle_error", "deg:1")
                Part("span", "", "°")
        if isinstance(row, TeleopPsmConfig):
            with box("row buttons"):
                for text, done, field, command, on, off in LOCKS:
                    button(text, [[(row.name, command, [1], "")]], data_show=f"!{state}.{field}", confirm=on)
                    button(f"✓ {done}", [[(row.name, command, [0], "")]], "on", data_show=f"{state}.{field}",
                           confirm=off)
        with box("row buttons"):
            is_psm = isinstance(row, TeleopPsmConfig)
            button("Enable", [[(row.name, "state_command", [], "enable")]],
                   confirm=f"Enable it? {ALIGNS if is_psm else 'The endoscope follows the masters.'}")
            if is_psm:
                button("Align", [[(row.name, "state_command", [], "align_MTM")]], confirm="Align? The master moves.")
            box("spacer")
            button("Disable", [[(row.name, "state_command", [], "disable")]], "quiet")


def _frames(state: str) -> None:
    with box("numbers", data_valid=f"{state}.valid"):
        axes()
        for text, field in (("master", "mtm_measured_cp"), ("slave", "psm_setpoint_cp"), ("goal", "goal_cp")):
            numbers(f"{text}, mm", f"{state}.{field}", "mm:1")
            turned(f"{state}.{field}")


def _arms_of(row: TeleopEcmConfig) -> None:
    """For an ECM teleoperation, as its arms report them."""
    with box("numbers"):
        axes()
    for name, field in ((row.mtml, "measured_cp"), (row.mtmr, "measured_cp"), (row.ecm, "setpoint_cp")):
        state = record(name)
        with box("numbers", data_source=state, data_valid=f"{state}.reference_valid"):
            numbers(f"{name}, mm", f"{state}.{field}", "mm:1")
            turned(f"{state}.{field}")
