"""Services: requests of ROS clients to an arm, each answered by one of its commands.

ROS 2 does not define how a reply is matched to its request. rmw_cyclonedds puts an id in front of both, which the reply
returns. rmw_fastrtps uses a method that Cyclone DDS lacks: its requests are recognised and not answered; clients with
RMW_IMPLEMENTATION=rmw_cyclonedds_cpp are answered.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from operator import attrgetter
from typing import Any, Final

import numpy as np
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import int64, uint64

from trocar.procs.ros_bridge.carrying_out import Addressee, PendingCommand
from trocar.procs.ros_bridge.incoming import pose_numbers
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_bridge.refusals import Refusals
from trocar.procs.ros_messages.dds import Participant, TopicReader, TopicWriter
from trocar.procs.ros_messages.messages import (
    ConvertFloat64ArrayRequest,
    ConvertFloat64ArrayResponse,
    OperatingState,
    Pose,
    QueryForwardKinematicsRequest,
    QueryForwardKinematicsResponse,
    QueryInverseKinematicsRequest,
    QueryInverseKinematicsResponse,
    TriggerOperatingStateRequest,
    TriggerOperatingStateResponse,
    TriggerRequest,
    TriggerResponse,
)
from trocar.procs.ros_messages.view_messages import pose_of
from trocar.shm.mailbox.client import Client, MailboxFull
from trocar.shm.memory.segment import SegmentError

CYCLONE: Final = b"\x01\x10"
"""Prefix of its participants' keys."""
WAIT_NS: Final = 1_000_000_000
DEPTH: Final = 10
STRANGERS: Final = 1000
"""Number of unanswerable clients remembered; with more, they are notified once more."""


@dataclass(frozen=True, slots=True)
class Service:
    """One question: the command that answers it, its numbers, and the conversion of its reply's text.

    Without a command it is answered at once, from the operating state.
    """

    name: str
    request: type[IdlStruct]
    response: type[IdlStruct]
    numbers: Callable[[Any], Sequence[float]]
    answer: Callable[[bool, str], Any]
    command: str = ""


def _forward(good: bool, text: str) -> QueryForwardKinematicsResponse:
    return QueryForwardKinematicsResponse(pose_of(json.loads(text)) if good else Pose(), good, "" if good else text)


def _inverse(good: bool, text: str) -> QueryInverseKinematicsResponse:
    return QueryInverseKinematicsResponse(json.loads(text) if good else [], good, "" if good else text)


def _converted(good: bool, text: str) -> ConvertFloat64ArrayResponse:
    return ConvertFloat64ArrayResponse(json.loads(text) if good else [])


def _nothing(request: Any) -> Sequence[float]:
    return ()


def _goal(request: QueryInverseKinematicsRequest) -> Sequence[float]:
    return *request.jp, *pose_numbers(request.cp)


SERVICES: Final = (
    Service("crtk_version", TriggerRequest, TriggerResponse, _nothing, TriggerResponse, "crtk_version"),
    Service("operating_state", TriggerOperatingStateRequest, TriggerOperatingStateResponse, _nothing,
            lambda good, text: TriggerOperatingStateResponse()),
    Service("forward_kinematics", QueryForwardKinematicsRequest, QueryForwardKinematicsResponse,
            attrgetter("jp"), _forward, "forward_kinematics"),
    Service("local/forward_kinematics", QueryForwardKinematicsRequest, QueryForwardKinematicsResponse,
            attrgetter("jp"), _forward, "local/forward_kinematics"),
    Service("inverse_kinematics", QueryInverseKinematicsRequest, QueryInverseKinematicsResponse, _goal, _inverse,
            "inverse_kinematics"),
    Service("actuator_to_joint_position", ConvertFloat64ArrayRequest, ConvertFloat64ArrayResponse,
            attrgetter("input"), _converted, "actuator_to_joint_position"),
)


@cache
def framed(message: type[IdlStruct]) -> Any:
    """The class of a question or a reply with the id that rmw_cyclonedds puts in front: guid, seq, its fields."""
    return make_idl_struct(f"Framed{message.__name__}", str(message.__idl_typename__),
                           {"guid": uint64, "seq": int64} | message.__annotations__)


@dataclass(slots=True)
class Waiting:
    """A question that was passed on."""

    server: Server
    guid: int
    seq: int
    due_ns: int


class Server:
    """One service of one arm."""

    def __init__(self, participant: Participant, name: str, service: Service) -> None:
        self.service, self.name, full = service, name, participant.full_name(name)
        told = f"serviceid={'.'.join(f'{byte:x}' for byte in uuid.uuid4().bytes)};"
        self._reply = framed(service.response)
        self.reader: TopicReader[Any] = participant.read_as(f"rq/{full}Request", framed(service.request), DEPTH,
                                                       service.request, told)
        self._writer: TopicWriter[Any] = participant.write_as(f"rr/{full}Reply", self._reply, service.response, told)

    def reply(self, guid: int, seq: int, answer: Any) -> None:
        """Reply to the client."""
        self._writer.write(self._reply(guid=guid, seq=seq, **vars(answer)))


class Services:
    """All services of a system's arms."""

    def __init__(self, participant: Participant, system: str, arms: Iterable[Addressee],
                 states: Mapping[str, Callable[[], OperatingState]], refusals: Refusals,
                 now_ns: Callable[[], int]) -> None:
        """`states` gives the operating state of each arm."""
        self._states, self._say, self._now_ns = states, refusals.say, now_ns
        self._servers: list[tuple[Server, Client]] = []
        self._clients: list[Client] = []
        self._waiting: dict[tuple[Client, int], Waiting] = {}
        self._strangers: set[int] = set()
        for arm in arms:
            client = Client(system, arm.name, "ros_bridge")
            self._clients.append(client)
            self._servers += [(Server(participant, ros_topic(f"{arm.name}/{row.name}"), row), client)
                              for row in SERVICES]

    def take(self) -> list[PendingCommand]:
        """All received requests."""
        return [PendingCommand(False, partial(self._pass_on, server, client, request))
                for server, client in self._servers
                for request in server.reader.take(partial(self._say, client.instance))]

    def hear(self) -> None:
        """Send the answers received."""
        if not self._waiting:
            return
        for client in {client for client, _ in self._waiting}:
            for reply in client.poll():
                if reply.outcome != "accepted" and (waiting := self._waiting.pop((client, reply.id), None)):
                    self._answer(waiting, reply.outcome == "done", reply.text)
        now = self._now_ns()
        for key in [key for key, waiting in self._waiting.items() if now >= waiting.due_ns]:
            self._answer(self._waiting.pop(key), False, f"{key[0].instance} did not answer")

    def _pass_on(self, server: Server, client: Client, request: Any) -> None:
        if self._can_be_answered(server, client.instance, request.sample_info.publication_handle):
            self._ask(server, client, request)

    def _can_be_answered(self, server: Server, of: str, writer: int) -> bool:
        """Whether it is a Cyclone request; others would be read as garbage."""
        if writer in self._strangers:
            return False
        found = server.reader.writer(writer)
        if found is not None and found.participant_key.bytes[:2] == CYCLONE:
            return True
        if len(self._strangers) >= STRANGERS:
            self._strangers.clear()
        self._strangers.add(writer)
        self._say(of, f"{server.name}: a client whose services cannot be answered; start it with "
                  "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp")
        return False

    def _ask(self, server: Server, client: Client, request: Any) -> None:
        service = server.service
        waiting = Waiting(server, request.guid, request.seq, self._now_ns() + WAIT_NS)
        if not service.command:
            state = self._states[client.instance]()
            server.reply(request.guid, request.seq, TriggerOperatingStateResponse(state))
            return
        try:
            number = client.send(service.command, np.asarray(service.numbers(request), dtype=np.float64))
        except (MailboxFull, SegmentError, ValueError) as error:
            self._answer(waiting, False, str(error))
            return
        self._waiting[client, number] = waiting

    def _answer(self, waiting: Waiting, good: bool, text: str) -> None:
        try:
            answer = waiting.server.service.answer(good, text)
        except (ValueError, TypeError) as error:
            answer = waiting.server.service.answer(False, f"{text}: {error}")
        waiting.server.reply(waiting.guid, waiting.seq, answer)

    def close(self) -> None:
        """Release the places in mailboxes."""
        for client in self._clients:
            client.close()
