"""The page IO of a robot: its actuators and brakes as the boards show them, power, encoders, brakes, checks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.gui.catalogue import record
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import arg, box, button, columns, form, live, switch, units
from trocar.procs.gui.robots import IoRobot, slides

BIAS_SAMPLES: Final = 1970
"""As arms take at homing."""
SUPPLY_S: Final = 20
LIGHTS: Final = (("powered", "powered", ""), ("amps_on", "amplifiers on", ""), ("relay", "relay closed", ""),
                 ("biased", "encoders set", ""), ("pid_enabled", "joint controller", ""),
                 ("biasing", "setting encoders", "busy"), ("holding", "holding without its arm", "busy"),
                 ("watchdog", "watchdog has cut off", "busy"), ("power_fault", "supply fault", "alarm"))
COLUMNS: Final = ("", "amplifier", "requested", "measured", "position", "velocity", "potentiometer", "",
                  "temperature", "encoder")


def tabs(robots: Sequence[IoRobot], section: str, here: IoRobot) -> None:
    """The robots of the system, to choose one."""
    with Part("nav", "tabs"):
        for robot in robots:
            Part("a", "here" if robot is here else "", robot.robot.name, href=robot.path(section), title=robot.io.name)


def io_page(robots: Sequence[IoRobot], robot: IoRobot) -> None:
    """Its content."""
    script("forms.js")
    source, name = robot.source, robot.robot.name
    tabs(robots, "io", robot)
    with box("card", data_source=source, id="robot"):
        with box("row head"):
            Part("h2", "title", name)
            Part("span", "kind", _about(robot))
            if robot.pid and not robot.is_kinematic:
                Part("a", "", "Joint controller", href=robot.path("pid"))
            box("spacer")
            Part("span", "age")
            units()
        with box("row facts"):
            for field, text, tone in LIGHTS:
                light = f"{source}.{field}"
                Part("span", f"light {tone}".strip(), text, data_on=light, **({"data_show": light} if tone else {}))
            if robot.robot.brakes:
                Part("span", "light", "brakes released", data_on=f"{source}.brakes_released")
        _fault(robot)
        live(f"{source}.desired_refused", tag="p", classes="reason", data_show=f"{source}.desired_refused")
        _table(robot)
    with box("cards"):
        _power(robot)
        if not robot.is_kinematic:
            _encoders(robot)
        if robot.robot.brakes:
            _brakes(robot)


def _fault(robot: IoRobot) -> None:
    """The arm's fault, which names the axis; that of the io alone where the arm has none."""
    source, own = robot.source, f"{robot.source}.fault"
    if robot.pid is None:
        with box("fault", data_show=own):
            live(f"{source}.cause", tag="p")
            live(f"{source}.remedy", tag="p", classes="remedy")
        return
    state = record(robot.pid.arm)
    with box("fault", data_show=f"{state}.state=FAULT"):
        live(f"{state}.reason", tag="p")
        Part("p", "remedy", data_remedy=robot.pid.arm)
    with box(data_show=f"!{state}.state=FAULT"), box("fault", data_show=own):
        live(f"{source}.cause", tag="p")
        live(f"{source}.remedy", tag="p", classes="remedy")


def _about(robot: IoRobot) -> str:
    if robot.is_kinematic:
        return "KINEMATIC: there is no robot; values that only boards measure are missing"
    watchdog = f"watchdog {robot.io.watchdog_s * 1e3:g} ms" if robot.io.watchdog_s else "watchdog off"
    return f"{robot.io.name}, serial {robot.robot.serial or '–'}, {robot.robot.hardware}, {watchdog}"


def _table(robot: IoRobot) -> None:
    with box("scroll"), Part("table", "actuators"):
        columns(COLUMNS)
        with Part("tbody"):
            for i, (name, slide) in enumerate(zip(robot.axis_names, slides(robot.robot, robot.pid), strict=True)):
                _actuator(robot, i, name, "p" if slide else "r")
            for i in range(len(robot.robot.brakes)):
                _brake(robot.source, i, len(robot.robot.actuators) + i)


def _actuator(robot: IoRobot, i: int, name: str, kind: str) -> None:
    source = robot.source
    faulty = {"data_on": f"{record(robot.pid.arm)}.reason~{robot.robot.name} axis {i}"} if robot.pid else {}
    with Part("tr", **faulty):
        with Part("td"):
            Part("span", "number", str(i))
            Part("span", "", name)
        _drive(source, i)
        _value(f"{source}.position.{i}", f"joint:{kind}", kind)
        _value(f"{source}.velocity.{i}", f"joint:{kind}", kind, "/s")
        _value(f"{source}.pot_position.{i}", f"joint:{kind}", kind)
        _value(f"{source}.pot_voltage.{i}", "num:2", "", "V")
        _value(f"{source}.temperature.{i}", "num:1", "", "°C")
        with Part("td"):
            Part("span", "light", "set", data_on=f"{source}.encoder_set.{i}")
            live(f"{source}.encoder_bits.{i}", "num:0", "counts")


def _brake(source: str, i: int, drive: int) -> None:
    """`drive`: its place behind the actuators."""
    with Part("tr", "brake"):
        with Part("td"):
            Part("span", "number", "")
            Part("span", "", f"brake {i}")
        _drive(source, drive)
        for _ in range(4):
            Part("td")
        _value(f"{source}.temperature.{drive}", "num:1", "", "°C")
        Part("td")


def _drive(source: str, i: int) -> None:
    with Part("td"):
        Part("span", "light", "on", data_on=f"{source}.amp_on.{i}")
    _value(f"{source}.current_request.{i}", "num:3", "", "A")
    _value(f"{source}.current.{i}", "num:3", "", "A")


def _value(path: str, form: str, kind: str, after: str = "") -> None:
    """A cell; `kind` of a joint: its unit is the one that is chosen."""
    with Part("td"):
        live(path, form)
        with Part("span", "unit"):
            if kind:
                Part("span", data_unit=kind)
            if after:
                Part("span", "", after)


def _power(robot: IoRobot) -> None:
    io, name = robot.io.name, robot.robot.name
    with box("card"):
        Part("h2", "", "Power")
        with box("row"):
            button("Power on", [[(io, "power_on", [], name)]], "primary", id="io-power-on",
                   confirm=f"Power on {name}? Its amplifiers switch on.")
            button("Power off", [[(io, "power_off", [], name)]], id="io-power-off")
            button("Power off, open relay", [[(io, "power_off", [1], name)]], "quiet")
        with box("row"):
            if not robot.is_kinematic:
                button(f"Supply only, {SUPPLY_S} s", [[(io, "supply_on", [SUPPLY_S], name)]], "quiet",
                       confirm=f"Close the relay of {name} and switch motor power on, amplifiers off?")
            button("Clear fault", [[(io, "clear_fault", [], name)]], "quiet")
        if robot.pid:
            Part("p", "quiet", f"Manual settings stay in force until {robot.pid.arm} is enabled again.")


def _encoders(robot: IoRobot) -> None:
    io, name, kinds = robot.io.name, robot.robot.name, slides(robot.robot, robot.pid)
    with box("card"):
        Part("h2", "", "Encoders")
        with box("row"):
            button("Set from potentiometers", [[(io, "bias_encoders", [BIAS_SAMPLES], name)]],
                   confirm=f"Set the encoders of {name} from its potentiometers? It must stand still, and has to be "
                           "homed again afterwards.")
            switch("Compare potentiometers", f"{robot.source}.pot_check", [[(io, "pot_check", [1], name)]],
                   [[(io, "pot_check", [0], name)]])
        with form(io, "set_encoder", name, "row"):
            with arg("select", "choice", aria_label="Actuator"):
                for i, axis in enumerate(robot.axis_names):
                    Part("option", "", axis, value=str(i), data_slides="p" if kinds[i] else "r")
            Part("span", "quiet", "is at")
            arg("input", "joint", aria_label="Position", size="8", inputmode="decimal")
            Part("span", "unit chosen")
            Part("button", "commands", "Set", type="button", data_submit="",
                 data_confirm=f"Set this encoder of {name}? With a wrong position the arm moves wrongly.")


def _brakes(robot: IoRobot) -> None:
    io, name = robot.io.name, robot.robot.name
    with box("card"):
        Part("h2", "", "Brakes")
        with box("row"):
            button("Release", [[(io, "brake_release", [], name)]], id="brakes-release",
                   confirm=f"Release the brakes of {name}? Parts that nothing else holds fall.")
            button("Engage", [[(io, "brake_engage", [], name)]], id="brakes-engage")
