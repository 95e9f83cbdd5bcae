"""The ROS bridge: every arm, console and teleoperation as ROS 2 nodes. It drives no arm itself.

A request from ROS becomes a person's command, see carrying_out.py; outgoing.py lists published data, incoming.py and
services.py the accepted requests. It runs like a user's own process: ordinary priority, real time; if it crashes or
hangs, only its own streams end.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Final

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.joint_order import JointNames
from trocar.procs.crtk.last_look import LastLook
from trocar.procs.crtk.topics import EVENT, RECORD, TopicEntry, catalogue
from trocar.procs.crtk.views import OpenTopic, Stamps, state_as_event
from trocar.procs.document.system import SystemConfig
from trocar.procs.node import runtime
from trocar.procs.node.pacing import duration
from trocar.procs.node.setup_error import SetupError
from trocar.procs.ros_bridge.carrying_out import Addressee, Commands
from trocar.procs.ros_bridge.events import EventTopics
from trocar.procs.ros_bridge.periodic import Descriptions, LoopStatistics, Throttle, TipFrames
from trocar.procs.ros_bridge.publishing import RecordTopics
from trocar.procs.ros_bridge.services import Services
from trocar.procs.ros_bridge.shown import READ_WRITE, ShownTopics
from trocar.procs.ros_messages.dds import EVENT_DEPTH, Participant
from trocar.procs.ros_messages.messages import Clock, Log, OperatingState, time_of
from trocar.procs.ros_messages.refusals import Refusals
from trocar.procs.ros_messages.replier import Replier
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES
from trocar.procs.tables import codes
from trocar.procs.user.process import UserLoop
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import boottime_ns, local_ns, monotonic_ns
from trocar.shm.time.control_page import ControlPage

IDLE_NS: Final = 100_000_000
FRAMES_NS: Final = 20_000_000
STATISTICS_NS: Final = 200_000_000
STREAM_NS: Final = 100_000_000
"""An older goal is no longer part of a stream."""
DEAF_NS: Final = 100_000_000


def addressees(system: SystemConfig) -> list[Addressee]:
    """All instances that accept commands."""
    ros = system.ros
    robots = [(io.name, tuple((robot.name, robot.name) for robot in io.robots)) for io in system.ios
              if ros is not None and ros.io == READ_WRITE]
    pids = [(io.name, tuple((pid.arm, pid.robot) for pid in io.pids)) for io in system.ios
            if ros is not None and ros.pid == READ_WRITE]
    return [
        *(Addressee(name, "io", parts=parts, prefix=f"IO/{name}") for name, parts in robots),
        *(Addressee(name, "pid", parts=parts, prefix="PID") for name, parts in pids),
        *(Addressee(row.name, "arm", row.type) for row in system.arms),
        *(Addressee(row.name, "suj", parts=tuple((arm.name, arm.name) for arm in row.arms)) for row in system.carts),
        *(Addressee(row.name, "teleop", "PSM") for row in system.teleop_psms),
        *(Addressee(row.name, "teleop", "ECM") for row in system.teleop_ecms),
        *(Addressee(row.name, kind) for kind, rows in (("console", system.consoles), ("focus", system.focuses))
          for row in rows),
        *(Addressee(row.name, row.kind) for row in system.processes if row.kind == "system"),
    ]


class RosLoop(UserLoop):
    """See above."""

    def setup(self) -> None:
        """Join the domain, and create all endpoints that ROS discovery looks for."""
        ACTING.origin = None  # commands over ROS count as a person's, as at the command line
        document = self.node.document
        row = document.ros
        if row is None:
            raise ValueError(f"{self.system} has no ROS bridge")
        self._day_ns = local_ns() - monotonic_ns()
        self.participant = participant = Participant(row.domain, row.interface, self.name, f"/{row.namespace}")
        self._stamps = Stamps(self.time.simulated)
        self._rosout = participant.writer("/rosout", Log, EVENT_DEPTH)
        self.records: list[RecordTopics] = []
        self.events: dict[str, EventTopics] = {}
        self._entries = {entry.name: entry for entry in catalogue(self.system)}
        asked = addressees(document)
        self._publish_all(ShownTopics(document, row))
        arms = [each for each in asked if each.kind == "arm"]
        refusals = Refusals(self._refused, self.time.now_ns)
        self._last_look = LastLook(self.node.faults().generation)
        self._incoming = Commands(participant, self.system, asked, row, refusals, cache(self._joints), self._last_look,
                                  self._refuse_move)
        states = {arm.name: partial(self._state_of, arm.name) for arm in arms}
        replier = Replier(row.domain, row.interface)
        self.services = Services(participant, replier, self.system, arms, states, refusals, self.time.now_ns)
        for part in (self._incoming, self.services):
            self.node.hold(part)
        self._clock = participant.writer("/clock", Clock) if self.time.simulated else None
        self._throttled = [Throttle(IDLE_NS, Descriptions(participant, document.arms, self._reads).step)]
        if row.tf:
            frames = TipFrames(participant, document.arms, self._reads, self._stamps)
            self._throttled.append(Throttle(FRAMES_NS, frames.step))
        if row.stats:
            pages = {each.name: self.node.hold(ControlPage(self.system, each.name)) for each in document.processes}
            self._throttled.append(Throttle(STATISTICS_NS, LoopStatistics(participant, pages, self._stamps).step))
        self._awake_ns, self._deaf_until_ns, self._forgets_all = boottime_ns(), 0, False
        self._idle_until_ns = 0
        participant.announce(*replier.gids())

    def _reads(self, instance: str, ring: str) -> RingReader:
        """Released with our place; reading does not subscribe, so on-demand processes do not start."""
        return self.node.hold(directory.reader(self.system, instance, ring))

    def _joints(self, view: str) -> JointNames:
        entry = self._entries[view]
        return JointNames(OpenTopic(self.system, entry, self._reads(entry.instance, entry.ring)))

    def _publish_all(self, shown: ShownTopics) -> None:
        demand = self.node.hold(Wanted(self.system, "ros_bridge"))
        rings: dict[tuple[str, str], list[TopicEntry]] = {}
        for entry in self._entries.values():
            if not entry.problem or entry.kind != RECORD:
                rings.setdefault((entry.instance, entry.ring), []).append(entry)
        reporting = {instance for instance, ring in rings if ring == "events"}
        for (instance, ring), entries in rings.items():
            entries = [shown.as_view(entry) for entry in entries]
            if ring == "events":
                found = [entry.event for entry in entries if entry.kind == EVENT]
                repeats = reporting - {instance} if shown.kinds.get(instance) == "system" else ()
                self.events[instance] = EventTopics(self.participant, instance, shown, self._reads(instance, ring),
                                                    found, self._rosout.write, repeats)
                continue
            views = [(entry, name) for entry in entries if entry.kind in VIEW_MESSAGES for name in shown.views(entry)]
            fields = shown.fields(instance, ring)
            if views or fields:
                self.records.append(RecordTopics(self.participant, demand, instance, self._reads(instance, ring),
                                                 views, fields))
        self._begin_states()

    def _begin_states(self) -> None:
        """The operating states there are before anything happens."""
        for instance, events in self.events.items():
            if events.state is not None and (row := state_as_event(self.system, self._entries[f"{instance}/state"])):
                events.begin(row["state"], row["is_homed"], row["is_busy"])

    def _state_of(self, arm: str) -> OperatingState:
        told = self.events[arm].state
        return told.message if told is not None else OperatingState()

    def _refused(self, to: str, text: str, has_remedy: bool) -> None:
        """Report a refusal as ours, which /rosout repeats, and on the topic of the instance that it was for."""
        self.node.events.report(codes.ROS_REFUSED, text, self.name, has_remedy=has_remedy)
        if to in self.events:
            self.events[to].refuse(text)

    def _refuse_move(self, to: str) -> None:
        if to in self.events:
            self.events[to].refuse_move()

    def _rest(self, left_ns: int, looks: bool) -> None:
        """Execute ROS requests at once.

        A stall is checked after taking the messages and before each one: some may have arrived during the stall.
        """
        came = self.participant.wait(min(left_ns, round(self.node.row.period_s * 1e9)))
        if boottime_ns() >= self._deaf_until_ns:
            self._last_look.look()
        for wish in self._incoming.take() if came else ():
            (wish.leave_out if self._leaves_out(wish.is_of_stream) else wish.carry_out)()
        self._leaves_out(False)
        self._incoming.hear()
        self.services.take(boottime_ns())
        self.services.hear()

    def _leaves_out(self, is_of_stream: bool) -> bool:
        """After a stall, drop messages received meanwhile: stream goals after a short one, all after a long one.

        DDS must first deliver them from the network: for a moment all messages are dropped. The node looks for stalls
        (`Pauses`) only once a period, after the messages of that period; a message that waited must not reach an arm,
        so the bridge looks before each one. The clock is read once: a stall between two readings would be missed.
        """
        now = boottime_ns()
        before, self._awake_ns = self._awake_ns, now
        if now - before > STREAM_NS:
            self._deaf_until_ns = now + DEAF_NS
        if now - before > self.node.late_s * 1e9:
            self._forgets_all = True
            self.node.events.report(codes.HELD_UP, f"{self.name} stalled for {duration(now - before)}; messages "
                                   "received meanwhile were dropped", self.name, value=(now - before) * 1e-9,
                                   limit=self.node.late_s)
        if now >= self._deaf_until_ns:
            self._forgets_all = False
            return False
        return is_of_stream or self._forgets_all

    def _look_at_clock(self) -> None:
        """End when the time of day has been set back: the next bridge joins the domain again.

        The threads of Cyclone DDS wait by the time of day (see Arrivals). They would be late by the step: nodes that
        start would not find the bridge, others would lose it.
        """
        day_ns = local_ns() - monotonic_ns()
        back_ns, self._day_ns = self._day_ns - day_ns, day_ns
        if back_ns > self.node.late_s * 1e9:
            raise SetupError(f"the time of day was set back by {duration(back_ns)}; the bridge joins ROS again")

    def update(self) -> None:
        """Publish everything. Without readers, publish only the data for late subscribers, and less often.

        A new reader is served in the same period: clients request values as soon as they are connected.
        """
        now, stamps = self.time.now_ns(), self._stamps
        self._look_at_clock()
        if self.participant.look():
            for record in self.records:
                record.look()
        if now < self._idle_until_ns and not self.participant.is_read:
            return
        self._idle_until_ns = now + IDLE_NS
        stamps.look()
        if self._clock is not None:
            self._clock.write(Clock(time_of(now)))
        for each in self._throttled:
            each.step(now)
        for events in self.events.values():
            events.step(stamps, now)
        for record in self.records:
            record.step(stamps)

    def quit(self) -> None:
        """Leave the domain."""
        if hasattr(self, "participant"):
            self.participant.close()


def main() -> None:
    """Run it to its end."""
    runtime.run("ros_bridge", RosLoop)


if __name__ == "__main__":
    main()
