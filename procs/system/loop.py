"""The process of the whole system: power and homing of all arms, everybody's messages in one place, sounds."""

from __future__ import annotations

import contextlib

from procs import runtime
from procs.system.arms import arms_of
from procs.system.centre import Centre, Source
from procs.system.commands import Commands
from procs.system.record import Record
from procs.system.sound import Sound
from shm import directory
from shm.clock import monotonic_ns


def sources(me: runtime.Me) -> list[Source]:
    """The events of all others, the supervisor's too, from now on."""
    found = []
    for name, kind in (("supervisor", "supervisor"), *((row.name, row.kind) for row in me.document.processes)):
        if name != me.name:
            ring = directory.reader(me.system, name, "events", kind)
            ring.newest()
            found.append(Source(name, ring))
    return found


def main() -> None:
    """Run until asked to stop; arms stay as they are."""
    with runtime.process("system") as me, contextlib.ExitStack() as held:
        state, arms, sound = me.writes("state"), arms_of(me), Sound()
        held.callback(sound.close)
        consoles = [me.commands(row.name) for row in me.document.processes if row.kind == "console"]
        commands = Commands(arms, consoles, me.events, sound, me.document.audio_volume)
        centre = Centre(sources(me), me.events, commands.beep)
        record = Record(state.field, arms, me.events, sound,
                        calibration_mode=any(io.calibration_mode for io in me.document.ios))
        if sound.lacks:
            me.events.status(f"system: {sound.lacks}; it is silent where these are missing", me.name)
        mailbox = me.mailbox()
        mailbox.refuse_waiting(f"{me.name} has just started; ask again")
        me.ready()
        while me.tick(news=lambda: mailbox.has_news):
            for arm in arms:
                arm.look(me.now_ns)
            commands.execute(mailbox.drain(me.wall_ns), me.now_ns)
            centre.step(me.now_ns)
            if trouble := sound.step(monotonic_ns()):
                me.events.warning("sound", trouble, me.name)
            record.fill(commands, centre)
            state.publish(me.now_ns)


if __name__ == "__main__":
    main()
