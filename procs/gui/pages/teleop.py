"""The page Teleoperation: consoles with their pedals, teleoperations with what they wait for, scale and locks."""

from __future__ import annotations

from typing import Final

from procs.document.consoles import Console, TeleopEcmConfig, TeleopPsmConfig
from procs.document.system import SystemConfig
from procs.gui.catalogue import record
from procs.gui.pages.parts import Part, box, button, live

PEDALS: Final = (("operator", "operator_present", "emulate_operator_present"), ("clutch", "clutch", "emulate_clutch"),
                 ("camera", "camera", "emulate_camera"))
"""What is shown, its field in the record of a console, and the command that acts as if."""
LOCKS: Final = (("Lock rotation", "Rotation locked", "rotation_locked", "lock_rotation"),
                ("Lock translation", "Translation locked", "translation_locked", "lock_translation"),
                ("Align master", "Aligns master", "align_mtm", "set_align_MTM"))
"""What a button does, and has done; the field that says whether, and the command."""
SCALES: Final = (0.1, 0.2, 0.3, 0.5, 1.0)


def teleop_page(document: SystemConfig) -> None:
    """Its content."""
    rows: tuple[TeleopPsmConfig | TeleopEcmConfig, ...] = (*document.teleop_psms, *document.teleop_ecms)
    in_record: tuple[TeleopPsmConfig | TeleopEcmConfig, ...] = (*document.teleop_ecms, *document.teleop_psms)
    for console in document.consoles:
        _console(console, [row.name for row in in_record if row.console == console.name])
    with box("teleops"):
        for row in rows:
            _teleop(row)


def _console(console: Console, teleops: list[str]) -> None:
    """`teleops`: in the order of its record."""
    state = record(console.name)
    with box("card", data_source=state):
        with box("row head"):
            Part("span", "title", console.name)
            live(f"{state}.input_type", classes="kind")
            box("spacer")
            Part("span", "age")
            Part("span", "light", "teleoperation wanted", data_on=f"{state}.teleop_enabled")
        with box("row"):
            for text, field, command in PEDALS:
                Part("span", "light", text, data_on=f"{state}.{field}")
                button("press", [[(console.name, command, [1], "")]], "small", id=f"{text}-press",
                       confirm=f"Act as if the {text} pedal or sensor were pressed, until it is released?")
                button("release", [[(console.name, command, [0], "")]], "small")
            Part("span", "quiet", "press and release act as if, where there are no pedals")
        with box("row"):
            Part("span", "quiet", "selected")
            for i, name in enumerate(teleops):
                selected = f"{state}.selected.{i}"
                button(name, [[(console.name, "select_teleop", [], name)]], "small", data_show=f"!{selected}")
                button(f"✓ {name}", [[(console.name, "unselect_teleop", [], name)]], "small on", data_show=selected)
            Part("span", "quiet", "those that share an arm take turns")
        with box("row buttons"):
            button("Start teleoperation", [[(console.name, "teleop_enable", [1], "")]], id="teleop-start",
                   confirm="Start teleoperation? Masters move to align.")
            button("Stop", [[(console.name, "teleop_enable", [0], "")]], "quiet", is_free=True)
            box("spacer")
            Part("span", "quiet", "scale of all")
            live(f"{state}.scale", "num:2")
            for scale in SCALES:
                button(f"{scale:g}", [[(console.name, "set_scale", [scale], "")]])


def _teleop(row: TeleopPsmConfig | TeleopEcmConfig) -> None:
    state = record(row.name)
    with box("card", data_source=state, id=f"teleop-{row.name}"):
        with box("row head"):
            Part("span", "title", row.name)
            box("spacer")
            Part("span", "age")
            Part("span", "light", "following", data_on=f"{state}.following")
            live(f"{state}.state", classes="chip", data_tone="")
        live(f"{state}.reason", tag="p", classes="reason", data_show=f"{state}.reason")
        with box("row facts"):
            for text, field in (("clutched", "clutched"), ("operator active", "operator_active")):
                Part("span", "light", text, data_on=f"{state}.{field}")
            Part("span", "quiet", "wanted:")
            live(f"{state}.desired_state", classes="quiet")
        if isinstance(row, TeleopPsmConfig):
            _frames(state)
        with box("row quiet"):
            Part("span", "", "scale")
            live(f"{state}.scale", "num:2")
            for scale in SCALES:
                button(f"{scale:g}", [[(row.name, "set_scale", [scale], "")]], "small")
            if isinstance(row, TeleopPsmConfig):
                Part("span", "", "off in orientation by")
                live(f"{state}.angle_error", "deg:1")
                Part("span", "", "°")
        if isinstance(row, TeleopPsmConfig):
            with box("row buttons"):
                for text, done, field, command in LOCKS:
                    button(text, [[(row.name, command, [1], "")]], data_show=f"!{state}.{field}")
                    button(f"✓ {done}", [[(row.name, command, [0], "")]], "on", data_show=f"{state}.{field}")
        with box("row buttons"):
            button("Enable", [[(row.name, "state_command", [], "enable")]],
                   confirm="Enable it? The master moves to align.")
            button("Align", [[(row.name, "state_command", [], "align_MTM")]], confirm="Align? The master moves.")
            box("spacer")
            button("Disable", [[(row.name, "state_command", [], "disable")]], "quiet", is_free=True)


def _frames(state: str) -> None:
    with box("numbers", data_valid=f"{state}.valid"):
        for text in ("", "x", "y", "z"):
            Part("b", "quiet", text)
        for text, field in (("master", "mtm_measured_cp"), ("slave", "psm_setpoint_cp"), ("goal", "goal_cp")):
            Part("span", "", f"{text}, mm")
            for i in range(3):
                live(f"{state}.{field}.{i}", "mm:1")
