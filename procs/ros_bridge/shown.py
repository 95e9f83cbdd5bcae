"""Topics of a system that are published to ROS, and their names: as in dVRK's bridge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from trocar.procs.crtk.topics import EVENTS_OF_ALL, TopicEntry
from trocar.procs.document.bridges import RosBridge
from trocar.procs.document.system import SystemConfig
from trocar.procs.ros_bridge.outgoing import FIELD_TOPICS, FieldTopic

OFF: Final = "off"
READ_WRITE: Final = "rw"
SHOWN: Final = ("arm", "suj", "teleop", "console", "focus", "system", "third_party", "ros_bridge")
"""Kinds whose views and events are published; io's only on request."""
NOT_OF_ARMS: Final = frozenset(("setpoint_cv",))
"""Views that dVRK's bridge does not have."""
PID_VIEWS: Final = frozenset(("measured_js", "setpoint_js", "error_state/measured_js"))
TIP: Final = "measured_cp"


class ShownTopics:
    """Of one system."""

    def __init__(self, document: SystemConfig, row: RosBridge) -> None:
        self._row = row
        self.kinds = {each.name: each.kind for each in document.processes}
        self.kinds |= {each.name: "third_party" for each in document.third_parties}
        self._robots = {io.name: [robot.name for robot in io.robots] for io in document.ios}
        self._pids = {(io.name, pid.robot): pid.arm for io in document.ios for pid in io.pids if row.pid != OFF}
        self._teleops = {each.name: "PSM" for each in document.teleop_psms}
        self._teleops |= {each.name: "ECM" for each in document.teleop_ecms}
        self._tips: dict[str, list[str]] = {}
        """Tips that a teleoperation of an endoscope works with, by arm."""
        for teleop in document.teleop_ecms:
            for role, tip in (("MTML", teleop.mtml), ("MTMR", teleop.mtmr), ("ECM", teleop.ecm)):
                self._tips.setdefault(tip, []).append(f"{teleop.name}/{role}/{TIP}")
        self._buttons: dict[str, dict[str, list[str]]] = {
            io.name: {each.name: [f"IO/{io.name}/{each.name}"] if row.io != OFF else [] for each in io.digital_inputs}
            for io in document.ios}
        for arm in document.arms:
            inputs = arm.inputs
            for topic, name in (("arm_clutch", inputs.clutch), ("SUJ_clutch", inputs.suj_clutch),
                                ("adapter", inputs.adapter), ("tool", inputs.tool)):
                if name in self._buttons.get(arm.io, {}):
                    self._buttons[arm.io][name].append(f"{arm.name}/IO/{topic}")
        self._setups = {cart.name: [each.name for each in cart.arms] for cart in document.carts}

    def views(self, entry: TopicEntry) -> list[str]:
        """The topics that a view becomes."""
        kind, view = self.kinds.get(entry.instance, ""), entry.name.removeprefix(f"{entry.instance}/")
        if kind == "io":
            return list(self._of_io(entry, view.removeprefix(f"{entry.robot}/")))
        if kind not in SHOWN or view in NOT_OF_ARMS or self._teleops.get(entry.instance) == "ECM":
            return []
        return [entry.name, *(self._tips.get(entry.instance, ()) if view == TIP else ())]

    def _of_io(self, entry: TopicEntry, view: str) -> Iterator[str]:
        if self._row.io != OFF:
            yield f"IO/{entry.name}"
        if view in PID_VIEWS and (entry.instance, entry.robot) in self._pids:
            yield f"PID/{self._pids[entry.instance, entry.robot]}/{view}"

    def fields(self, instance: str) -> list[tuple[FieldTopic, str, int]]:
        """Fields of its record published on change: row, topic, and the index in the field; -1: all of it."""
        kind = self.kinds.get(instance, "")
        if kind == "io":
            arms = [(self._pids.get((instance, robot), ""), place)
                    for place, robot in enumerate(self._robots[instance])]
            return [(row, row.topic.format(arm=arm), place) for row in FIELD_TOPICS if row.kind == kind
                    for arm, place in arms if arm]
        type_ = self._teleops.get(instance, "")
        return [(row, f"{instance}/{row.topic}", -1) for row in FIELD_TOPICS
                if row.kind == kind and (not row.types or type_ in row.types)]

    def events(self, instance: str, event: str) -> list[str]:
        """The topics of an event: of a cart also for each of its setup arms."""
        kind = self.kinds.get(instance, "")
        if kind == "io":
            return [f"IO/{instance}/{event}"] if self._row.io != OFF and event in EVENTS_OF_ALL else []
        setups = [f"{instance}/{setup}" for setup in self._setups.get(instance, ())]
        return [f"{prefix}/{event}" for prefix in (instance, *setups) if kind in SHOWN]

    def buttons(self, instance: str) -> dict[str, list[str]]:
        """The topics of each digital input."""
        return {name: topics for name, topics in self._buttons.get(instance, {}).items() if topics}
