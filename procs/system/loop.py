"""The process of the whole system: power and homing of all arms, everybody's messages in one place, sounds."""

from __future__ import annotations

from procs import codes, runtime
from procs.system.arms import arms_of
from procs.system.commands import SystemCommands
from procs.system.message_hub import MessageHub, MessageSource
from procs.system.record import SystemRecord
from procs.system.sound import Sound
from shm.clock import monotonic_ns
from shm.faults import NoFaults


def sources(me: runtime.Node) -> list[MessageSource]:
    """The events of all others, the supervisor's too, from now on."""
    found = []
    for name in ("supervisor", *(row.name for row in me.document.processes)):
        if name != me.name:
            ring = me.reads(name, "events")
            ring.newest()
            found.append(MessageSource(name, ring))
    return found


class SystemLoop(runtime.Loop):
    """The whole system, as one process sees it."""

    def __init__(self, me: runtime.Node) -> None:
        super().__init__(me)
        self._state, self._arms, self._sound = me.writes("state"), arms_of(me), Sound()
        consoles = [me.commands(row.name) for row in me.document.consoles]
        self._commands = SystemCommands(self._arms, consoles, me.events, self._sound, me.document.audio_volume)
        self._centre = MessageHub(sources(me), me.events, self._commands.beep)
        self._record = SystemRecord(self._state.field, self._arms, me.events, self._sound,
                                    calibration_mode=any(io.calibration_mode for io in me.document.ios))
        if self._sound.lacks:
            me.events.status(f"system: {self._sound.lacks}; it is silent where these are missing", me.name)
        self._mailbox = me.mailbox(NoFaults())  # arms themselves know what their faults make void

    def wait(self) -> bool:
        """See runtime.Loop."""
        return self.me.tick(news=self._has_news)

    def _has_news(self) -> bool:
        return self._mailbox.has_news

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        """See runtime.Loop."""
        for arm in self._arms:
            arm.look(now_ns)
        self._commands.execute(self._mailbox.drain(wall_ns), now_ns)
        self._centre.step(now_ns)
        if trouble := self._sound.step(monotonic_ns()):
            self.me.events.report(codes.SOUND_FAILED, trouble, self.me.name)
        self._record.fill(self._commands, self._centre)
        self._state.publish(now_ns)

    def close(self) -> None:
        """End what is heard."""
        self._sound.close()


def main() -> None:
    """Run until asked to stop; arms stay as they are."""
    runtime.run("system", SystemLoop)


if __name__ == "__main__":
    main()
