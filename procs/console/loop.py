"""The process of a console: pedals and presence in, orders to its tele-operations out."""

from __future__ import annotations

from functools import partial

from procs import runtime
from procs.console.commands import Commands
from procs.console.desk import Mailboxes
from procs.console.goovis import Goovis
from procs.console.inputs import Inputs
from procs.console.logic import Logic
from procs.console.record import Record, go_on
from procs.console.selection import members_of
from procs.lib.document import System, TeleopPsm


def first_scale(system: System, console: str) -> float:
    """The scale its tele-operations begin with: that of its first PSM one."""
    rows = [system.teleop(name) for name in system.console(console).teleops]
    return next((row.scale for row in sorted(rows, key=lambda row: not isinstance(row, TeleopPsm))), 0.2)


def main() -> None:
    """Run one console until asked to stop; its tele-operations then stop following by themselves."""
    with runtime.process("console") as me:
        row, members = me.document.console(me.name), members_of(me.document)
        state = me.writes("state")
        desk = Mailboxes(me, members)
        logic = Logic(me.name, members, desk, first_scale(me.document, me.name))
        began_anew = go_on(me.reads(me.name, "state"), logic)
        warn = partial(me.events.warning, "head-sensor", component=me.name)
        head = Goovis(row.head, warn) if row.head is not None else None
        inputs = Inputs(row, me.document, me.reads, head, began_anew=began_anew)
        if row.turn_off is not None:
            me.commands(row.turn_off.io).send("set_output", (0.0,), row.turn_off.name)
        record, commands = Record(state.field, row, logic), Commands(logic)
        mailbox = me.mailbox()
        mailbox.refuse_waiting(f"{me.name} has just started; ask again")
        me.ready()
        while me.tick(news=lambda: inputs.has_news or mailbox.has_news):
            for button, kind in inputs.poll(me.now_ns):
                logic.press(button, kind)
            if not inputs.valid:
                logic.lost_sight()
            desk.listen(logic, me.now_ns)
            commands.execute(mailbox.drain(me.wall_ns), me.now_ns)
            logic.step(me.now_ns)
            record.fill(inputs)
            state.publish(me.now_ns)


if __name__ == "__main__":
    main()
