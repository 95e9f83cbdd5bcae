"""The sources that pages of a system may subscribe to."""

from __future__ import annotations

from functools import partial
from typing import Final

from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.gui.buttons_source import ButtonsSource
from trocar.procs.gui.limits_source import LimitsSource
from trocar.procs.gui.log_source import log_of
from trocar.procs.gui.messages_source import MessagesSource
from trocar.procs.gui.plot_source import TraceSource, plot_of
from trocar.procs.gui.processes_source import ProcessesSource
from trocar.procs.gui.robots import PinsSource, RobotSource, gains_source, robots_of
from trocar.procs.gui.scene_source import SceneSource
from trocar.procs.gui.sources import Maker, RecordSource, Sources
from trocar.procs.gui.strip_source import StripSource
from trocar.shm.system.events import ERROR

KINDS: Final = frozenset({"arm", "third_party", "suj", "teleop", "console", "system", "focus", "io"})
"""Kinds whose state pages show."""
MESSAGES, PROCESSES, SCENE, BUTTONS, PLOT, LOG = "messages", "processes", "scene", "buttons", "plot", "log"
STRIP, ALARMS, LIMITS = "strip", "alarms", "limits"


def record(instance: str, ring: str = "state") -> str:
    """Name of a record's source."""
    return f"{instance}/{ring}"


def pins(io: str) -> str:
    """Name of the source for the inputs and outputs of an io."""
    return f"{io}/pins"


def sources_of(document: SystemConfig) -> Sources:
    """A source for the state of every instance, and those composed of several."""
    makers: dict[str, Maker] = {
        record(row.name): partial(RecordSource, document.name, row.name, "state", simulated=document.clock != WALL)
        for row in document.processes if row.kind in KINDS}
    for robot in robots_of(document):
        makers[robot.source] = partial(RobotSource, document.name, robot, simulated=document.clock != WALL)
        if robot.pid is not None:
            makers[robot.gains] = partial(gains_source, document.name, robot)
            makers[record(robot.pid.arm, "audit")] = partial(RecordSource, document.name, robot.pid.arm, "audit",
                                                             simulated=False, ages=False)
            for axis in range(len(robot.robot.actuators)):
                makers[f"{robot.io.name}/trace{robot.place}-{axis}"] = partial(TraceSource, document.name, robot, axis)
    for io in document.ios:
        makers[pins(io.name)] = partial(PinsSource, document.name, io.name, simulated=document.clock != WALL)
        makers[record(io.name, "instruments")] = partial(RecordSource, document.name, io.name, "instruments",
                                                         simulated=False, ages=False)
    makers[BUTTONS] = partial(ButtonsSource, document)
    makers[MESSAGES] = partial(MessagesSource, document)
    makers[PROCESSES] = partial(ProcessesSource, document)
    makers[SCENE] = partial(SceneSource, document)
    makers[ALARMS] = partial(MessagesSource, document, ERROR)
    makers[LIMITS] = partial(LimitsSource, document)
    makers[STRIP] = partial(StripSource, document)
    return Sources(makers, {PLOT: partial(plot_of, document), LOG: partial(log_of, document)})
