"""Commands in joint space, the same for all arms. Values are (count,), in the order of the arm's joints."""

from __future__ import annotations

from trocar.procs.arm.arm_commands import ArmCommandRow, Ready, Table
from trocar.procs.arm.control import Control
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.states import ArmState
from trocar.shm.mailbox.received import Request


class JointCommands:
    """servo and move in positions, increments, velocities and efforts; free, and the end of a stream."""

    def __init__(self, control: Control) -> None:
        self._control = control
        joint = Ready.JOINT
        self.table: Table = {
            "servo_jp": ArmCommandRow(self._servo_jp, joint),
            "servo_jr": ArmCommandRow(self._servo_jr, joint),
            "servo_jv": ArmCommandRow(lambda request: control.drift(request.values), joint),
            "servo_jf": ArmCommandRow(self._servo_jf, joint),
            "move_jp": ArmCommandRow(self._move_jp, joint),
            "move_jr": ArmCommandRow(self._move_jr, joint),
            "end_stream": ArmCommandRow(self._end_stream),
            "free": ArmCommandRow(self._free, joint),
        }

    def _servo_jp(self, request: Request) -> str:
        control, values = self._control, request.values
        n = control.joints.count
        control.take_goal()[:n] = values[:n]
        return control.follow(request.name, Space.JOINT, values[n:] if len(values) == 2 * n else None)

    def _servo_jr(self, request: Request) -> str:
        control, n = self._control, self._control.joints.count
        goal = control.take_goal()
        if not control.motion.is_pending(control.now_ns):  # else relative to the previous goal
            goal[:n] = control.io.setpoint[:n]
        goal[:n] += request.values
        return control.follow(request.name, Space.JOINT)

    def _servo_jf(self, request: Request) -> str:
        control = self._control
        control.push(Space.JOINT).joint(request.values, control.now_ns)
        return control.pushed()

    def _move_jp(self, request: Request) -> str:
        control = self._control
        control.take_target()[: control.joints.count] = request.values
        return control.move(request, Space.JOINT)

    def _move_jr(self, request: Request) -> str:
        control = self._control
        control.take_target()[: control.joints.count] += request.values
        return control.move(request, Space.JOINT)

    def _end_stream(self, request: Request) -> None:
        control, streams = self._control, self._control.streams
        own = streams.leads(request.sender)
        streams.leave(request.sender)
        if own and control.machine.state is ArmState.HOMED:
            streams.interrupt()
            control.stop(control.here, Mode.POSITION, "ended by its program")

    def _free(self, _: Request) -> None:
        self._control.streams.interrupt()
        self._control.push(Space.JOINT).rest()
