"""The arrays of a PSM teleoperation that follows, from `trocar.procs.teleop.steady.SteadyFollowing`."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CStruct, rows
from trocar.shm.mailbox.mailbox_map import COMMANDS_DEPTH, REPLIES_DEPTH, VALUES_IN_RAW

# Indices in `words`.
COUNT, KNOWN, ANSWERED = range(3)
"""Of the commands to the slave: sent, known to be taken, replies seen."""
LAST, STAMP, SEEN = range(3, 6)
"""Times of the last cycle, and of the master's pose that was checked last: its stamp, and when it was seen."""
ROTATION_LOCKED, TRANSLATION_LOCKED, LINEAR, ANGULAR, CARRIED, JAWS, HAS_GRIPPER, CATCHING_UP = range(6, 14)
DONE_TO: Final = 14
"""Number of the newest command that the slave has done."""
WORDS: Final = 15

# Indices in `numbers`.
ROOM_M, ROOM_RAD, SCALE, FACTOR, OFFSET, LOWER, BEGUN, GHOST, RATE, SLOW_RATE = range(10)
NUMBERS: Final = 10
GOALS: Final = 2 * COMMANDS_DEPTH
"""Numbers of the newest commands that are kept, if they were goals of the pose: more than can be without an answer."""

FOLLOW: Final = CStruct("Follow", (
    # rings: of the master, of the slave, and those of the console and of the slave's base, if there are any
    *rows("i8", "", rings="rings.count"),
    *rows("i8", "rings", head="rings.head", slots="rings.slots", depth="rings.depth", stride="rings.stride",
          size="rings.size", copy="rings.copy", seen="rings.seen", late_ns="late_ns", stamps="stamps"),
    # parts of their records, and cells of shared memory, that are as they were
    *rows("i8", "", parts="parts", cells="cells", room="room", texts="texts"),
    *rows("i8", "parts", part_at="part_at", part_size="part_size"),
    *rows("u1", "parts room", part_was="part_was"),
    *rows("i8", "cells", cell_at="cell_at"),
    *rows("u8", "cells", cell_was="cell_was"),
    # the slave's mailbox: our place there, what our commands begin with, and texts of answers that say nothing
    *rows("i8", "3", cursors="cursors"),
    *rows("i8", str(COMMANDS_DEPTH), queue="queue"),
    *rows("i8", str(REPLIES_DEPTH), replies="replies"),
    *rows("u1", f"2 {VALUES_IN_RAW}", heads="heads"),
    *rows("u1", "texts room", quiet="quiet"),
    *rows("i8", str(GOALS), goals="goals"),
    # in the records
    *rows("f8", "7", pose="master_record.pose", setpoint_of_master="master_record.setpoint",
          pose_of_slave="slave_record.pose", setpoint="slave_record.setpoint", base="base_record"),
    *rows("f8", "6", twist="master.twist"),
    *rows("f8", "1", gripper="gripper", jaw="jaw"),
    *rows("b1", "1", gripper_valid="gripper_valid"),
    # as the teleoperation has seen and mapped them
    *rows("f8", "7", master_measured="master.measured", master_setpoint="master.setpoint",
          slave_measured="slave.measured", slave_setpoint="slave.setpoint", base_seen="base_seen", last="check.last",
          first_master="first_master", first_slave="first_slave", first_base="first_base"),
    *rows("f8", "4", first_offset="first_offset"),
    *rows("i8", str(WORDS), words="words"),
    *rows("f8", str(NUMBERS), numbers="numbers"),
    *rows("i8", "", longest_step_ns="MAX_STEP_NS"),
    *rows("f8", "", most_m_s="MAX_M_S", most_rad_s="MAX_RAD_S", step_m="STEP_M", step_rad="STEP_RAD",
          caught_up="CAUGHT_UP", no_gripper_jaw="NO_GRIPPER_JAW", most_lost_s="MAX_LOST_S", same_jaw="SAME_JAW"),
    # in the teleoperation's own record
    *rows("f8", "7", goal="shown.goal_cp", pose_shown="shown.mtm_measured_cp", setpoint_shown="shown.psm_setpoint_cp"),
    *rows("f8", "6", twist_shown="shown.mtm_measured_cv"),
    *rows("f8", "4", offset="shown.alignment_offset"),
    *rows("f8", "1", jaw_shown="shown.jaw_goal", ghost_shown="shown.gripper_ghost", error="shown.angle_error"),
    *rows("i8", "1", sent_ns="shown.sent_ns", slave_stamp="shown.slave_stamp_ns"),
    *rows("i8", "2", master_stamp="shown.master_stamp_ns"),
), {"go_on": ("i8", "i8")})
