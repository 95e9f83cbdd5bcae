"""Topics of a system that are published to ROS, and their names: as in dVRK's bridge."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Final

from trocar.procs.crtk.topics import EVENTS_OF_ALL, RECORD, TopicEntry
from trocar.procs.document.bridges import RosBridge
from trocar.procs.document.system import SystemConfig
from trocar.procs.document.user_process import ROS_PAYLOADS
from trocar.procs.ros_bridge.outgoing import FIELD_TOPICS, OF_FIELD, FieldTopic
from trocar.procs.ros_messages.hashes import ros_name
from trocar.shm.topics import View

OFF: Final = "off"
READ_WRITE: Final = "rw"
SHOWN: Final = ("arm", "suj", "teleop", "console", "focus", "system", "third_party", "ros_bridge")
"""Kinds whose views and events are published; io's only on request."""
NOT_OF_ARMS: Final = frozenset(("setpoint_cv",))
"""Views that dVRK's bridge does not have."""
PID_VIEWS: Final = frozenset(("measured_js", "setpoint_js", "error_state/measured_js"))
TIP: Final = "measured_cp"
ON_CHANGE: Final = {ros_name(message): message for message in OF_FIELD}
"""Messages of single fields, by their ROS names."""


class ShownTopics:
    """Of one system."""

    def __init__(self, document: SystemConfig, row: RosBridge) -> None:
        self._row, self.kinds = row, _kinds(document)
        self._robots = {io.name: [robot.name for robot in io.robots] for io in document.ios}
        self._pids = {(io.name, pid.robot): pid.arm for io in document.ios for pid in io.pids if row.pid != OFF}
        self._teleops = {**dict.fromkeys((each.name for each in document.teleop_psms), "PSM"),
                         **dict.fromkeys((each.name for each in document.teleop_ecms), "ECM")}
        self._tips, self._buttons = _tips(document), _buttons(document, has_own=row.io != OFF)
        self._declared = {(user.name, topic.name): topic.ros for user in document.users for topic in user.topics
                          if topic.ros is not None}
        self._setups = {cart.name: [each.name for each in cart.arms] for cart in document.carts}

    def as_view(self, entry: TopicEntry) -> TopicEntry:
        """The record of a user's process as the view that its declaration makes of it; others as they are."""
        ros = self._declared.get((entry.instance, entry.ring))
        if ros is None or entry.kind != RECORD or not (kind := ROS_PAYLOADS[ros.message].kind):
            return entry
        known = {field.name for field in entry.fields}
        parts = tuple((name, name) for name, _ in ROS_PAYLOADS[ros.message].fields if name in known)
        return dataclasses.replace(entry, kind=kind, view=View(entry.ring, kind, parts), labels=ros.joints,
                                   frame=ros.frame)

    def views(self, entry: TopicEntry) -> list[str]:
        """The topics that a view becomes."""
        if (entry.instance, entry.ring) in self._declared:
            return [entry.name]
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

    def fields(self, instance: str, ring: str) -> list[tuple[FieldTopic, str, int]]:
        """Fields of its record published on change: row, topic, and the index in the field; -1: all of it."""
        ros = self._declared.get((instance, ring))
        if ros is not None and not ROS_PAYLOADS[ros.message].kind:
            message = ON_CHANGE[ros.message.replace("/", "/msg/")]
            return [(FieldTopic("user", ring, name, message), f"{instance}/{ring}", -1)
                    for name, _ in ROS_PAYLOADS[ros.message].fields]
        if ring != "state":
            return []
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


def _kinds(document: SystemConfig) -> dict[str, str]:
    """Kinds of all instances, without third-party arms that are themselves on ROS."""
    of_ros = {each.name for each in document.third_parties if each.ros is not None}
    kinds = {**{each.name: each.kind for each in document.processes},
             **{each.name: "third_party" for each in document.third_parties}}
    return {name: kind for name, kind in kinds.items() if name not in of_ros}


def _tips(document: SystemConfig) -> dict[str, list[str]]:
    """Topics of the tips that a teleoperation of an endoscope works with, by arm."""
    found: dict[str, list[str]] = {}
    for teleop in document.teleop_ecms:
        for role, tip in (("MTML", teleop.mtml), ("MTMR", teleop.mtmr), ("ECM", teleop.ecm)):
            found.setdefault(tip, []).append(f"{teleop.name}/{role}/{TIP}")
    return found


def _buttons(document: SystemConfig, *, has_own: bool) -> dict[str, dict[str, list[str]]]:
    """Topics of digital inputs, by io and name: those of the arms that use them, and with `has_own` the input's own."""
    found = {io.name: {each.name: [f"IO/{io.name}/{each.name}"] if has_own else [] for each in io.digital_inputs}
             for io in document.ios}
    for arm in document.arms:
        inputs, known = arm.inputs, found.get(arm.io, {})
        for topic, name in (("arm_clutch", inputs.clutch), ("SUJ_clutch", inputs.suj_clutch),
                            ("adapter", inputs.adapter), ("tool", inputs.tool)):
            if name in known:
                known[name].append(f"{arm.name}/IO/{topic}")
    return found
