"""Commands of setup joints; refusals give the reason."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np

from trocar.procs.document.cart import FIXED, Cart
from trocar.procs.kinematics.poses import matrix_from_pose, normalised
from trocar.procs.node.requests import CommandRefused, Handler, carry_out, switch
from trocar.procs.suj.classic import Classic
from trocar.procs.suj.machine import SetupState, SetupStates
from trocar.procs.suj.setups import Setups
from trocar.procs.suj.si import Si
from trocar.shm.mailbox.received import Request

FURTHEST: Final = 100.0  # m or rad: beyond any joint of a patient cart


class SetupCommands:
    """One method per row of the `suj` command table."""

    def __init__(self, cart: Cart, setups: Setups, machine: SetupStates, source: Classic | Si | None,
                 refer: Callable[[int], None]) -> None:
        """`refer(place)` makes a setup arm the reference; `source` None: the arms cannot be moved."""
        self._cart, self._setups, self._machine = cart, setups, machine
        self._source, self._refer = source, refer
        self._now_ns = 0
        self._table: dict[str, Handler] = {
            "servo_jp": self._set_joints, "move_jp": self._set_joints, "local/servo_cp": self._put,
            "set_reference_arm": lambda request: self._refer(self._place(request)),
            "clutch": self._clutch, "set_lift_velocity": self._lift,
        }

    def execute(self, requests: Iterable[Request], now_ns: int) -> None:
        """Carry out received commands."""
        self._now_ns = now_ns
        for request in requests:
            if request.name == "state_command":
                self._machine.command(request, now_ns)
            else:
                carry_out(request, self._table[request.name])

    def _place(self, request: Request) -> int:
        try:
            return self._setups.place(request.text.strip())
        except ValueError as error:
            raise CommandRefused(str(error)) from None

    def _set_joints(self, request: Request) -> None:
        if self._cart.simulation != "KINEMATIC" or self._cart.kind == FIXED:
            raise CommandRefused("setup joints have no motors; only KINEMATIC ones can be moved by command")
        place = self._place(request)
        joints = self._setups.arms[place].joints
        if len(request.values) != joints or not np.all(np.abs(request.values) <= FURTHEST):
            given = len(request.values)
            raise CommandRefused(f"{self._setups.names[place]} takes {joints} finite values, {given} were given")
        self._setups.set_joints(place, request.values)

    def _put(self, request: Request) -> None:
        if self._cart.kind != FIXED:
            raise CommandRefused("the pose of these is measured; only that of SUJ_Fixed can be set")
        place = self._place(request)
        self._setups.put(place, matrix_from_pose(normalised(request.values)))

    def _clutch(self, request: Request) -> None:
        place, on = self._place(request), switch(request)
        if self._source is None:
            raise CommandRefused("these setup arms cannot be moved, so there is nothing to clutch")
        if on and self._machine.state is not SetupState.ENABLED:
            raise CommandRefused(f"the setup joints are {self._machine.state}; enable them first")
        self._source.clutch(place, on, self._now_ns)

    def _lift(self, request: Request) -> None:
        velocity = float(request.values[0])
        if not isinstance(self._source, Classic) or not any(arm.lifts for arm in self._cart.arms):
            raise CommandRefused("there is no lift")
        if velocity and self._machine.state is not SetupState.ENABLED:
            raise CommandRefused(f"the setup joints are {self._machine.state}; enable them first")
        self._source.lift(velocity, self._now_ns)
