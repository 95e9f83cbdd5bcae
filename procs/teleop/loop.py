"""The process of one teleoperation: records of its arms and the console in, commands to the arms out, once a cycle."""

from __future__ import annotations

from typing import Final

from trocar.procs.document.system import TeleopPsmConfig as PsmRow
from trocar.procs.node import runtime
from trocar.procs.teleop.arms import BaseFrame, Operator, TeleopArm
from trocar.procs.teleop.ecm import TeleopEcm
from trocar.procs.teleop.psm import JawRange, TeleopPsm
from trocar.procs.teleop.record import TeleopRecord
from trocar.procs.teleop.teleop import Teleop
from trocar.procs.teleop.third_party import ThirdPartyArm
from trocar.shm.mailbox.generations import Cell, Watched
from trocar.shm.ring.ring import RingWriter

BEHIND_MASTER_NS: Final = 190_000  # its record is published by then

IDLE_PERIODS: Final = 10  # while DISABLED it runs a hundred times a second, and at each command


def jaw_range(node: runtime.Node, psm: str) -> JawRange:
    """The jaw limits of the instruments that the arm may carry."""
    arms = [arm for arm in node.document.arms if arm.name == psm]  # none: a third-party program
    tools = [tool for arm in arms for tool in (*arm.tools, arm.tool) if tool is not None]
    return {tool.name: (tool.jaw.lower, tool.jaw.upper) for tool in tools}.get


def base_frame(node: runtime.Node, row: PsmRow) -> BaseFrame | None:
    """The arm, or the setup arm, that carries the slave, if the file names one."""
    name, setup = row.base_frame_from, row.base_frame_interface
    if not name:
        return None
    record = node.input(name)
    if not any(cart.name == name for cart in node.document.carts):
        return BaseFrame(name, record)
    return BaseFrame(f"{name}/{setup}", record, list(record.ring.info["setups"]).index(setup))


def build(node: runtime.Node, record: RingWriter, faults: Cell) -> Teleop:
    """The teleoperation of this process, on `record`; `faults`: those of its arms."""
    row = node.document.teleop(node.name)
    there = row.console in {process.name for process in node.document.processes}
    operator = Operator(row.console, node.input(row.console) if there else None)

    def arm(name: str, *, is_master: bool = False) -> TeleopArm:
        ends = node.input(name), node.reads(name, "events"), node.commands(name)
        if any(row.name == name for row in node.document.third_parties):
            return ThirdPartyArm(name, *ends)
        return TeleopArm(name, *ends, is_master=is_master)

    if isinstance(row, PsmRow):
        own = TeleopRecord(record.field, "PSM", (row.mtm,), row.psm, row.console)
        return TeleopPsm(row, arm(row.mtm, is_master=True), arm(row.psm), operator, own, node.events,
                         jaw_range(node, row.psm), base_frame(node, row), faults=faults)
    own = TeleopRecord(record.field, "ECM", (row.mtml, row.mtmr), row.ecm, row.console)
    masters = arm(row.mtml, is_master=True), arm(row.mtmr, is_master=True)
    return TeleopEcm(row, *masters, arm(row.ecm), operator, own, node.events, faults=faults)


class TeleopLoop(runtime.Loop):
    """One teleoperation with its rings and mailbox."""

    def __init__(self, node: runtime.Node) -> None:
        super().__init__(node)
        self._state = node.writes("state")
        row = node.document.teleop(node.name)
        faults = Watched(node.faults(), row.arms)
        self.teleop = build(node, self._state, faults)
        self._master = self.teleop.arms[0]
        if self._master.sets_pace:
            node.follows(self._master.name)
        self._mailbox = node.mailbox(faults)

    def wait(self) -> bool:
        return self.node.tick(news=self._has_news, periods=IDLE_PERIODS) if self.teleop.is_idle else self.node.tick()

    def _has_news(self) -> bool:
        return self._mailbox.has_news

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        self.teleop.step(now_ns, self._mailbox.drain(wall_ns))
        self._state.publish(now_ns)
        node, master = self.node, self._master
        if master.whole and master.sets_pace:
            node.follow(master.stamp_ns, BEHIND_MASTER_NS)
            if self.teleop.following:
                node.latency(node.clock.now_ns() - master.stamp_ns)

    def close(self) -> None:
        """End as if the teleoperation were disabled."""
        self.teleop.leave(self.node.now_ns)


def main() -> None:
    """Run one teleoperation until stopped; its slave then holds."""
    runtime.run("teleop", TeleopLoop)


if __name__ == "__main__":
    main()
