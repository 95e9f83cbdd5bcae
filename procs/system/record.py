"""The system's record, and the event for a changed state of an arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from trocar.procs.system.bring_up import ENABLED, FAULT, ArmOnRing
from trocar.procs.system.message_hub import MessageHub
from trocar.procs.system.sound import Sound
from trocar.procs.system.system_commands import SystemCommands
from trocar.shm.memory.layout import shorten
from trocar.shm.system.events import Events


class SystemRecord:
    """Fills the fields of the system's record."""

    def __init__(self, field: Callable[[str], Any], arms: Sequence[ArmOnRing], events: Events, sound: Sound, *,
                 calibration_mode: bool) -> None:
        """Fill in the fields that never change."""
        self._arms, self._events = arms, events
        changing = ("arm_fresh", "arm_state", "arm_homed", "arm_busy", "task", "waiting", "volume", "beeps", "errors",
                    "warnings", "shown_arm", "shown_position")
        self._fields = {name: field(name) for name in changing}
        self._reported = [""] * len(arms)
        field("calibration_mode")[...] = calibration_mode
        field("arm")[...] = [arm.name.encode() for arm in arms]
        field("sound")[...] = shorten(sound.name, field("sound").dtype.itemsize)

    def fill(self, commands: SystemCommands, centre: MessageHub) -> None:
        """Fill in the present state of arms, commands and messages."""
        fields, bring_up = self._fields, commands.bring_up
        for place, arm in enumerate(self._arms):
            fields["arm_fresh"][place], fields["arm_state"][place] = arm.is_fresh, arm.state.encode()
            fields["arm_homed"][place], fields["arm_busy"][place] = arm.is_homed, arm.is_busy
            self._report(place, arm)
        for name, value in (("volume", commands.volume), ("beeps", commands.beeps), ("errors", centre.errors),
                            ("warnings", centre.warnings)):
            fields[name][...] = value
        fields["task"][...] = bring_up.goal.encode() if bring_up is not None else b""
        waiting = bring_up.waiting if bring_up is not None else ""
        fields["waiting"][...] = shorten(waiting, fields["waiting"].dtype.itemsize)
        shown, position = commands.shown
        fields["shown_arm"][...] = shown.encode()
        fields["shown_position"][...] = np.nan
        fields["shown_position"][: len(position)] = position

    def _report(self, place: int, arm: ArmOnRing) -> None:
        """Emit arm_current_state after a change: ENABLED if enabled and homed, FAULT, or empty."""
        state = ENABLED if arm.state == ENABLED and arm.is_homed else FAULT if arm.state == FAULT else ""
        state = state if arm.is_fresh else ""
        if state != self._reported[place]:
            self._reported[place] = state
            self._events.emit("arm_current_state", state, component=arm.name, state=state)
