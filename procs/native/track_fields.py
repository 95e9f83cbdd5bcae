"""The arrays of the setpoint tracker, from `RobotIo` (procs/io/cycle.py) or `KinematicIo`. n: actuators."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CStruct, places, rows

TRACK: Final = CStruct("Track", (
    *rows("i8", "", n="robots.axes", robots="robots.count", followers="follow.count", timeout_ns="follow.timeout_ns",
          record_size="follow.rings.size"),
    # the rings, and where in a record what is
    *rows("i8", "followers", head="follow.rings.head", slots="follow.rings.slots", depth="follow.rings.depth",
          stride="follow.rings.stride", copy="follow.rings.copy", seen="follow.rings.seen", axes="follow.axes"),
    *places("followers", "robots", robot="follow.robot"),
    *places("followers", "n", first="follow.first"),
    *rows("i8", "11", offsets="follow.rings.offsets"),
    # what has come of each robot
    *rows("i8", "followers", taken_ns="follow.taken_ns", fresh_ns="follow.fresh_ns"),
    *rows("b1", "followers", is_fresh="follow.is_fresh", resting="follow.resting", follows_velocity="follow.velocity",
          applies_effort="follow.applies_effort", own="follow.own"),
    *rows("b1", "1", dirty="follow.dirty"),
    *rows("i8", "robots", age_ns="record.setpoint_age_ns"),
    *rows("b1", "robots", enabled="record.pid_enabled", holding="record.holding",
          uses_velocity="record.use_setpoint_velocity", desired_open="desired.open"),
    *rows("u4", "robots", bias_generation="record.bias_generation", pid_generation="record.pid_generation",
          desired_taken="desired.taken"),
    # position, velocity, effort and feed-forward as they came, and what the joint controller gets of them
    *rows("f8", "4 n", incoming="follow.incoming"),
    *rows("f8", "n", low="follow.low", high="follow.high", most_step="follow.most_step",
          setpoint="pid.setpoint_position", feed="pid.setpoint_velocity"),
    *rows("b1", "n", at_limit="record.at_limit"),
), {"track": ("i8",)})
