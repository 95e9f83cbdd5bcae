"""An arm's process, once a cycle: io's newest record and commands in, setpoints and the arm's state out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.arm.context import ArmContext, ToolReading
from trocar.procs.arm.effort_limits import motor_efforts
from trocar.procs.arm.other_arm import OtherArm
from trocar.procs.arm.setup_base import SetupBase, place_of
from trocar.procs.document.system import ArmConfig, IoConfig, RecordPlace
from trocar.procs.native.library import native
from trocar.procs.node import runtime
from trocar.procs.node.inputs import SETUP_LATE_S
from trocar.procs.node.io_faults import fault_reports, io_stalls, power_reports
from trocar.procs.node.node import Node
from trocar.procs.tables import codes
from trocar.procs.tables.arm_types import ARM_TYPES, class_of
from trocar.procs.tables.manifest import proc, rest_periods
from trocar.procs.user.classes import class_named
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.subscriptions import EVERY

BEHIND_IO_NS = 40_000  # io's record is published by then
AT_REST = 100  # cycles without motion
PERIODS_OVERLOADED = 2
WARN_EVERY_NS = 60_000_000_000


class LastGood:
    """io's newest whole record. A failed read keeps the last one, which then ages: its positions are those of the
    robot, unlike a torn record's.
    """

    def __init__(self, ring: RingReader) -> None:
        """`ring` is io's; its content is used only after it was read whole."""
        self._ring, self._source = ring, ring.record
        kept = bytearray(len(ring.record))
        self._kept, self._record = memoryview(kept), np.frombuffer(kept, dtype=ring.dtype, count=1)
        self.stamp_ns = 0

    @property
    def epoch(self) -> int:
        """Epoch of the ring: counts io's starts."""
        return self._ring.epoch

    def field(self, name: str) -> NDArray[Any]:
        """A view of a field; resolve before the loop."""
        return self._record[name].reshape(self._record[name].shape[1:])

    def take(self) -> None:
        """Read the newest record, if it is whole."""
        if self._ring.newest():
            self._kept[:] = self._source
            self.stamp_ns = self._ring.stamp_ns


def readings(ring: RingReader, io: IoConfig, reader: str) -> Callable[[], ToolReading]:
    """io's last reading of the instruments that its `reader` reads; its ring publishes every reading."""
    names = [row.name for row in io.instrument_readers]
    if reader not in names:
        return ToolReading
    place = names.index(reader)
    status, tool, since = ring.field("status"), ring.field("tool"), ring.field("since_ns")
    last = ToolReading()

    def newest() -> ToolReading:
        nonlocal last
        if ring.newest():
            last = ToolReading(status[place].decode(), tool[place].decode(), int(since[place]))
        return last

    return newest


def place_in(io: IoConfig, arm: ArmConfig) -> RecordPlace:
    """The place of the arm's robot in io; ValueError if there is none, or it has another number of actuators."""
    axes = ARM_TYPES[arm.type].actuators
    try:
        place = io.place(arm.robot)
    except KeyError:
        raise ValueError(f"{arm.name}: {io.name} has no robot {arm.robot}") from None
    if len(place.robot.actuators) != axes:
        raise ValueError(f"{arm.name}: {arm.robot} has {len(place.robot.actuators)} actuators; a {arm.type}: {axes}")
    return place


def gripper_in(io: IoConfig, arm: ArmConfig) -> int:
    """The axis of a master's gripper in io's record, -1: none."""
    return next((place.axes.start for place in io.places if place.robot.name == arm.gripper and place.robot.actuators),
                -1)


def setup_base(node: Node, arm: ArmConfig) -> SetupBase | None:
    """The base frame from the setup joints that carry the arm; None: the arm is not on setup joints."""
    if not arm.base_from:
        return None
    record = node.input(arm.base_from, late_s=SETUP_LATE_S)
    return SetupBase(record, place_of(record.ring.info, arm.base_setup))


def logic_of(arm: ArmConfig) -> type[ArmLogic]:
    """The class of this arm: that of its type, or a user's class derived from it."""
    of_type = class_of(ARM_TYPES[arm.type].process, ArmLogic)
    return class_named(arm.derived, of_type, f"Derived{arm.type.title()}") if arm.derived else of_type


def most_periods(period_s: float) -> int:
    """The largest number of periods that a cycle of an arm may last without a timeout in other processes."""
    return max(1, int(0.5 * proc("arm").late_s / period_s))


class ArmLoop(runtime.Loop):
    """One arm with its rings and mailbox."""

    def setup(self) -> None:
        node = self.node
        node.computes(native().why)
        arm = node.document.arm(node.name)
        if arm.type not in ARM_TYPES:
            raise ValueError(f"{arm.name}: unknown arm type {arm.type}; allowed: {', '.join(ARM_TYPES)}")
        io = node.document.io(arm.io)
        place = place_in(io, arm)
        self._io = LastGood(node.reads(arm.io, "state"))
        self._setpoint, self._state, self._walls = (node.writes(name) for name in ("setpoint", "state", "walls"))
        faults, events = node.fault_cell(), node.reads(arm.io, "events")
        self._mailbox = node.mailbox(faults)
        self._other_ios: dict[str, LastGood] = {}
        """Of arms that this arm's walls move with."""
        self.arm = logic_of(arm)(arm, ArmContext(
            self._io.field, place.row, place.axes.start, {row.name: i for i, row in enumerate(io.digital_inputs)},
            bool(place.robot.brakes), node.commands(arm.io), self._state.field, self._setpoint.field,
            node.events, fault_reports(lambda: self._io.stamp_ns, events, arm.robot),
            power_report=power_reports(self._io.field, io, place), io_stall=io_stalls(events, arm.io),
            gripper=gripper_in(io, arm), setup_base=setup_base(node, arm), motors=motor_efforts(place.robot),
            reading=readings(node.reads(arm.io, "instruments"), io, arm.instrument_reader),
            stall=node.stall, simulated=node.simulated, walls=self._walls.field, faults=faults,
            other=self._other_arm))
        self.written = self._io.field("write_ns")
        """When io last wrote its boards, ns."""
        node.follows(arm.io)
        self._resting = self._seen = 0
        self._reported = events
        self._events, self._name, self._warn_ns = node.events, node.name, 0
        self._overloaded = min(PERIODS_OVERLOADED, most_periods(node.row.period_s))
        self.rest_periods = rest_periods(node.row, io.setpoint_timeout_s)
        self._subscriptions, bits = node.subscriptions, node.subscriptions.bits
        self._parts = ((bits("state", "wrench"), Cartesian.WRENCHES),
                       (bits("state", "spatial_jacobian"), Cartesian.SPATIAL))
        self._show_wanted()

    def _other_arm(self, name: str) -> OtherArm:
        """Another arm, see ArmContext."""
        node = self.node
        arm = next((row for row in node.document.arms if row.name == name), None)
        if arm is None or not ARM_TYPES[arm.type].has_remote_centre:
            raise ValueError(f"no PSM or ECM {name}")
        own, io = node.document.arm(node.name).io, node.document.io(arm.io)
        if arm.io != own and arm.io not in self._other_ios:
            self._other_ios[arm.io] = LastGood(node.reads(arm.io, "state"))
        place = place_in(io, arm)
        return OtherArm(arm, node.input(name), self._io if arm.io == own else self._other_ios[arm.io], place.row,
                        place.axes.start, setup_base(node, arm))

    def _show_wanted(self) -> None:
        """Compute on demand the values that some process wants."""
        wanted = self._subscriptions.wanted
        self.arm.control.cartesian.want(sum(part for bit, part in self._parts if wanted & bit))

    @property
    def may_rest(self) -> bool:
        """The arm has been off or held for a while, and no reader wants every record.

        In simulated time, readers have no influence: a run with the same commands is the same.
        """
        return self._resting > AT_REST and (self.node.simulated or not self._subscriptions.wanted & EVERY)

    def periods(self, is_overloaded: bool, now_ns: int) -> int:
        """Periods of the next cycle of an arm that does not rest: two, with a warning, on an overloaded machine.

        An arm that skips deadlines takes time from other processes, and Linux stops arms for 50 ms if they leave no
        time at all: half as many cycles, evenly spaced, are better.
        """
        if not is_overloaded:
            return 1
        periods = self._overloaded
        if periods > 1 and now_ns >= self._warn_ns:
            self._events.report(codes.CPU_OVERLOAD, f"{self._name}: the machine is overloaded: one cycle in {periods}")
            self._warn_ns = now_ns + WARN_EVERY_NS
        return periods

    def tick(self) -> bool:
        node = self.node
        return super().tick() if self.may_rest else node.tick(periods=self.periods(node.is_overloaded, node.now_ns))

    def has_news(self) -> bool:
        return self._mailbox.has_news or self._reported.head != self._seen

    def update(self) -> None:
        """io's newest record and the commands in, the setpoints and the arm's state out."""
        io, node = self._io, self.node
        now_ns = node.now_ns
        if (head := self._reported.head) != self._seen:  # io publishes the record that shows a fault after its report
            self._seen, self._resting = head, 0
        io.take()
        for other in self._other_ios.values():
            other.take()
        if self._subscriptions.look():
            self._show_wanted()
        self.arm.step(now_ns, io.stamp_ns, io.epoch, self._mailbox.drain(node.wall_ns))
        self._resting = self._resting + 1 if self.arm.at_rest else 0
        self._setpoint.publish(now_ns)
        self._state.publish(now_ns)
        walls = self.arm.control.walls
        if walls.show(self.arm.control.here, now_ns):
            self._walls.publish(now_ns)
            walls.answer()
        node.follow(int(self.written), BEHIND_IO_NS)


def main() -> None:
    """Run one arm until stopped; io then holds its robot."""
    runtime.run("arm", ArmLoop)


if __name__ == "__main__":
    main()
