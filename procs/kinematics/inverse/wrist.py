"""Inverse of a PSM with a wrist of two crossing axes: all solutions."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from trocar.procs.document.system import Chain, Tool
from trocar.procs.kinematics.frames import Frame
from trocar.procs.kinematics.inverse.shaft import TINY, Shaft, both_ways, frame_of
from trocar.procs.kinematics.inverse.turns import Triple, columns, cross
from trocar.procs.kinematics.poses import Array, renormalised


class Wrist:
    """PSM whose wrist has two crossing axes at a distance: roll, pitch, yaw.

    The goal contains the yaw axis. The link from pitch to yaw axis is at right angles to it and, because the pitch axis
    is at right angles to the shaft, in one plane with it and the remote centre. That leaves two links and, for each,
    two directions of the shaft.
    """

    def __init__(self, chain: Chain, tool: Tool) -> None:
        """`chain` is yaw, pitch, insertion; `tool` roll, wrist pitch, wrist yaw."""
        links = chain.links + tool.links
        self._shaft = Shaft(chain, links, renormalised(np.array(tool.tip)))
        self._length = links[5].a

    def solutions(self, goal: Array, seed: Array) -> Iterator[list[float]]:
        """All four; the last three joints are NaN if the shaft is out of its limits."""
        end = self._shaft.last_frame(frame_of(goal))
        length = self._length
        _, _, x, px, _, _, y, py, _, _, z, pz = end
        reach = x * px + y * py + z * pz
        ax, ay, az = px - reach * x, py - reach * y, pz - reach * z
        apart = math.sqrt(ax * ax + ay * ay + az * az)
        if apart < TINY:
            return
        for k in (1.0 / apart, -1.0 / apart):
            link = (ax * k, ay * k, az * k)
            for along, depth in both_ways((px - length * link[0], py - length * link[1], pz - length * link[2])):
                q = self._shaft.joints(along, depth)
                if self._shaft.within(q):
                    self._turn(q, along, link, end)
                yield q

    def _turn(self, q: list[float], along: Triple, link: Triple, end: Frame) -> None:
        """Roll and wrist for a shaft along `along` and the link from pitch to yaw axis along `link`."""
        yaw_axis = (end[2], end[6], end[10])
        pitch_axis = cross(link, yaw_axis)
        roll = columns(cross(pitch_axis, along), pitch_axis, along)
        wrist = columns(link, yaw_axis, pitch_axis)
        for joint, before, after in ((3, self._shaft.rotation(q), roll), (4, roll, wrist), (5, wrist, end)):
            q[joint] = self._shaft.turned(joint, before, after)
