"""The page PID of a robot: its joint controller, measured against setpoint, gains, and a step to try them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Final

from trocar.procs.document.gains import BY_KEY, GAINS, Gain, PidAxis, value_of
from trocar.procs.document.system import PidConfig
from trocar.procs.gui.catalogue import record
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import box, live, switch, units
from trocar.procs.gui.pages.robot_io import tabs
from trocar.procs.gui.plot_source import SIGNALS
from trocar.procs.gui.robots import IoRobot, slides
from trocar.shm.topics import IO_GAINS

NAMES: Final = {"p_gain": "P", "d_gain": "D", "i_gain": "I", "p_deadband": "dead band",
                "p_deadband_outer": "dead band, outer", "i_forget_rate": "integral kept", "i_limit": "integral limit",
                "offset": "offset", "pid_max_output": "largest effort",
                "p_measured_setpoint_tolerance": "error that trips", "v_low_pass_cutoff": "velocity feed, weight",
                "use_disturbance_observer": "observer", "nominal_mass": "observer, inertia",
                "disturbance_cutoff": "observer, cut-off"}
ALWAYS: Final = ("p_gain", "d_gain", "i_gain")
ROWS: Final = (("measured", "position", "joint", ""), ("setpoint", "setpoint_position", "joint", ""),
               ("error", "position_error", "joint", ""), ("effort", "effort", "num:3", "N·m | N"),
               ("effort requested", "setpoint_effort", "num:3", "N·m | N"))
"""Label of an axis value, its field, format and unit; a joint's unit is shown at its name."""
TRACES: Final = dict(zip(SIGNALS, ("position", "setpoint", "velocity", "velocity setpoint", "effort",
                                   "effort requested", "disturbance", "error"), strict=True))
SHOWN_FIRST: Final = ("position", "setpoint_position", "effort", "setpoint_effort")
MAX_STEP: Final = 3
"""Of a step test, in degrees or mm."""
SPANS: Final = (1, 2, 5, 10)


def pid_page(robots: Sequence[IoRobot], robot: IoRobot) -> None:
    """Its content."""
    assert robot.pid is not None
    for name in ("forms.js", "pid.js"):
        script(name)
    tabs(robots, "pid", robot)
    with box("pidpage", id="pid", data_wants=record(robot.pid.arm), data_io=robot.io.name, data_robot=robot.robot.name,
             data_arm=robot.pid.arm, data_gains=robot.gains, data_traces=f"{robot.io.name}/trace{robot.place}-"):
        with box("card", data_source=robot.source):
            _head(robot)
            _table(robot, robot.pid)
        with box("card", data_source=robot.source):
            _plot(robot)


def _head(robot: IoRobot) -> None:
    io, name, source = robot.io.name, robot.robot.name, robot.source
    with box("row head"):
        Part("h2", "title", name)
        Part("span", "kind", "joint controller")
        Part("a", "", "IO", href=robot.path("io"))
        box("spacer")
        Part("span", "age")
        units()
    with box("row"):
        switch("On", f"{source}.pid_enabled", [[(io, "pid_enable", [1], name)]], [[(io, "pid_enable", [0], name)]],
               confirm=f"Switch the joint controller of {name} on? It drives the motors.", id="switch-pid",
               confirm_off=f"Switch the joint controller of {name} off? Joints without brakes sink.")
        for text, field, command in (("Error trips", "tracking_check", "tracking_check"),
                                     ("Velocity feed", "use_setpoint_velocity", "use_setpoint_v"),
                                     ("Position limits", "limits_enforced", "enforce_limits")):
            switch(text, f"{source}.{field}", [[(io, command, [1], name)]], [[(io, command, [0], name)]])
    with box("fault", data_show=f"{source}.fault"):
        live(f"{source}.cause", tag="p")
        live(f"{source}.remedy", tag="p", classes="remedy")


def _table(robot: IoRobot, pid: PidConfig) -> None:
    kinds = ["p" if slide else "r" for slide in slides(robot.robot, pid)]
    with box("scroll"), Part("table", "gains"):
        with Part("thead"), Part("tr"):
            Part("th")
            for name, kind in zip(robot.axis_names, kinds, strict=True):
                with Part("th"):
                    Part("span", "", name)
                    Part("span", "unit", data_unit=kind)
        with Part("tbody"):
            for text, field, form, unit in ROWS:
                with Part("tr"):
                    with Part("td"):
                        Part("span", "", text)
                        Part("span", "unit", unit)
                    for i, kind in enumerate(kinds):
                        with Part("td"):
                            live(f"{robot.source}.{field}.{i}", f"joint:{kind}" if form == "joint" else form)
            for gain in GAINS:
                _gain(gain, pid.axes, kinds)
    with box("row"):
        Part("button", "primary commands", "Apply", type="button", id="apply")
        Part("button", "quiet", "Discard", type="button", id="discard")
        Part("span", "quiet", "nothing changed", id="edited")
        box("spacer")
        Part("button", "quiet", "All gains", type="button", id="all-gains")
        Part("a", "button", "Save as file", href=f"/files{robot.path('pid')}.json", id="save", download="",
             title="The gains in use, as trocar pid save writes them; the next start uses the file named in the system "
                   "file")


def _gain(gain: Gain, axes: Sequence[PidAxis], kinds: Sequence[str]) -> None:
    row = next(row for row in IO_GAINS.fields if row.name == gain.key)
    units = row.unit.split("|")
    with Part("tr", "" if gain.key in ALWAYS else "more"):
        with Part("td", title=f"{gain.key}: {row.text}"):
            Part("span", "", NAMES.get(gain.key, gain.key))
            Part("span", "unit", " | ".join(units))
        for i, axis in enumerate(axes[: len(kinds)]):
            facts = {"data_gain": gain.key, "data_axis": str(i), "data_file": repr(value_of(axis, gain.key)),
                     "title": f"{gain.key} of {axis.name}: {_allowed(gain.key)}; "
                              f"{value_of(axis, gain.key):g} in the file", "aria_label": f"{gain.key} {axis.name}"}
            with Part("td"):
                if gain.switch:
                    with Part("select", "", **facts):
                        Part("option", "", "off", value="0")
                        Part("option", "", "on", value="1")
                else:
                    above = {"data_above": ""} if gain.above else {}
                    Part("input", "", data_low=str(gain.low), data_high=str(gain.high), inputmode="decimal",
                         size="7", autocomplete="off", **above, **facts)


def _allowed(key: str) -> str:
    gain = BY_KEY[key]
    return "on or off" if gain.switch else f"{'above' if gain.above else 'from'} {gain.low:g} up to {gain.high:g}"


def _plot(robot: IoRobot) -> None:
    kinds = slides(robot.robot, robot.pid)
    with box("row"):
        with Part("select", id="axis", aria_label="Joint"):
            for i, name in enumerate(robot.axis_names):
                Part("option", "", name, value=str(i), data_slides="p" if kinds[i] else "r")
        with Part("select", id="span", aria_label="Time shown"):
            for span in SPANS:
                Part("option", "", f"{span} s", value=str(span), **({"selected": ""} if span == 5 else {}))
        Part("button", "quiet", "Pause", type="button", id="pause")
        Part("span", "age")
    with box("row legend"):
        for i, (field, text) in enumerate(TRACES.items()):
            checked = {"checked": ""} if field in SHOWN_FIRST else {}
            with Part("label", f"signal s{i}"):
                Part("input", "", type="checkbox", value=str(i), **checked)
                Part("span", "", text)
    Part("canvas", "trace", id="trace", data_signals=json.dumps(list(SIGNALS)))
    with box("row"):
        Part("span", "quiet", "Step")
        Part("input", "", id="step-size", value="1", size="4", inputmode="decimal", aria_label="Size of the step",
             data_most=str(MAX_STEP))
        Part("span", "unit", id="step-unit")
        Part("span", "quiet", "for")
        Part("input", "", id="step-time", value="1", size="4", inputmode="decimal", aria_label="Length of the step")
        Part("span", "unit", "s")
        Part("button", "commands", "Step and back", type="button", id="step")
