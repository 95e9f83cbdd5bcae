"""Stamps of messages."""

from __future__ import annotations

from typing import TypeVar

from trocar.procs.ros_messages.messages import Time

SECOND_NS = 1_000_000_000
M = TypeVar("M")


def time_of(ns: int) -> Time:
    """As ROS has it."""
    return Time(*divmod(ns, SECOND_NS))


def stamped(message: M, ns: int) -> M:
    """The message with this stamp, where its kind has one."""
    header = getattr(message, "header", None)
    if header is not None:
        header.stamp = time_of(ns)
    return message
