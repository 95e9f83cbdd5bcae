"""An arm, stepped once a cycle: io's record and commands in, setpoints, state record, events and io commands out.

This class has the parts common to all arms; PSM, ECM and MTM override the methods under "what an arm may have of its
own". It has no clock and no shared memory: time is the `now_ns` argument, records are arrays given to it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trocar.procs.arm.arm_commands import ArmCommandRow, ArmCommands
from trocar.procs.arm.cartesian_commands import CartesianCommands
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.control import Control
from trocar.procs.arm.joint_commands import JointCommands
from trocar.procs.arm.joints import JointSpace, kinematic_home
from trocar.procs.arm.machine import ArmStates
from trocar.procs.arm.motion import EFFORT, Mode, Space
from trocar.procs.arm.recovery import PreviousState, beginning, previous_state
from trocar.procs.arm.reports import REPORT_NS
from trocar.procs.arm.settings import Settings
from trocar.procs.arm.setup_base import SetupBase
from trocar.procs.arm.stages.homed import Homed, Manual
from trocar.procs.arm.stages.homing import Biased, Calibrating, Homing
from trocar.procs.arm.stages.power import Disabled, Enabled, Fault, Paused, Powering
from trocar.procs.arm.stages.stage import Stage
from trocar.procs.arm.states import AT_HOME, FAULT, PUBLISHED, ArmEvent, ArmState
from trocar.procs.arm.supervision import UNWATCHED, Generations, problem
from trocar.procs.document.system import ArmConfig
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.procs.node.requests import ANSWERED
from trocar.procs.tables import codes
from trocar.procs.tables.arm_types import base_name
from trocar.shm.mailbox.origins import NO_ORIGIN
from trocar.shm.mailbox.received import Request


class ArmLogic:
    """One arm. `step` each cycle, then publish both records."""

    checks_tracking = True
    """io compares setpoints with positions, except in effort mode."""
    not_by_pots: tuple[int, ...] = ()
    """Actuators whose potentiometers do not measure the position."""

    def __init__(self, arm: ArmConfig, around: ArmContext) -> None:
        """A derived class adds its own commands and states to `_commands` and `_stages`."""
        self._around, self._setup_base = around, around.setup_base
        self._previous_state = previous_state(around.state)
        self._started = self._clutched = False
        self._epoch, self._asked_by = 0, NO_ORIGIN
        self.machine = ArmStates(arm.name, around.reports, self._enter, self._is_home)
        self.control = control = Control(arm, around, self.machine)
        self.io = control.io
        self.cartesian_commands = CartesianCommands(control, self.safe, self.guard)
        self._commands = ArmCommands(control, {
            **JointCommands(control).table, **self.cartesian_commands.table, **Settings(control, arm.base_from).table,
            "state_command": ArmCommandRow(self._state_command), "hold": ArmCommandRow(self._hold)})
        self._stages: dict[ArmState, Stage] = {
            ArmState.DISABLED: Disabled(self),
            ArmState.POWERING: Powering(self),
            ArmState.ENABLED: Enabled(self),
            ArmState.CALIBRATING: Calibrating(self),
            ArmState.BIASED: Biased(self),
            ArmState.HOMING: Homing(self),
            ArmState.HOMED: Homed(self),
            ArmState.MANUAL: Manual(self),
            ArmState.PAUSED: Paused(self),
            ArmState.FAULT: Fault(self),
        }
        self._take_settings(arm, self._previous_state)

    def _take_settings(self, arm: ArmConfig, before: PreviousState | None) -> None:
        """The base frame and the ratios of moves: those of the previous process, or of the configuration."""
        control = self.control
        base: Array | None = np.array(arm.base_frame) if arm.base_frame is not None else np.eye(4)
        frame = arm.reference_frame or base_name(arm.name)
        if before is not None:
            frame, base = before.reference_frame, before.base
            control.motion.ratio_v, control.motion.ratio_a = before.ratio_v, before.ratio_a
        control.cartesian.name_frame(frame)
        control.cartesian.set_base(base if self._setup_base is None else None)
        control.place_walls()
        control.record.show_ratios(control.motion)

    # what an arm may have of its own

    def before_homing(self) -> ArmEvent:
        """First event of homing: ONWARD, or one of the arm's own."""
        return ArmEvent.ONWARD

    def home(self) -> Array:
        """Homing position of the joints (size,): the present one, or zero if configured; KINEMATIC arms insert."""
        control = self.control
        if control.is_kinematic:
            return kinematic_home(control.arm, control.joints)
        return np.zeros(control.joints.size) if control.arm.homing_zero_position else self.io.setpoint.copy()

    def is_ready(self) -> bool:
        """Whether homing is complete: everything that the arm carries is engaged, too."""
        return True

    def misses(self) -> str:
        """The operator's next step until a homed arm `is_ready`; empty: none."""
        return ""

    def unhome(self) -> None:
        """Discard the results of homing."""

    def report_attached(self) -> None:
        """Called at the end of each homing: report what the arm carries."""

    def safe(self, at: Array) -> str:
        """Why Cartesian control may not begin at joints (size,); "": it may."""
        return ""

    def guard(self, found: Array, seed: Array) -> None:
        """Change the joints (count,) found for a goal if it is not safe to go there from the seed."""

    def look_after(self) -> None:
        """Called every cycle while HOMED."""

    def watch(self) -> None:
        """Called every cycle in all states: buttons, sensors."""

    def is_clutched(self) -> bool:
        """Whether the clutch on the arm itself is pressed."""
        return self.pressed(self.control.arm.inputs.clutch)

    def bears_weight(self) -> float:
        """Share of its weight that the arm compensates now, 0 to 1."""
        return float(self.control.driving is not None)

    def end_efforts(self) -> None:
        """Effort commands timed out: hold."""
        control = self.control
        control.report_episode(codes.EFFORT_TIMEOUT,
                               f"no effort command for {control.arm.effort_timeout_s:g} s; holding")
        control.stop(control.io.setpoint, Mode.POSITION, "its effort commands have ended")
        control.motion.space = Space.JOINT

    def shape_efforts(self) -> None:
        """Change the efforts of this cycle, after the commanded ones are known."""

    # the cycle

    @property
    def state(self) -> ArmState:
        """The internal state."""
        return self.machine.state

    @property
    def joints(self) -> JointSpace:
        """The joint space in use."""
        return self.control.joints

    @property
    def at_rest(self) -> bool:
        """Whether the arm is off or holds, without compensation of its weight: only measured values change."""
        control = self.control
        motion = control.motion
        return not (motion.moving or not motion.settled or motion.has_velocity or motion.mode is EFFORT
                    or motion.feed_end_ns != FOR_EVER_NS or self.machine.is_busy or self._clutched
                    or (not control.is_kinematic and control.gravity.effort.any()))

    def pressed(self, name: str) -> bool:
        """Whether a digital input of io is pressed; False if the arm has no input of this name."""
        place = self._around.inputs.get(name, -1)
        return place >= 0 and self.io.fresh and bool(self.io.input[place])

    def step(self, now_ns: int, stamp_ns: int, epoch: int, requests: Iterable[Request]) -> None:
        """One cycle. io's newest record has the stamp `stamp_ns` (0: none) and io's start count `epoch`."""
        io, machine, control = self.io, self.machine, self.control
        motion = control.motion
        control.now_ns = now_ns
        io.update(now_ns, stamp_ns, epoch)
        if self._setup_base is not None and self._setup_base.update(now_ns):
            self._rest_on(self._setup_base)
        control.cartesian.update()
        control.walls.begin(now_ns)
        if not self._started and io.fresh:
            self._start()
        self._supervise()
        if motion.moving and control.driving is not None and io.holding.item():
            self._resume()
        self._watch_clutch()
        self.watch()
        self._commands.run(requests)
        self._stages[machine.state].run()
        motion.step(now_ns)
        control.watch_move()
        if motion.drifting:
            control.watch_lag()
        self._step_efforts()
        control.gravity.step(io.position, io.velocity, io.valid and self.bears_weight(), now_ns)
        control.io_requests.step(now_ns)
        machine.settle(is_power_off=not io.fresh or io.power_requested.item() is False)
        control.setpoint.show(control.driving)
        self._show()

    def _step_efforts(self) -> None:
        """The efforts of this cycle, within the bounds of speed and position."""
        io, control, motion = self.io, self.control, self.control.motion
        if motion.mode is EFFORT and control.efforts.is_overdue(control.now_ns):
            self.end_efforts()
        control.step_efforts()
        if motion.mode is EFFORT:
            self.shape_efforts()
            if self.machine.state in AT_HOME and not control.is_kinematic:
                control.walls.push(io.position, io.velocity, motion.effort)
                control.guard.step(io.position, io.velocity, motion)

    def _show(self) -> None:
        control, machine = self.control, self.machine
        if self._started or self._previous_state is None:  # else keep the earlier state, in case we die as well
            control.record.show_state((machine.state, machine.sub_state, machine.desired, self._is_home(),
                                       machine.is_busy, control.homed_generation, control.motion.mode,
                                       control.motion.space))
            control.record.show_reason(self._reason())
        control.record.show_motion(control.gravity.effort)

    def _reason(self) -> str:
        """The cause in FAULT, else the awaited condition."""
        state = self.machine.state
        return self.machine.fault_text if state is FAULT else self._stages[state].waits

    def _start(self) -> None:
        """At the first fresh record of io: take over the state of the previous process, or start from DISABLED."""
        self._started = True
        io, machine, control = self.io, self.machine, self.control
        self._epoch = io.epoch
        restart = self._around.stall or "the arm's process was restarted"
        if self._previous_state is not None:
            control.streams.restart(control.now_ns, restart)
        begin = beginning(self._previous_state, io, self._around, restart)
        control.motion.hold(io.setpoint, Mode.NONE)
        control.held = begin.state is ArmState.ENABLED
        if ArmState.HOMED in (begin.state, begin.paused):
            control.homed_generation = int(io.bias_generation.item())
            control.must_bias = False
            control.driving = Generations.now(io)
        if begin.state is ArmState.FAULT:
            machine.fault(begin.found)
        elif begin.state is ArmState.DISABLED:
            machine.publish()
        else:
            machine.place(begin.state, begin.paused)

    def _supervise(self) -> None:
        state, io, control = self.machine.state, self.io, self.control
        if state in UNWATCHED:
            if self._epoch not in (0, io.epoch):
                self._around.faults.fault()
                self.machine.forget_desired("io was restarted")
            elif not io.fresh:
                self.machine.forget_desired("io does not answer")
            self._epoch = io.epoch
            return
        found = problem(state, io, self._epoch, control.driving, self._around.fault_report,
                        self._around.power_report, self._around.io_stall)
        if found.code is not None:
            self.machine.fault(found)

    def _rest_on(self, setup: SetupBase) -> None:
        """The setup joints moved the base, or are no longer valid."""
        if setup.frame:
            self.control.cartesian.name_frame(setup.frame)
        self.control.set_base(setup.base)

    def _watch_clutch(self) -> None:
        """When pressed, an operator moves the arm by hand, if it is ready for that; see `Manual` for the end."""
        pressed = self.is_clutched()
        if pressed is self._clutched:
            return
        self._clutched = pressed
        self.control.reports.emit("arm_clutch", "pressed" if pressed else "released", value=float(pressed))
        if pressed and self.state is ArmState.HOMED:
            self.machine.fire(ArmEvent.PRESSED)
        elif pressed:
            self.control.report(codes.NOT_READY, "arm not ready yet, manipulator clutch ignored", REPORT_NS)

    def _resume(self) -> None:
        """After a silence so long that io held: continue the move from the held position, without a jump."""
        control = self.control
        if not control.motion.resume(self.io.setpoint, control.now_ns):
            control.move_ended(False, "io held the robot, and the arm cannot resume from there")

    def _enter(self, left: ArmState) -> None:
        """Actions on entering a state."""
        control, state = self.control, self.machine.state
        if state is ArmState.FAULT:
            self._around.faults.fault()
            control.io_requests.on_behalf(NO_ORIGIN)
        elif state is ArmState.DISABLED and left is not ArmState.FAULT:
            self._around.faults.void_earlier(self._asked_by)
        control.io_requests.forget_bias()
        control.io_requests.want_no_fault(False)
        if PUBLISHED[state] != "ENABLED" or state is ArmState.ENABLED:
            mode = Mode.POSITION if state is ArmState.PAUSED else Mode.NONE
            reason = f": {self.machine.reason}" if state is ArmState.FAULT else ""
            control.stop(control.here, mode, f"the arm went to {state}{reason}")
        self._stages[state].enter()

    def _is_home(self) -> bool:
        machine = self.machine
        homed = machine.state in AT_HOME or (machine.state is ArmState.PAUSED and machine.paused in AT_HOME)
        return bool(homed and self.control.homed_generation and self.io.valid and self.is_ready())

    def _state_command(self, request: Request) -> str:
        if request.text.strip() == ArmEvent.UNHOME:
            self.control.homed_generation = 0
            self.control.must_bias = True
            self.unhome()
        self._asked_by = request.origin
        if self.machine.command(request, "" if self.io.fresh else "io does not answer") and request.origin.id:
            self.control.io_requests.on_behalf(request.origin)
        return ANSWERED

    def _hold(self, request: Request) -> str:
        """Outside HOMED, commands given before are void: a bring-up under way elsewhere neither powers nor homes us."""
        control, machine = self.control, self.machine
        control.streams.interrupt()
        if machine.state is not ArmState.HOMED:
            self._around.faults.void_earlier(request.origin)
            return ANSWERED if machine.hold(request) else ""
        control.stop(self.io.setpoint, Mode.POSITION, "replaced by hold")
        control.motion.space = Space.JOINT
        return ""
