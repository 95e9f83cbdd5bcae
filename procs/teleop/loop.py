"""The process of one teleoperation: records of its arms and the console in, commands to the arms out, once a cycle."""

from __future__ import annotations

from typing import Final

from trocar.procs.document.system import TeleopPsmConfig as PsmRow
from trocar.procs.node import runtime
from trocar.procs.node.node import Node
from trocar.procs.teleop.arms import BaseFrame, Operator, TeleopArm
from trocar.procs.teleop.ecm import TeleopEcm
from trocar.procs.teleop.psm import JawRange, TeleopPsm
from trocar.procs.teleop.record import TeleopRecord
from trocar.procs.teleop.steady import steady_following
from trocar.procs.teleop.teleop import Teleop, TeleopContext
from trocar.procs.teleop.third_party import ThirdPartyArm
from trocar.shm.mailbox.generations import Cell, Watched
from trocar.shm.ring.ring import RingWriter

BEHIND_MASTER_NS: Final = 190_000  # its record is published by then


def jaw_range(node: Node, psm: str) -> JawRange:
    """The jaw limits of the instruments that the arm may carry."""
    arms = [arm for arm in node.document.arms if arm.name == psm]  # none: a third-party program
    tools = [tool for arm in arms for tool in (*arm.tools, arm.tool) if tool is not None]
    return {tool.name: (tool.jaw.lower, tool.jaw.upper) for tool in tools}.get


def base_frame(node: Node, row: PsmRow) -> BaseFrame | None:
    """The arm, or the setup arm, that carries the slave, if the file names one."""
    name, setup = row.base_frame_from, row.base_frame_interface
    if not name:
        return None
    record = node.input(name)
    if not any(cart.name == name for cart in node.document.carts):
        return BaseFrame(name, record)
    return BaseFrame(f"{name}/{setup}", record, list(record.ring.info["setups"]).index(setup))


def build(node: Node, record: RingWriter, faults: Cell) -> Teleop:
    """The teleoperation of this process, on `record`; `faults`: those of its arms."""
    row = node.document.teleop(node.name)
    there = row.console in {process.name for process in node.document.processes}
    operator = Operator(row.console, node.input(row.console) if there else None)

    def arm(name: str, *, is_master: bool = False) -> TeleopArm:
        ends = node.input(name), node.reads(name, "events"), node.commands(name)
        if any(row.name == name for row in node.document.third_parties):
            return ThirdPartyArm(name, *ends)
        return TeleopArm(name, *ends, is_master=is_master)

    def context(kind: str, masters: tuple[str, ...], slave: str) -> TeleopContext:
        own = TeleopRecord(record.field, kind, masters, slave, row.console)
        return TeleopContext(operator, own, node.events, faults)

    if isinstance(row, PsmRow):
        return TeleopPsm(row, arm(row.mtm, is_master=True), arm(row.psm), context("PSM", (row.mtm,), row.psm),
                         jaw_range(node, row.psm), base_frame(node, row))
    masters = arm(row.mtml, is_master=True), arm(row.mtmr, is_master=True)
    return TeleopEcm(row, *masters, arm(row.ecm), context("ECM", (row.mtml, row.mtmr), row.ecm))


class TeleopLoop(runtime.Loop):
    """One teleoperation with its rings and mailbox."""

    def setup(self) -> None:
        node = self.node
        self._state = node.writes("state")
        row = node.document.teleop(node.name)
        faults = Watched(node.faults(), row.arms)
        self.teleop = build(node, self._state, faults)
        self._master = self.teleop.arms[0]
        if self._master.sets_pace:
            node.follows(self._master.name)
        self._mailbox = node.mailbox(faults)
        self._steady = steady_following(self.teleop, lambda: node.pauses.over_ns)

    @property
    def may_rest(self) -> bool:
        return self.teleop.is_idle

    def has_news(self) -> bool:
        return self._mailbox.has_news

    def update(self) -> None:
        steady, now_ns = self._steady, self.node.now_ns
        if steady is not None and not self._mailbox.has_news and steady.go_on(now_ns):
            self._state.publish(now_ns)
            self._keep_pace(steady.master_stamp_ns, is_following=True)
            return
        if steady is not None:
            steady.leave()
        self.teleop.step(now_ns, self._mailbox.drain(self.node.wall_ns))
        self._state.publish(now_ns)
        if steady is not None:
            steady.enter()
        if self._master.whole and self._master.sets_pace:
            self._keep_pace(self._master.stamp_ns, is_following=self.teleop.following)

    def _keep_pace(self, stamp_ns: int, *, is_following: bool) -> None:
        """Stay behind the master's record with this stamp."""
        node = self.node
        node.follow(stamp_ns, BEHIND_MASTER_NS)
        if is_following:
            node.pacing.latency(node.clock.now_ns() - stamp_ns)

    def quit(self) -> None:
        """End as if the teleoperation were disabled."""
        if hasattr(self, "_steady"):
            if self._steady is not None:
                self._steady.leave()
            self.teleop.leave(self.node.now_ns)


def main() -> None:
    """Run one teleoperation until stopped; its slave then holds."""
    runtime.run("teleop", TeleopLoop)


if __name__ == "__main__":
    main()
