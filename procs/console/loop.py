"""The process of a console: pedals and presence in, orders to its teleoperations out."""

from __future__ import annotations

from functools import partial

from trocar.procs.console.console_commands import ConsoleCommands
from trocar.procs.console.goovis import Goovis
from trocar.procs.console.inputs import Inputs
from trocar.procs.console.logic import Logic
from trocar.procs.console.outbox import Mailboxes
from trocar.procs.console.record import ConsoleRecord, go_on
from trocar.procs.console.selection import members_of
from trocar.procs.document.system import SystemConfig, TeleopPsmConfig
from trocar.procs.node import runtime
from trocar.procs.tables.codes import HEAD_SENSOR
from trocar.shm.mailbox.generations import Watched


def first_scale(system: SystemConfig, console: str) -> float:
    """Initial scale of its teleoperations: that of its first PSM one."""
    rows = [system.teleop(name) for name in system.console(console).teleops]
    return next((row.scale for row in sorted(rows, key=lambda row: not isinstance(row, TeleopPsmConfig))), 0.2)


class ConsoleLoop(runtime.Loop):
    """One console with its rings and mailboxes."""

    def setup(self) -> None:
        node = self.node
        row, members = node.document.console(node.name), members_of(node.document)
        self._state = node.writes("state")
        self._desk = Mailboxes(node, members)
        self._logic = logic = Logic(node.name, members, self._desk, first_scale(node.document, node.name))
        began_anew = go_on(node.reads(node.name, "state"), logic)
        warn = partial(node.events.report, HEAD_SENSOR, component=node.name)
        self._head = node.hold(Goovis(row.head, warn)) if row.head is not None else None
        self._inputs = Inputs(row, node.document, node.reads, self._head, began_anew=began_anew)
        if row.turn_off is not None:
            node.commands(row.turn_off.io).send("set_output", (0.0,), row.turn_off.name)
        self._record = ConsoleRecord(self._state.field, row, logic)
        self._commands = ConsoleCommands(logic, has_operator_input=bool(row.operator_present or row.head))
        self._faults = Watched(node.faults(), [arm for member in logic.mine for arm in member.arms])
        self._mailbox = node.mailbox(self._faults)

    def tick(self) -> bool:
        """See runtime.Loop."""
        return self.node.tick(news=self.has_news, periods=self.rest_periods if self.may_rest else 1)

    @property
    def may_rest(self) -> bool:
        """Without a head sensor, which is polled, until a teleoperation is enabled: it needs us every 30 ms."""
        return self._head is None and not self._logic.wanted and self._desk.is_idle

    def has_news(self) -> bool:
        """See runtime.Loop."""
        return self._inputs.has_news or self._mailbox.has_news

    def update(self) -> None:
        """See runtime.Loop."""
        logic, inputs, now_ns = self._logic, self._inputs, self.node.now_ns
        logic.faults_until(self._faults.valid_from)
        for button, kind in inputs.poll(now_ns):
            logic.press(button, kind)
        if not inputs.valid:
            logic.lose_operator("its inputs are silent")
        self._desk.listen(logic, now_ns)
        self._commands.execute(self._mailbox.drain(self.node.wall_ns), now_ns)
        logic.step(now_ns)
        self._record.fill(inputs)
        self._state.publish(now_ns)


def main() -> None:
    """Run one console until stopped; its teleoperations then stop following by themselves."""
    runtime.run("console", ConsoleLoop)


if __name__ == "__main__":
    main()
