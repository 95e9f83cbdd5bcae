"""Commands accepted from ROS: the topics in the command table (shm/commands.py, column `ros`), with their messages.

procs/ros_messages/command_messages.py defines how numbers and text are taken from each kind of message. The owner of
the command checks the numbers; here a message is only unpacked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trocar.procs.ros_messages.command_messages import MESSAGES, CommandMessage
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import CommandRow

STREAM: Final = 1


@dataclass(frozen=True, slots=True)
class CommandTopic:
    """One topic of an instance of this kind, and of arms of these types (none: of all)."""

    kind: str
    topic: str
    row: CommandRow
    taken: CommandMessage

    @property
    def depth(self) -> int:
        """Messages that are kept until they are carried out; where only the newest counts, that one."""
        return STREAM if self.row.ros is not None and self.row.ros.newest else 10


COMMAND_TOPICS: Final = tuple(
    CommandTopic(row.ros.kind or kind, topic, row, MESSAGES[row.ros.message])
    for kind, rows in COMMANDS.items() if kind != "third_party" for row in rows if row.ros is not None
    for topic in row.ros.topics or (row.name,))
