"""An arm from ROS: a program in the place of a third-party arm, which takes a CRTK arm on ROS as master or slave.

Its record is that of a third-party program, so teleoperations check it by the same rules. A record is written for each
good pose; without one there is none, and the arm is silent. With a loss, a fault or a loss of power of the arm, earlier
operators' commands are void.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from trocar.procs.document.arms import ThirdParty
from trocar.procs.document.bridges import RosArm
from trocar.procs.ros_messages.dds import DEPTH, Participant, TopicReader
from trocar.procs.ros_messages.refusals import Refusals
from trocar.procs.tables import codes
from trocar.procs.user.process import UserLoop
from trocar.shm.mailbox.generations import FaultCell
from trocar.shm.mailbox.origins import NO_ORIGIN
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.tools.client.provider import Provider
from trocar.tools.from_ros.remote_arm import POSE, TOPICS, RemoteArm, RemoteTopic
from trocar.tools.from_ros.remote_commands import RemoteCommands

POLL_NS: Final = 20_000_000
"""Messages are taken when a pose comes, at least so often."""
COMMAND_NS: Final = 2_000_000
"""Commands wait for this long at most while messages are awaited; goals of a stream until the end of the period."""
ABSENT_NS: Final = 3_000_000_000
"""DDS needs this long to find other programs; then the arm is reported as absent."""
ENABLED, FAULT = "ENABLED", "FAULT"
UNPUBLISHED: Final = ("no program publishes it; start the program of that arm, or correct namespace, domain or "
                      "interface of its component")


class ArmFromRos(UserLoop):
    """See above."""

    def guard(self) -> FaultCell:
        """Faults of the arm, and silence."""
        self._faults = self.node.fault_cell()
        return self._faults

    def setup(self) -> None:
        """Join the domain."""
        self.row: ThirdParty = self.node.document.third_party(self.name)
        ros = self.row.ros
        if ros is None:
            raise ValueError(f"{self.name} is not from ROS")
        self.ros: RosArm = ros
        kind = self.row.type.split("_")[0]
        self._refusals = Refusals(self._warn, monotonic_ns)
        self._errors = Refusals(lambda to, text, has_remedy: self.place.error(text), monotonic_ns)
        self.arm = RemoteArm(ros, kind, partial(self._refusals.say, ""))
        self.participant = Participant(ros.domain, ros.interface, f"{self.system}_{self.name}".replace("-", "_"))
        self._readers: list[tuple[RemoteTopic, TopicReader[Any]]] = []
        for topic in (topic for topic in TOPICS if not topic.types or kind in topic.types):
            name, depth = f"{ros.namespace}/{topic.name}", DEPTH if topic.name in ("warning", "error") else 1
            if topic.latched:  # the last message; the other reader hears writers that do not latch
                latched = self.participant.read_latched(name, topic.message, 1, wakes=False)
                self._readers.append((topic, latched))
            reader = self.participant.reader(name, topic.message, depth, wakes=topic.name == POSE)
            self._readers.append((topic, reader))
        self.commands = RemoteCommands(self.participant, self.row, self.arm, self)
        self.place = Provider(self, self.commands.handlers, f"ROS {ros.namespace}"[:40])
        self.participant.announce()
        self._losses, self._shown_state = 0, ""
        self._begun_ns = self._taken_ns = monotonic_ns()
        self._faults.fault()  # the arm was not watched until now

    def update(self) -> None:
        """Once a period: judge silence, report."""
        now_ns = monotonic_ns()
        if now_ns - self._taken_ns > POLL_NS:  # no pose wakes us
            self._take()
        self.arm.look(now_ns)
        self._judge()
        self.commands.look(now_ns)
        self.commands.flush()
        if self.arm.is_there:
            self.error = ""
        elif self.arm.problem:
            self.error = f"{self.arm.problem} ({self.ros.where})"
        elif now_ns - self._begun_ns > ABSENT_NS:
            self.error = self._absence()

    def _rest(self, left_ns: int, looks: bool) -> None:
        if self.participant.wait(min(left_ns, COMMAND_NS)):
            self._take()

    def _take(self) -> None:
        """All messages; those that accompany a pose before it."""
        self._taken_ns = monotonic_ns()
        for topic, reader in self._readers:
            for message in reader.take(partial(self._refusals.say, "")):
                if topic.name == "error":
                    self._errors.say("", f"{self.name} on ROS: {message.data}")
                elif topic.name == "warning":
                    self._refusals.say("", message.data)
                else:
                    publisher = message.sample_info.publication_handle
                    self.arm.take(topic, message, publisher, monotonic_ns(), local_ns())
        self._judge()
        if self.arm.news and self.arm.is_there:
            self.arm.news = False
            self._write()

    def _judge(self) -> None:
        """Void earlier operators' commands after a loss, a fault or a loss of power."""
        arm, was, state = self.arm, self._shown_state, self.arm.state
        if arm.losses != self._losses:
            self._losses = arm.losses
            self._faults.fault()
            self.commands.lose(arm.problem)
        if state != was:
            self._shown_state = state
            if state == FAULT:
                self._faults.fault()
                self.place.error(f"{self.name} is in FAULT on ROS")
            elif was == ENABLED:
                self._faults.void_earlier(NO_ORIGIN)

    def _write(self) -> None:
        """A record for the newest pose."""
        arm, place = self.arm, self.place
        place.set_state(arm.state or "DISABLED", homed=arm.is_homed, busy=arm.is_busy,
                        words=arm.state or "without operating_state on ROS")
        place.set_tool(arm.tool)
        jaw, gripper = arm.value("jaw/setpoint_js"), arm.value("gripper/measured_js")
        setpoint, cells = arm.value("setpoint_cp"), self.cells("state")
        cells["has_jaw"][...], cells["gripper_valid"][...] = jaw is not None, gripper is not None
        frame = self.row.reference_frame or arm.frame or ""
        cells["reference_frame"][...] = frame.encode()[:24]
        is_known = arm.is_valid and (setpoint is not None or not arm.knew("setpoint_cp"))
        place.write(arm.pose if is_known else None, arm.value("measured_cv"), setpoint=setpoint,
                    gripper=None if gripper is None else float(gripper[0]), jaw=None if jaw is None else float(jaw[0]),
                    joints=arm.value("setpoint_js"))

    def _absence(self) -> str:
        topic, reader = next(each for each in self._readers if each[0].name == POSE)
        why = "its program publishes nothing" if reader.is_published else UNPUBLISHED
        return f"no message on {topic.name} of {self.ros.where}: {why}"

    def _warn(self, to: str, text: str, has_remedy: bool) -> None:
        self.node.events.report(codes.ROS_MESSAGE, f"{self.name} on ROS: {text}", self.name)

    def quit(self) -> None:
        """Leave the domain."""
        if hasattr(self, "participant"):
            self.participant.close()
