"""Cycles of the native library, in which a PSM teleoperation follows and nothing else happens: nearly all of them.

    enter    after a cycle in Python: pass all that such a cycle needs, and what it compares with
    go_on    do such a cycle; nothing is done if a record has unusual changes, or with an answer, event, fault or stall
    leave    before a cycle in Python: pass back what has changed since

Every other cycle is done in Python: procs/teleop/teleop.py and psm.py are the reference, and the fallback.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.follow_fields import (
    ANSWERED,
    CATCHING_UP,
    COUNT,
    DONE_TO,
    FOLLOW,
    GHOST,
    GOALS,
    HAS_GRIPPER,
    KNOWN,
    LAST,
    NUMBERS,
    SEEN,
    STAMP,
    WORDS,
)
from trocar.procs.native.library import bind
from trocar.procs.node.inputs import Input
from trocar.procs.node.ring_arrays import RingArrays
from trocar.procs.teleop import motion_check, psm, teleoperation
from trocar.procs.teleop.arms import JAW, LIMITED, TeleopArm
from trocar.procs.teleop.psm import TeleopPsm
from trocar.procs.teleop.teleop import Teleop
from trocar.shm.mailbox.generations import Watched
from trocar.shm.mailbox.mailbox_map import VALUES_IN_RAW
from trocar.shm.mailbox.origins import Origin
from trocar.shm.mailbox.place import Place
from trocar.shm.memory.segment import HEAD_AT
from trocar.shm.ring.ring import EPOCH_WORD

ARM_PARTS: Final = ("state", "sub_state", "is_homed", "control_mode", "simulated", "base_frame", "stops",
                    "reference_valid", "has_jaw", "tool", "gripper_valid")
CONSOLE_PARTS: Final = ("valid", "operator_present", "clutch")
TEXT: Final = 32
"""Bytes: more than in texts of answers that say nothing."""
SHOWN: Final = ("goal_cp", "mtm_measured_cp", "psm_setpoint_cp", "mtm_measured_cv", "alignment_offset", "jaw_goal",
                "gripper_ghost", "angle_error", "sent_ns", "slave_stamp_ns", "master_stamp_ns")


class ShownFields:
    """Fields of a record as arrays of at least one dimension."""

    def __init__(self, field: Callable[[str], NDArray[Any]], **names: str) -> None:
        for name, of_record in names.items():
            setattr(self, name, np.atleast_1d(field(of_record)))


class SteadyFollowing:
    """The arrays of one teleoperation, under the names of procs/native/follow_fields.py."""

    MAX_STEP_NS, MAX_M_S, MAX_RAD_S = motion_check.MAX_STEP_NS, motion_check.MAX_M_S, motion_check.MAX_RAD_S
    STEP_M, STEP_RAD, SAME_JAW = motion_check.STEP_M, motion_check.STEP_RAD, psm.SAME_JAW
    CAUGHT_UP, NO_GRIPPER_JAW = teleoperation.CAUGHT_UP, teleoperation.NO_GRIPPER_JAW
    MAX_LOST_S = teleoperation.MAX_LOST_S

    def __init__(self, teleop: TeleopPsm, places: Sequence[Place], over_ns: Callable[[], int]) -> None:
        """`places`: ours in the arms' mailboxes; `over_ns`: after which time on CLOCK_BOOTTIME nothing is sent."""
        self._teleop, (self._master_place, self._place), self._over_ns = teleop, places, over_ns
        is_moving = teleop.settings.use_mtm_linear_velocity or teleop.settings.use_mtm_angular_velocity
        self._numbers, self._is_in = 13 if is_moving else 7, False
        self._origin: Origin | None = None
        self.master, self.slave = teleop.master, teleop.slave
        assert self.master.check is not None and isinstance(teleop.faults, Watched)
        self.check = self.master.check
        self._inputs: list[Input] = [arm.record for arm in teleop.arms]
        self._set_parts()
        self._set_cells(teleop.faults)
        self._set_texts()
        cursors, queue, replies = self._place.addresses
        self.cursors, self.queue, self.replies = (np.array(each, np.int64) for each in (cursors, queue, replies))
        self.heads, self.goals = np.zeros((2, VALUES_IN_RAW), np.uint8), np.zeros(GOALS, np.int64)
        self.master_record, self.slave_record = (
            ShownFields(arm.record.field, pose="measured_cp", setpoint="setpoint_cp") for arm in teleop.arms)
        self.gripper, self.gripper_valid, self.jaw = map(np.atleast_1d, (
            *map(self.master.record.field, ("gripper_position", "gripper_valid")),
            self.slave.record.field("jaw_setpoint_position")))
        base = teleop.base
        self.base_record = np.zeros(7) if base is None else base.measured
        self.base_seen = np.zeros(7) if base is None else base.seen
        self.first_master, self.first_slave, self.first_base = np.zeros((3, 7))
        self.first_offset = np.zeros(4)
        self.words, self.numbers = np.zeros(WORDS, np.int64), np.zeros(NUMBERS)
        self.shown: Any = ShownFields(teleop.record.field, **{name: name for name in SHOWN})
        bound = bind(FOLLOW, self)
        self.why_python = bound if isinstance(bound, str) else ""
        self._go_on: Callable[[int, int], int] = (
            bound.function("go_on") if isinstance(bound, BoundStruct) else lambda now_ns, over_ns: 0)

    def _set_parts(self) -> None:
        """Rings that are read, and the parts of their records that must stay as they were."""
        base, operator = self._teleop.base, self._teleop.operator
        parts = [arm.record.field(name) for arm in self._teleop.arms for name in ARM_PARTS]
        if operator.record is not None:
            self._inputs.append(operator.record)
            parts += [operator.record.field(name) for name in CONSOLE_PARTS]
        if base is not None:
            self._inputs.append(base.record)
            parts.append(base.known)
        self.rings = RingArrays([each.ring for each in self._inputs])
        self.late_ns = np.array([each.late_ns for each in self._inputs], dtype=np.int64)
        self.stamps = np.zeros(len(self._inputs), dtype=np.int64)
        self._views = [np.atleast_1d(part).view(np.uint8) for part in parts]
        self.parts = len(parts)
        self.part_at = np.array([view.ctypes.data for view in self._views], dtype=np.int64)
        self.part_size = np.array([view.size for view in self._views], dtype=np.int64)
        self.room = max(TEXT, *self.part_size.tolist())
        self.part_was = np.zeros((self.parts, self.room), np.uint8)

    def _set_texts(self) -> None:
        """Texts of answers that say nothing."""
        quiet = ["", *(f"{begin}: {JAW}" for begin in LIMITED)]
        self.texts = len(quiet)
        self.quiet = np.frombuffer(b"".join(text.encode().ljust(self.room, b"\0") for text in quiet), np.uint8).reshape(
            self.texts, self.room)

    def _set_cells(self, faults: Watched) -> None:
        """Cells: writers' claims of the rings; what Python has seen of the arms' events and of the master's answers;
        faults.
        """
        claims = [each.ring.addresses[0] + 8 * EPOCH_WORD for each in self._inputs]
        events = [arm.events.addresses[0] + HEAD_AT for arm in self._teleop.arms]
        answered = [self._master_place.addresses[0][ANSWERED]]
        self._seen = slice(len(claims), len(claims) + len(events) + len(answered))
        self.cell_at = np.array([*claims, *events, *answered, *faults.addresses], dtype=np.int64)
        self.cell_was = np.zeros(len(self.cell_at), dtype=np.uint64)
        self.cells = len(self.cell_at)

    def go_on(self, now_ns: int) -> bool:
        """Do a whole cycle, if it is one in which nothing but following happens."""
        if not self._is_in or not self._go_on(now_ns, self._over_ns()):
            return False
        if self._place.wakes:
            self._place.wake()
        return True

    @property
    def master_stamp_ns(self) -> int:
        """Stamp of the master's record that this cycle has used."""
        return int(self.stamps[0])

    def enter(self) -> None:
        """After a cycle in Python: from here on `go_on` may do cycles, if this one was of that kind."""
        teleop, slave, check, jaw = self._teleop, self.slave, self.check, self._teleop.jaw
        if not (teleop.is_steady and check.has_last and all(each.whole for each in self._inputs)):
            return
        self.cell_was[...] = [ctypes.c_uint64.from_address(at).value for at in self.cell_at.tolist()]
        if any(each.ring.epoch != each.epoch for each in self._inputs) or (
                teleop.origin.generation < teleop.faults.valid_from):
            return  # just now: the next cycle looks at it
        self.cell_was[self._seen] = [*(arm.events.following - 1 for arm in teleop.arms),
                                     self._master_place.cursors[ANSWERED]]
        for row, view in zip(self.part_was, self._views, strict=True):
            row[: view.size] = view
        self.rings.seen[...] = [each.ring.sequence for each in self._inputs]
        self.stamps[...] = [each.stamp_ns for each in self._inputs]
        if self._origin is not slave.commands.origin:
            self._origin = slave.commands.origin
            for head, name, count in zip(self.heads, ("servo_cp", "jaw/servo_jp"), (self._numbers, 1), strict=True):
                head[...] = np.frombuffer(self._place.head(name, count, self._origin), np.uint8)
        mapping, settings = teleop.mapping, teleop.settings
        self.first_master[...], self.first_slave[...] = mapping.first_master, mapping.first_slave
        self.first_offset[...], first_base = mapping.first_offset, mapping.first_base
        is_carried = first_base is not None and teleop.base is not None
        if is_carried:
            self.first_base[...] = first_base
        self.words[...] = (
            *self._place.cursors, teleop.last_ns, check.stamp_ns, check.seen_ns, mapping.rotation_locked,
            mapping.translation_locked, settings.use_mtm_linear_velocity, settings.use_mtm_angular_velocity, is_carried,
            not settings.ignore_jaw, jaw.has_gripper, jaw.is_catching_up, 0)
        self.numbers[...] = (check.room_m, check.room_rad, mapping.scale, jaw.factor, jaw.offset, jaw.lower, jaw.begun,
                             jaw.ghost, jaw.rate, jaw.slow_rate)
        self._is_in = True

    def leave(self) -> None:
        """Before a cycle in Python, or the end."""
        if not self._is_in:
            return
        self._is_in = False
        teleop, check, jaw, words = self._teleop, self.check, self._teleop.jaw, self.words.tolist()
        for place, (each, stamp_ns) in enumerate(zip(self._inputs, self.stamps.tolist(), strict=True)):
            self.rings.hand_over(place)
            each.stamp_ns = stamp_ns
        if words[LAST] == teleop.last_ns:
            return  # no cycle was of that kind
        waiting = range(max(self._place.cursors[COUNT], words[DONE_TO]) + 1, words[COUNT] + 1)
        self._place.cursors = words[COUNT], words[KNOWN], words[ANSWERED]
        self.slave.expect(words[DONE_TO], waiting, self.goals.tolist())
        teleop.last_ns = teleop.now_ns = words[LAST]
        check.stamp_ns, check.seen_ns = words[STAMP], words[SEEN]
        jaw.has_gripper, jaw.is_catching_up = bool(words[HAS_GRIPPER]), bool(words[CATCHING_UP])
        check.room_m, check.room_rad, *_ = self.numbers.tolist()
        jaw.ghost = float(self.numbers[GHOST])
        teleop.mapping.goal[...] = self.shown.goal_cp
        teleop.mapping.offset = tuple(self.shown.alignment_offset.tolist())


def steady_following(teleop: Teleop, over_ns: Callable[[], int]) -> SteadyFollowing | None:
    """For teleoperations of a PSM, both of whose arms are ours; None: the native library does no cycles of this one."""
    if not isinstance(teleop, TeleopPsm) or not isinstance(teleop.faults, Watched):
        return None
    places = [arm.commands.own_place for arm in teleop.arms if type(arm) is TeleopArm]
    found = [place for place in places if place is not None]
    made = SteadyFollowing(teleop, found, over_ns) if len(found) == len(teleop.arms) else None
    return made if made is not None and not made.why_python else None
