"""Reasons for which a teleoperation waits for its operator, as parts of its `reason` text."""

from __future__ import annotations

from typing import Final

CLUTCHED: Final = "the clutch is pressed"
ALIGN_ONLY: Final = "asked to align only, not to follow"
BY_HAND: Final = "moved by hand"
MOVING: Final = "is still moving"
OFF: Final = "off, tolerance"
GRIPPER: Final = "gripper a bit"
OF_THE_OPERATOR: Final = (CLUTCHED, ALIGN_ONLY, BY_HAND, MOVING, OFF, GRIPPER)
