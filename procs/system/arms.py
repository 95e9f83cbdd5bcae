"""The arms of a system as their records show them, and the way to ask them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.node.inputs import Input
from trocar.procs.node.runtime import Node
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.origins import Origin

LATE_S: Final = 0.1
ENABLED, FAULT = "ENABLED", "FAULT"


class ArmOnRing:
    """One arm or the setup joints of a cart."""

    def __init__(self, name: str, record: Input, client: LoopClient) -> None:
        """Nothing is known until `look`."""
        self.name = name
        self._record, self._client = record, client
        self._fields = {key: record.field(key) for key in ("state", "is_homed", "is_busy", "reason")}
        self.state, self.is_homed, self.is_busy, self.is_fresh = "", False, False, False
        self.reason = ""
        self.refusals: list[str] = []
        """Of what was asked last."""
        self._asked = 0

    def look(self, now_ns: int) -> None:
        """Take its newest record and its answers."""
        self.is_fresh = self._record.look(now_ns) and self._record.fresh
        if self.is_fresh:
            self.state = self._fields["state"].item().decode()
            self.reason = self._fields["reason"].item().decode(errors="replace")
            self.is_homed, self.is_busy = bool(self._fields["is_homed"]), bool(self._fields["is_busy"])
        self.refusals += [reply.text for reply in self._client.poll()
                          if reply.id == self._asked and reply.outcome in ("refused", "failed")]

    def ask(self, word: str, origin: Origin) -> bool:
        """A state_command, on behalf of whoever asked for it; false: it does not take any."""
        self.refusals.clear()
        self._client.on_behalf(origin)
        self._asked = self._client.send("state_command", (), word)
        return bool(self._asked)


def arms_of(node: Node) -> Sequence[ArmOnRing]:
    """All of the system, in the order in which they start."""
    return [ArmOnRing(row.name, node.input(row.name, late_s=LATE_S), node.commands(row.name))
            for rows in (node.document.arms, node.document.carts) for row in rows]
