"""A PSM with its sterile adapter and its instrument: attached, identified, engaged, and removed."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.arm_commands import ArmCommandRow, Ready
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.control import JAW_MOVE
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.psm.attachment import Attachment, AttachmentState
from trocar.procs.arm.psm.cannula import Cannula
from trocar.procs.arm.psm.detection import Detection
from trocar.procs.arm.reports import REPORT_NS
from trocar.procs.arm.stages.engaging import Engaging
from trocar.procs.arm.stages.homed import Homed
from trocar.procs.arm.states import ArmEvent, ArmState
from trocar.procs.document.catalogue import full_name
from trocar.procs.document.system import ArmConfig, Tool
from trocar.procs.kinematics.coupling import coupling
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.requests import CommandRefused, switch
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

INSERTION: Final = 2
ADAPTER_SWING: Final = math.radians(171.0)
ADAPTER_TURNS: Final = (-1.0, 1.0, -1.0, 1.0, 0.0)


class ArrivedHomed(Homed):
    """On entering HOMED, engage attachments that need no turning first, so that no intermediate state is published."""

    arm: PsmLogic

    def enter(self) -> None:
        self.arm.fit()
        super().enter()
        self.arm.note_ready()


class PsmLogic(ArmLogic):
    """See ArmLogic. The joint space is that of the instrument when and only when it is engaged."""

    def __init__(self, arm: ArmConfig, around: ArmContext) -> None:
        """Resumes with the adapter and the instrument of the previous process."""
        super().__init__(arm, around)
        control, before, field = self.control, self._previous_state, around.state
        reported, is_fixed = field("emulated"), arm.tool_detection == "FIXED" and not arm.inputs.tool
        self.adapter = Attachment(field("adapter"), reported[:1], has_switch=bool(arm.inputs.adapter))
        self.tool = Attachment(field("instrument"), reported[1:], has_switch=bool(arm.inputs.tool),
                               always=is_fixed and not control.is_kinematic)
        if is_fixed and control.is_kinematic and self.tool.fit is AttachmentState.UNKNOWN:
            self.tool.say(True)
            self.tool.fit = AttachmentState.ENGAGED
        self.detection = Detection(control, around.reading)
        self._shown_name, robot = field("tool"), around.robot
        self._sampled = around.field("robot_valid")[robot : robot + 1].reshape(())
        self.cannula = Cannula(control)
        self._was_ready = False
        if before is None and self.detection.tool is not None:
            control.reports.emit("tool_type", full_name(self.detection.tool))
        known = self._known(before.tool) if before is not None and self.tool.present else None
        if known is not None:
            self.detection.take(known)
        elif before is not None and self.tool.fit is AttachmentState.ABSENT:
            self.detection.forget()
        if self.tool.fit is AttachmentState.ENGAGED and self.detection.tool is None:
            self.tool.fit = AttachmentState.FOUND  # the configuration no longer has it
        if self.tool.fit is not AttachmentState.ENGAGED:
            control.use(joints(arm))
        elif self.detection.joints is not None:
            control.use(self.detection.joints)
        self.cannula.measure()
        self._show_name()
        self._commands.rows.update({
            "set_tool_type": ArmCommandRow(self._set_tool_type),
            "emulate_adapter_present": ArmCommandRow(lambda request: self.adapter.say(switch(request))),
            "emulate_tool_present": ArmCommandRow(lambda request: self.tool.say(switch(request))),
            "jaw/servo_jp": ArmCommandRow(self._jaw_servo_jp, Ready.JAW),
            "jaw/servo_jf": ArmCommandRow(self._jaw_servo_jf, Ready.JAW),
            "jaw/move_jp": ArmCommandRow(self._jaw_move_jp, Ready.JAW),
        })
        self._stages |= {
            ArmState.HOMED: ArrivedHomed(self),
            ArmState.ENGAGING_ADAPTER: Engaging(
                self, "adapter", self._adapter_goals,
                lambda: self.adapter.fit is AttachmentState.NEW and not self.tool.present, self._adapter_caught),
            ArmState.ENGAGING_TOOL: Engaging(
                self, "tool", self._tool_goals,
                lambda: self.tool.fit is AttachmentState.NEW and self.detection.tool is not None, self._carry),
        }

    def _known(self, name: str) -> Tool | None:
        arm = self.control.arm
        longest = self._shown_name.dtype.itemsize
        known = (tool for tool in (*arm.tools, arm.tool) if tool is not None and name)
        return next((tool for tool in known if tool.name.encode()[:longest] == name.encode()), None)

    def home(self) -> Array:
        """See ArmLogic; with an instrument the arm stays in place."""
        if not self.control.is_kinematic and self.tool.fit is not AttachmentState.ABSENT:
            here: Array = self.io.setpoint.copy()
            return here
        return super().home()

    def report_attached(self) -> None:
        if self.tool.present and self.detection.tool is not None:
            self.control.reports.emit("tool_type", full_name(self.detection.tool))

    def is_ready(self) -> bool:
        return self.adapter.is_settled and self.tool.is_settled

    def misses(self) -> str:
        if not self.tool.waits:
            return ""
        if self.detection.asks:
            return self.detection.request
        if self.detection.tool is None:
            return "the instrument's memory to be read"
        if self.adapter.has_switch and self.adapter.fit is not AttachmentState.ENGAGED:
            return "no sterile adapter detected under the instrument: check its switch, or emulate_adapter_present 1"
        return ""

    # adapter and instrument

    def watch(self) -> None:
        if not (self.io.fresh and self._sampled.item()):
            return  # an io that has just started has not read its inputs yet
        now, inputs = self.control.now_ns, self.control.arm.inputs
        if self.adapter.look(self.pressed(inputs.adapter), now):
            self.control.status(f"sterile adapter {'on' if self.adapter.present else 'off'}")
        if self.tool.look(self.pressed(inputs.tool), now):
            self.control.status(f"instrument {'on' if self.tool.present else 'off'}")
            if not self.tool.present:
                self.control.reports.emit("tool_type", "")
                self._drop()
        if self.tool.present and self.detection.tool is None:
            self.detection.step()
            self._show_name()

    def look_after(self) -> None:
        event = self.fit()
        if event is not None:
            self.machine.fire(event)
        elif self.note_ready():
            self.machine.publish()

    def note_ready(self) -> bool:
        """Whether `is_ready` has changed since the last call."""
        before, self._was_ready = self._was_ready, self.is_ready()
        return before is not self._was_ready

    def fit(self) -> ArmEvent | None:
        """Engage attachments that need no turning; returns the event for one that does."""
        kinematic = self.control.is_kinematic
        if self.adapter.waits:
            if self.adapter.fit is AttachmentState.NEW and not self.tool.present and not kinematic:
                return ArmEvent.ADAPTER
            self._adapter_caught()
        if not self.tool.waits or self.detection.joints is None or self.detection.tool is None:
            return None
        if self.adapter.has_switch and self.adapter.fit is not AttachmentState.ENGAGED:
            self.control.report(codes.ADAPTER_MISSING, codes.ADAPTER_MISSING.cause, 30 * REPORT_NS)
            return None
        if self.tool.fit is AttachmentState.NEW and not kinematic:
            discs = self.joints.to_actuator @ self.io.setpoint
            beyond = self.cannula.beyond(self.detection.joints, self.detection.tool, discs)
            if not beyond:
                return ArmEvent.TOOL
            self.control.status(f"tool tip is outside the cannula, assuming it doesn't need to engage: {beyond}")
        self._carry()
        return None

    def _adapter_caught(self) -> None:
        self.adapter.fit = AttachmentState.ENGAGED

    def _adapter_goals(self) -> list[Array]:
        goals = [self.io.setpoint.copy() for _ in ADAPTER_TURNS]
        for goal, turn in zip(goals, ADAPTER_TURNS, strict=True):
            goal[INSERTION] = 0.0
            goal[INSERTION + 1 :] = turn * ADAPTER_SWING
        return goals

    def _tool_goals(self) -> list[Array]:
        """Bare discs (7,) for engage positions of an instrument's joints; a snake's bend in pairs."""
        tool = self.detection.tool
        if tool is None:
            return []
        to_disc = coupling(self.control.joints.axes, self.control.arm.chain, tool).joint_to_actuator
        here, goals = self.io.setpoint.copy(), []
        for place in (tool.engage_lower, tool.engage_upper, tool.engage_lower, (0.0,) * len(tool.engage_lower)):
            here[INSERTION + 1 :] = place
            goals.append(to_disc @ here)
        return goals

    def _carry(self) -> None:
        """The instrument is engaged: use its joints, with the discs in place."""
        control = self.control
        space, tool = self.detection.joints, self.detection.tool
        if space is None or tool is None:
            return
        self._change(space)
        self.tool.fit = AttachmentState.ENGAGED
        control.status(f"instrument {full_name(tool)}")

    def _drop(self) -> None:
        """The instrument is gone."""
        self.detection.forget()
        if self.joints.kinematics is not None:
            self._change(joints(self.control.arm))
        self._show_name()

    def _change(self, space: JointSpace) -> None:
        control = self.control
        control.stop(control.here, Mode.POSITION, "the instrument was changed")
        control.use(space)
        control.cartesian.update()
        self.cannula.measure()
        self._show_name()
        if self.state is ArmState.MANUAL:
            self._stages[ArmState.MANUAL].enter()

    def _show_name(self) -> None:
        self._shown_name[...] = self.detection.tool.name.encode() if self.detection.tool is not None else b""

    def _set_tool_type(self, request: Request) -> None:
        control, arm = self.control, self.control.arm
        if arm.tool_detection == "FIXED" and not control.is_kinematic:
            raise CommandRefused("tool detection is FIXED: the arm's file names the instrument")
        if self.machine.moving or self.state is ArmState.HOMING or control.motion.mode is Mode.EFFORT:
            raise CommandRefused("the arm is moving or in effort mode")
        freely = control.is_kinematic or not self.tool.has_switch
        if not (freely or self.detection.asks):
            why = "the instrument is known" if self.tool.present else "there is no instrument"
            raise control.refusal(codes.COMMAND_REFUSED, request.name, f"it is not requested: {why}", REPORT_NS)
        self.detection.named(request.text.strip())
        if freely:
            self.tool.say(True)
            self.tool.fit = AttachmentState.FOUND
        self._show_name()

    # the cannula

    def safe(self, at: Array) -> str:
        return self.cannula.safe(at)

    def guard(self, found: Array, seed: Array) -> None:
        self.cannula.guard(found, seed)

    # the jaw, the last of a joint vector: the space stays, the other joints keep their places

    def _jaw_servo_jp(self, request: Request) -> str:
        self.control.take_goal()[-1] = request.values[0]
        return self.control.adjust(request.name)

    def _jaw_servo_jf(self, request: Request) -> str:
        """From any other mode this starts Cartesian effort control, without a wrench at the tip."""
        control = self.control
        if control.motion.mode is not Mode.EFFORT:
            self.cartesian_commands.enter(request.name)
            control.push(Space.CARTESIAN).body(np.zeros(6), control.now_ns, absolute=False)
        control.efforts.jaw(float(request.values[0]), control.now_ns)
        return control.pushed()

    def _jaw_move_jp(self, request: Request) -> str:
        control = self.control
        control.take_target()[-1] = request.values[0]
        return control.move(request, control.motion.space, JAW_MOVE)
