"""Receivers of a console's messages: teleoperations, other consoles and the system by mailbox, people by events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.console.logic import Logic
from trocar.procs.console.selection import Selectable
from trocar.procs.node.debounce import NAMES
from trocar.procs.node.node import Node
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import Code
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin
from trocar.shm.ring.ring import RingReader

DISABLED: Final = b"DISABLED"
PAYLOADS: Final = (0.0, 1.0, 2.0)  # of button events, as io has them: pressed, released, clicked


class Mailboxes:
    """The desk of `trocar.procs.console.logic` on shared memory."""

    def __init__(self, node: Node, members: Sequence[Selectable]) -> None:
        """Takes a place in every mailbox that is needed; `members` are the teleoperations of all consoles."""
        running = {row.name for row in node.document.processes}
        self._node = node
        mine = [member.name for member in members if member.console == node.name and member.name in running]
        self._teleops = {name: node.commands(name) for name in mine}
        self._states = {name: node.reads(name, "state") for name in mine}
        self._epochs = {name: ring.epoch for name, ring in self._states.items()}
        self._desired = {name: ring.field("desired_state") for name, ring in self._states.items()}
        self._homes = {member.name: member.console for member in members if member.console in running - {node.name}}
        others = dict.fromkeys(self._homes.values())
        self._consoles = {name: node.commands(name) for name in others}
        self._others = [(node.reads(name, "state"), [m.name for m in members if m.console == name]) for name in others]
        self._system = node.commands("system") if "system" in running else None
        self._under_way: dict[tuple[str, int], str] = {}
        self._reported: dict[str, str] = {}

    # -- requests of the logic -----------------------------------------------------------------------------------------

    def ask(self, teleop: str, command: str, values: Sequence[float] = (), text: str = "",
            origin: Origin = NO_ORIGIN) -> bool:
        """Send a command to a teleoperation, on behalf of a person; false: not delivered."""
        client = self._teleops.get(teleop)
        if client is not None:
            client.on_behalf(origin)
        number = _send(client, command, values, text)
        if number and command == "state_command":
            self._under_way[teleop, number] = text
        return bool(number)

    def free(self, teleop: str) -> None:
        """Request that another console unselects a teleoperation of its own."""
        _send(self._consoles.get(self._homes.get(teleop, "")), "unselect_teleop", (), teleop)

    def emit(self, event: str, text: str = "", component: str = "", value: float = 0.0) -> None:
        """An event."""
        self._node.events.emit(event, text, component=component, value=value)

    def button(self, name: str, kind: int) -> None:
        """A button event."""
        self._node.events.emit("button", NAMES[kind], code=NAMES[kind], component=name, value=PAYLOADS[kind])

    def status(self, text: str) -> None:
        """Information for people."""
        self._node.events.status(text, self._node.name)

    def report(self, code: Code, text: str) -> None:
        """A warning for people."""
        self._node.events.report(code, text, self._node.name)

    def beep(self, duration_s: float, frequency_hz: float) -> None:
        """A sound, at the system's volume."""
        _send(self._system, "beep", (duration_s, frequency_hz), "")

    @property
    def is_idle(self) -> bool:
        """Whether all its teleoperations are DISABLED, as far as they have shown."""
        return all(desired.item() == DISABLED for desired in self._desired.values())

    # -- replies -------------------------------------------------------------------------------------------------------

    def listen(self, logic: Logic, now_ns: int) -> None:
        """Refusals, restarted teleoperations, and the selections of other consoles."""
        for teleop, client in self._teleops.items():
            for reply in client.poll():
                word = self._under_way.pop((teleop, reply.id), "")
                if word and reply.outcome == "refused" and logic.asked[teleop] == word:
                    logic.refused(teleop, now_ns)
                if reply.outcome == "refused":
                    self._complain(teleop, reply.text)
            epoch = self._states[teleop].epoch
            if epoch != self._epochs[teleop]:
                self._epochs[teleop] = epoch
                self.status(f"{teleop} was restarted: it follows when the operator has left and returned")
                logic.began_anew(teleop)
            elif self._states[teleop].newest():
                logic.shows(teleop, self._desired[teleop].item().decode())
        for clients in (self._consoles.values(), [self._system] if self._system else []):
            for client in clients:
                client.poll()
        if self._others:
            logic.elsewhere = {name for ring, names in self._others for name in _selected(ring, names)}

    def _complain(self, teleop: str, reason: str) -> None:
        if self._reported.get(teleop) != reason:
            self._reported[teleop] = reason
            self._node.events.report(codes.TELEOP_REFUSED, f"{teleop} refuses: {reason}", teleop)


def _send(client: LoopClient | None, command: str, values: Sequence[float], text: str) -> int:
    """The number of the command; 0 if it is not accepted."""
    return client.send(command, values, text) if client is not None else 0


def _selected(ring: RingReader, names: Sequence[str]) -> list[str]:
    if not ring.newest():
        return []
    return [name for name, on in zip(names, ring.field("selected"), strict=False) if on]
