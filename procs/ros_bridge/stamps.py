"""Stamps of messages."""

from __future__ import annotations

from trocar.procs.ros_messages.messages import Time

SECOND_NS = 1_000_000_000


def time_of(ns: int) -> Time:
    """As ROS has it."""
    return Time(*divmod(ns, SECOND_NS))
