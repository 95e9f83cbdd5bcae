"""A PSM, stepped once a cycle: io's record and commands in, set-points, state record, events and io commands out.

It has no clock and no shared memory: time is the `now_ns` argument, records are arrays given to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from procs.arm.cartesian import Cartesian
from procs.arm.commands import Commands, Refused
from procs.arm.duties import Duties, Sender
from procs.arm.joints import ARM_JOINTS, find_tool, homing_goal, joints
from procs.arm.machine import Machine, Reports, Request
from procs.arm.motion import Mode, Motion
from procs.arm.readings import Fields, Readings
from procs.arm.record import ArmRecord, SetpointRecord
from procs.arm.states import PUBLISHED, Event, State
from procs.arm.supervision import POWER_PROBLEMS, UNWATCHED, Generations, trouble
from procs.arm.takeover import beginning, predecessor
from procs.lib.arm_limits import LIMITS
from procs.lib.document import Arm

Array = NDArray[np.float64]

POWER_NS = 3_100_000_000  # io gives up after 3 s, which is never to be raised, and says so; this is if it does not
POWER_TRIES = 2
BIAS_SAMPLES = 1970.0
BIAS_NS = 30_000_000_000
SWITCH_NS = 1_500_000_000  # io shows what it was asked for within this, also when it has refused once (see duties)
SETTLE_NS = 2_000_000_000
HOMING_TOLERANCE = 0.0524  # rad and m alike
NEVER_NS = 1 << 62


class PsmArm:
    """One PSM. `step` each cycle, then publish both records."""

    def __init__(self, arm: Arm, io: Readings, sender: Sender, state: Fields, setpoint: Fields, reports: Reports,
                 fault_text: Callable[[int], str]) -> None:
        """`state` and `setpoint` give the arrays of the arm's own records, still as a predecessor left them."""
        self._arm, self._io, self._reports, self._fault_text = arm, io, reports, fault_text
        self._predecessor = predecessor(state)
        self._cartesian = Cartesian(state)
        self._is_played = arm.simulation != "NONE"  # KINEMATIC: io plays the robot
        self._no_pid = None if self._is_played else False  # until homing; a played one is on with the power
        self._record = ArmRecord(state, io, self._cartesian, simulated=self._is_played)
        self._setpoint = SetpointRecord(setpoint)
        limits = LIMITS["PSM"]
        self._motion = Motion(np.array(limits.velocity), np.array(limits.acceleration))
        self._duties = Duties(io, sender, arm.robot, self._io_refused)
        self._machine = Machine(arm.name, reports, self._enter, self._is_homed)
        tool = arm.tool if arm.tool_detection == "FIXED" else None
        frame = arm.reference_frame or f"{arm.name}_base"
        base: Array | None = np.array(arm.base_frame) if arm.base_frame is not None else np.eye(4)
        if self._predecessor is not None:
            tool = tool or find_tool(arm, self._predecessor.tool)
            frame, base = self._predecessor.reference_frame, self._predecessor.base
            self._motion.ratio_v, self._motion.ratio_a = self._predecessor.ratio_v, self._predecessor.ratio_a
        self.joints = joints(arm, tool)
        self._commands = Commands(self._machine, self._motion, io, self.joints, self)
        self._record.show_joints(self.joints)
        self.set_base(base, frame)
        self.show_ratios()
        self._started = False
        self._epoch = 0
        self._homed_generation = 0
        self._driving: Generations | None = None  # the joint controller was seen on, and follows us
        self._held = False  # it was found on by a successor in no state for it, and just holds
        self._must_bias = True
        self._tries = 0
        self._asked_bias = False
        self._plans_homing = False
        self._deadline_ns = NEVER_NS
        self._limited = b""
        self._now_ns = 0
        self._enters = {
            State.DISABLED: self._enter_disabled,
            State.POWERING: self._enter_powering,
            State.ENABLED: self._enter_enabled,
            State.CALIBRATING: self._enter_calibrating,
            State.BIASED: self._enter_biased,
            State.HOMING: self._enter_homing,
            State.HOMED: self._enter_homed,
            State.PAUSED: self._enter_paused,
            State.FAULT: self._enter_fault,
        }
        self._runs: dict[State, Callable[[], None]] = {
            State.DISABLED: self._run_disabled,
            State.POWERING: self._run_powering,
            State.ENABLED: self._run_onward,
            State.CALIBRATING: self._run_calibrating,
            State.BIASED: self._run_onward,
            State.HOMING: self._run_homing,
            State.HOMED: self._run_homed,
        }

    @property
    def state(self) -> State:
        """The internal state."""
        return self._machine.state

    def step(self, now_ns: int, stamp_ns: int, epoch: int, requests: Iterable[Request]) -> None:
        """One cycle. io's newest record is stamped `stamp_ns` (0: none) by its life number `epoch`."""
        self._now_ns = now_ns
        io, machine, motion = self._io, self._machine, self._motion
        io.update(now_ns, stamp_ns, epoch, self.joints)
        if not self._started and io.fresh:
            self._start()
        self._supervise()
        if motion.moving and self._driving is not None and io.holding.item():
            self._resume()
        self._commands.run(requests, now_ns)
        run = self._runs.get(machine.state)
        if run is not None:
            run()
        if motion.step(now_ns) and machine.moving:
            self._commands.move_ended(True)
        self._duties.step(now_ns)
        machine.settle(self._is_off())
        self._setpoint.show(motion, self.joints, self._driving)
        if self._started or self._predecessor is None:  # till then its state stands, should we die as well
            self._record.show_state(
                machine.state, machine.desired, self._is_homed(), machine.is_busy, self._homed_generation, motion.mode
            )
        self._record.show_motion(self.joints)

    # what commands change

    def command_state(self, request: Request) -> None:
        """Carry out a state_command."""
        machine = self._machine
        if request.text.strip() == Event.UNHOME:
            self._homed_generation = 0
            self._must_bias = True
        machine.command(request, "" if self._io.fresh else "io does not answer")

    def set_base(self, base: Array | None, frame: str) -> None:
        """Another base frame; None: it is not known. An empty `frame` keeps the name."""
        self._cartesian.set_base(base)
        if frame:
            self._record.show_frame(frame)

    def set_tool(self, name: str) -> None:
        """Another instrument among those of the arm's file; the actuators stay where they are."""
        if self._arm.tool_detection == "FIXED":
            raise Refused("set_tool_type: tool detection is FIXED, the instrument is the one of the arm's file")
        tool = find_tool(self._arm, name)
        if tool is None:
            known = ", ".join(t.name for t in self._arm.tools) or "none"
            raise Refused(f"set_tool_type: no instrument {name or '(empty)'}; known are: {known}"[:199])
        try:
            self.joints = joints(self._arm, tool)
        except ValueError as error:
            raise Refused(f"set_tool_type: {error}") from None
        self._commands.joints = self.joints
        self._record.show_joints(self.joints)
        self._io.update(self._now_ns, self._io.stamp_ns, self._io.epoch, self.joints)
        self._motion.hold(self._io.setpoint, Mode.NONE)
        self._reports.status(f"{self._arm.name}: instrument {tool.name}", self._arm.name)

    def show_ratios(self) -> None:
        """The ratios of moves have changed."""
        self._record.show_ratios(self._motion)

    # beginning and supervision

    def _start(self) -> None:
        """The first fresh record of io: take over what a predecessor left, or begin anew."""
        self._started = True
        io, machine = self._io, self._machine
        self._epoch = io.epoch
        begin = beginning(self._predecessor, io)
        machine.reason = begin.reason
        self._motion.hold(io.setpoint, Mode.NONE)
        self._held = begin.state is State.ENABLED
        if State.HOMED in (begin.state, begin.paused):
            self._homed_generation = int(io.bias_generation.item())
            self._must_bias = False
            self._driving = Generations.now(io)
        if begin.state is State.DISABLED:
            machine.publish()
        else:
            machine.place(begin.state, begin.paused)

    def _supervise(self) -> None:
        state, io = self._machine.state, self._io
        if state in UNWATCHED:
            self._epoch = io.epoch
            return
        code, reason = trouble(state, io, self._epoch, self._driving, self._fault_text)
        if code:
            self._machine.fault(code, reason)

    def _resume(self) -> None:
        """We were silent so long that io held: the move has waited as well, it must not jump to where it would be."""
        if not self._motion.resume(self._io.setpoint, self._now_ns) and self._machine.moving:
            self._commands.move_ended(False, "io held, and it cannot go on from there")

    def _is_homed(self) -> bool:
        machine = self._machine
        homed = machine.state is State.HOMED or (machine.state is State.PAUSED and machine.paused is State.HOMED)
        return bool(homed and self._homed_generation and self._io.valid)

    def _is_off(self) -> bool:
        return not self._io.fresh or self._io.power_wanted.item() is False

    def _io_refused(self, text: str) -> None:
        self._reports.warning("io-refused", f"{self._arm.name}: {text}", self._arm.name)

    # states: what is done on the way in, and each cycle

    def _enter(self, left: State) -> None:
        self._deadline_ns = NEVER_NS
        self._duties.forget_bias()
        self._duties.want_no_fault(False)
        state = self._machine.state
        if PUBLISHED[state] != "ENABLED" or state is State.ENABLED:
            mode = Mode.POSITION if state is State.PAUSED else Mode.NONE
            here = self._io.setpoint if self._motion.mode is Mode.EFFORT else self._motion.goal
            reason = f": {self._machine.reason}" if state is State.FAULT else ""
            self._commands.stop(here, mode, f"the arm went {state}{reason}")
        self._enters[state]()

    def _let_go(self) -> None:
        """No power, nothing is followed, nothing is known to be homed."""
        self._driving = None
        self._held = False
        self._homed_generation = 0
        duties = self._duties
        duties.pid.want(False)
        duties.power.want(False)
        duties.pots.want(False)

    def _enter_disabled(self) -> None:
        self._let_go()
        self._duties.limits.want(True)
        self._duties.want_no_fault(True)

    def _run_disabled(self) -> None:
        duties = self._duties
        if not self._machine.goes_on:
            self._deadline_ns = NEVER_NS
            return
        duties.want_no_fault(True)
        duties.pid.want(False)
        duties.power.want(False)
        settled = duties.pid.settled and duties.power.settled and duties.no_fault.settled
        if self._io.fresh and settled and not self._io.amps_on.item():
            self._machine.fire(Event.ONWARD)
        elif self._deadline_ns == NEVER_NS:
            self._deadline_ns = self._now_ns + SWITCH_NS
        elif self._now_ns >= self._deadline_ns:
            self._machine.fault("io-switch", f"io does not get ready for power-on {self._why()}".rstrip())

    def _enter_powering(self) -> None:
        self._tries = 1
        self._duties.power.want(True)
        self._duties.pid.want(self._no_pid)
        self._deadline_ns = self._now_ns + POWER_NS

    def _run_powering(self) -> None:
        duties, io = self._duties, self._io
        if duties.power.settled and io.has_power:
            self._machine.fire(Event.POWERED)
            return
        gave_up = io.problem in POWER_PROBLEMS and duties.no_fault.wanted is None
        if self._now_ns >= self._deadline_ns or gave_up:
            if self._tries >= POWER_TRIES:
                said = f": {self._fault_text(io.problem)}" if io.problem else ""
                self._machine.fault("power-timeout", f"failed to enable power{said} {self._why()}".rstrip())
                return
            self._tries += 1
            duties.want_no_fault(True)
            duties.power_again(self._now_ns)
            self._deadline_ns = self._now_ns + POWER_NS
        elif duties.no_fault.settled:
            duties.want_no_fault(False)

    def _enter_enabled(self) -> None:
        self._driving = None
        self._duties.power.want(None)  # from here on a loss of power is a fault, not a thing to repair
        self._duties.pid.want(None if self._held else self._no_pid)

    def _run_onward(self) -> None:
        if self._machine.goes_on:
            self._machine.fire(Event.ONWARD)

    def _enter_calibrating(self) -> None:
        self._held = False
        self._duties.pid.want(self._no_pid)
        self._deadline_ns = self._now_ns + BIAS_NS
        self._asked_bias = False

    def _run_calibrating(self) -> None:
        duties, arm = self._duties, self._arm
        if self._is_played:
            self._must_bias = False
            self._machine.fire(Event.BIASED)
        elif self._now_ns >= self._deadline_ns:
            self._machine.fault("bias-timeout", f"failed to bias encoders (timeout) {self._why()}".rstrip())
        elif self._asked_bias:
            if duties.bias_done:
                self._must_bias = False
                self._machine.fire(Event.BIASED)
        elif duties.pid.settled and not self._io.biasing.item():
            again = arm.re_home or arm.calibration_mode
            if not self._must_bias and not again and self._io.biased.item():
                self._machine.fire(Event.BIASED)
                return
            duties.bias(BIAS_SAMPLES if again or arm.generation == "Si" else -BIAS_SAMPLES)
            self._asked_bias = True

    def _enter_biased(self) -> None:
        self._duties.pots.want(not self._arm.calibration_mode)

    def _enter_homing(self) -> None:
        duties = self._duties
        duties.limits.want(False)
        duties.tracking.want(True)
        duties.velocity.want(self._arm.use_setpoint_v)
        duties.pid.want(True)
        self._deadline_ns = self._now_ns + SWITCH_NS
        self._plans_homing = True

    def _run_homing(self) -> None:
        if self._plans_homing:
            self._begin_homing()
        elif not self._motion.moving:
            if bool((np.abs(self._motion.goal - self._io.position) < HOMING_TOLERANCE).all()):
                self._machine.fire(Event.ARRIVED)
            elif self._now_ns >= self._motion.end_ns + SETTLE_NS:
                self._machine.fault("homing-timeout", "unable to reach home position during calibration on pots")

    def _begin_homing(self) -> None:
        """Once io follows: from its set-point to the goal."""
        duties, io, motion = self._duties, self._io, self._motion
        if not (duties.pid.settled and duties.limits.settled and duties.tracking.settled):
            if self._now_ns >= self._deadline_ns:
                self._machine.fault("io-switch", f"io does not switch the joint controller on {self._why()}".rstrip())
            return
        self._plans_homing = False
        duties.pid.want(None)  # from here on the controller going off is a fault, not a thing to repair
        self._driving = Generations.now(io)
        motion.hold(io.setpoint, Mode.NONE)
        goal = homing_goal(self._arm, io.setpoint, self.joints.has_jaw)
        outside = self.joints.clip(goal)
        if outside.any():  # io will hold the limits once homed: go there smoothly now
            names = ", ".join(self.joints.name(int(i)) for i in outside.nonzero()[0])
            self._reports.status(f"{self._arm.name}: moving into the joint limits: {names}", self._arm.name)
        reason = motion.move(goal, io.velocity, self._now_ns)
        if reason:
            self._machine.fault("homing-plan", f"homing: {reason}")

    def _enter_homed(self) -> None:
        io, duties = self._io, self._duties
        self._homed_generation = int(io.bias_generation.item())
        here = io.setpoint if self._motion.mode in (Mode.NONE, Mode.EFFORT) else self._motion.goal
        self._motion.hold(here, Mode.NONE)
        duties.limits.want(True)
        duties.tracking.want(True)
        duties.pots.want(not self._arm.calibration_mode)
        duties.velocity.want(self._arm.use_setpoint_v)

    def _run_homed(self) -> None:
        self._duties.want_no_fault(self._io.problem == 0)  # that we were missed is over
        self._duties.tracking.want(self._motion.mode is not Mode.EFFORT)
        limited = self._io.at_limit.tobytes()
        if limited != self._limited:
            self._limited = limited
            self._say_limited()

    def _say_limited(self) -> None:
        axes = self._io.at_limit.nonzero()[0]
        if len(axes):
            # with an instrument, actuators and joints differ behind the first three
            one_to_one = self.joints.coupling.is_identity
            names = (self.joints.name(int(i)) if one_to_one or i < ARM_JOINTS else f"actuator {i + 1}" for i in axes)
            self._reports.status(f"{self._arm.name}: position limit: {', '.join(names)}", self._arm.name)

    def _enter_paused(self) -> None:
        """The joint controller holds, or stays off."""

    def _enter_fault(self) -> None:
        self._let_go()

    def _why(self) -> str:
        """What io said to the requests that failed, in brackets."""
        duties = self._duties
        said = [s.refusal for s in (duties.power, duties.pid, duties.limits, duties.no_fault) if s.refusal]
        if duties.bias_refusal:
            said.append(duties.bias_refusal)
        return f"(io says: {'; '.join(said)})" if said else ""
