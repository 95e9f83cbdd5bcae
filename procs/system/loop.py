"""The process of the whole system: power and homing of all arms, messages of all processes in one place, sounds."""

from __future__ import annotations

from trocar.procs.document.system import SystemConfig
from trocar.procs.node import runtime
from trocar.procs.node.node import Node
from trocar.procs.system.bring_up import arms_of
from trocar.procs.system.message_hub import MessageHub, MessageSource
from trocar.procs.system.record import SystemRecord
from trocar.procs.system.sound import Sound
from trocar.procs.system.system_commands import SystemCommands
from trocar.procs.tables import codes
from trocar.shm.mailbox.generations import NoFaults
from trocar.shm.time.clock import monotonic_ns


def sources(node: Node) -> list[MessageSource]:
    """Readers for the events of all other processes and the supervisor, from now on."""
    found = []
    for name in ("supervisor", *(row.name for row in node.document.processes)):
        if name != node.name:
            ring = node.reads(name, "events", counts=False)
            ring.newest()
            found.append(MessageSource(name, ring))
    return found


def drawn(document: SystemConfig) -> list[str]:
    """Arms, and setup arms as SUJ/PSM1, of which pages draw poses."""
    setups = [f"{cart.name}/{arm.name}" for cart in document.carts for arm in cart.arms if arm.chain is not None]
    return [arm.name for arm in document.arms] + setups


class SystemLoop(runtime.Loop):
    """The loop of the process `system`."""

    def setup(self) -> None:
        node = self.node
        self._state, self._arms, self._sound = node.writes("state"), arms_of(node), node.hold(self._take_sound())
        consoles = [node.commands(row.name) for row in node.document.consoles]
        self._commands = SystemCommands(self._arms, consoles, node.events, self._sound, node.document.audio_volume,
                                        drawn(node.document))
        self._centre = MessageHub(sources(node), node.events, self._commands.beep)
        self._record = SystemRecord(self._state.field, self._arms, node.events, self._sound,
                                    calibration_mode=any(io.calibration_mode for io in node.document.ios))
        if self._sound.lacks:
            node.events.status(f"system: {self._sound.lacks}; sounds that need them are not played", node.name)
        self._mailbox = node.mailbox(NoFaults())  # arms themselves discard commands given before their faults

    def _take_sound(self) -> Sound:
        return Sound()

    @property
    def may_rest(self) -> bool:
        """See runtime.Loop."""
        return self._commands.bring_up is None

    def has_news(self) -> bool:
        """See runtime.Loop."""
        return self._mailbox.has_news

    def update(self) -> None:
        """See runtime.Loop."""
        now_ns = self.node.now_ns
        for arm in self._arms:
            arm.look(now_ns)
        self._commands.execute(self._mailbox.drain(self.node.wall_ns), now_ns)
        self._centre.step(now_ns)
        if problem := self._sound.step(monotonic_ns()):
            self.node.events.report(codes.SOUND_FAILED, problem, self.node.name)
        self._record.fill(self._commands, self._centre)
        self._state.publish(now_ns)


def main() -> None:
    """Run until asked to stop; arms stay as they are."""
    runtime.run("system", SystemLoop)


if __name__ == "__main__":
    main()
