"""A client of a service as rmw_cyclonedds makes it: an id stands in front of each request, and of its reply."""

from __future__ import annotations

from functools import cache
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import int64

from tests.system.robot import wait_for
from trocar.procs.ros_bridge.services import Service
from trocar.procs.ros_messages.dds import Participant


@cache
def framed(message: type[IdlStruct]) -> Any:
    """A request or a reply with the id in front: guid, seq, its fields."""
    return make_idl_struct(f"Framed{message.__name__}", str(message.__idl_typename__),
                           {"guid": int64, "seq": int64} | message.__annotations__)


class CycloneClient:
    """Asks one service."""

    def __init__(self, participant: Participant, name: str, service: Service, guid: int = 11) -> None:
        """`name`: as `PSM1/crtk_version`."""
        self._question = framed(service.request)
        self._writer = participant.write_as(f"rq/{name}Request", self._question)
        self._reader = participant.read_as(f"rr/{name}Reply", framed(service.response), 10)
        self.guid, self.seq, self.got = guid, 0, list[Any]()

    def is_served(self) -> bool:
        """Whether there is the service: a reader of requests and a writer of replies."""
        self._writer.look()
        return bool(self._writer.is_read and self._reader.entity.get_subscription_matched_status().current_count)

    def ask(self, **fields: Any) -> None:
        """Send a request."""
        self.seq += 1
        self._writer.write(self._question(guid=self.guid, seq=self.seq, **fields))

    def hears(self) -> bool:
        """Whether the last request has its reply: the last of `got`."""
        self.got += self._reader.take()
        return any((each.guid, each.seq) == (self.guid, self.seq) for each in self.got)

    def answer(self, **fields: Any) -> Any:
        """The reply to a request."""
        wait_for(self.is_served, 30, "the service")
        self.ask(**fields)
        wait_for(self.hears, 30, "a reply")
        return self.got[-1]
