"""Services: requests of ROS clients to an arm, each answered by one of its commands.

They are questions: none powers or moves anything, so each is answered, also after a stall.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final

import numpy as np
from cyclonedds.idl import IdlStruct

from trocar.procs.ros_bridge.carrying_out import Addressee
from trocar.procs.ros_bridge.publishing import ros_topic
from trocar.procs.ros_messages.command_messages import pose_numbers
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.hashes import dds_name, type_hash
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
from trocar.procs.ros_messages.refusals import Refusals
from trocar.procs.ros_messages.replier import Replier, ServiceRequest
from trocar.procs.ros_messages.view_messages import pose_of
from trocar.shm.mailbox.client import Client, MailboxFull
from trocar.shm.memory.segment import SegmentError

WAIT_NS: Final = 1_000_000_000


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


SERVICES: Final = {row.name: row for row in (
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
)}


def announced(message: type[IdlStruct]) -> tuple[str, str]:
    """The DDS type name of a message and the user data of its endpoint."""
    return dds_name(message), f"typehash={type_hash(message)};"


class Services:
    """All services of a system's arms."""

    def __init__(self, participant: Participant, replier: Replier, system: str, arms: Iterable[Addressee],
                 states: Mapping[str, Callable[[], OperatingState]], refusals: Refusals,
                 now_ns: Callable[[], int]) -> None:
        """`states` gives the operating state of each arm."""
        self._states, self._say, self._now_ns, self._replier = states, refusals.say, now_ns, replier
        self._clients: list[Client] = []
        self._asked: dict[str, tuple[Service, Client]] = {}
        """By the name of the service."""
        self._waiting: dict[tuple[Client, int], tuple[Service, ServiceRequest, int]] = {}
        """What was passed on: with the time at which it is given up."""
        for arm in arms:
            client = Client(system, arm.name, "ros_bridge")
            self._clients.append(client)
            for row in SERVICES.values():
                name = participant.full_name(ros_topic(f"{arm.name}/{row.name}"))
                replier.serve(name, announced(row.request), announced(row.response))
                self._asked[name] = row, client

    @property
    def names(self) -> list[str]:
        """Their ROS names."""
        return list(self._asked)

    def take(self, now_ns: int) -> None:
        """Answer what was requested, or pass it on; `now_ns` is real time, of the network."""
        for request in self._replier.step(now_ns):
            service, client = self._asked[request.service.name]
            try:
                question = service.request.deserialize(request.payload)
            except Exception as error:  # of the library: any program may write any data under our names
                self._say(client.instance, f"{request.service.name}: a request that cannot be read: {error}")
                continue
            self._ask(service, client, request, question)

    def hear(self) -> None:
        """Send the answers received."""
        if not self._waiting:
            return
        for client in {client for client, _ in self._waiting}:
            for reply in client.poll():
                if reply.outcome != "accepted" and (waiting := self._waiting.pop((client, reply.id), None)):
                    self._answer(*waiting[:2], reply.outcome == "done", reply.text)
        now = self._now_ns()
        for key in [key for key, (_, _, due_ns) in self._waiting.items() if now >= due_ns]:
            self._answer(*self._waiting.pop(key)[:2], False, f"{key[0].instance} did not answer")

    def _ask(self, service: Service, client: Client, request: ServiceRequest, question: Any) -> None:
        if not service.command:
            state = self._states[client.instance]()
            self._replier.reply(request, TriggerOperatingStateResponse(state).serialize())
            return
        try:
            number = client.send(service.command, np.asarray(service.numbers(question), dtype=np.float64))
        except (MailboxFull, SegmentError, ValueError) as error:
            self._answer(service, request, False, str(error))
            return
        self._waiting[client, number] = service, request, self._now_ns() + WAIT_NS

    def _answer(self, service: Service, request: ServiceRequest, good: bool, text: str) -> None:
        try:
            answer = service.answer(good, text)
        except (ValueError, TypeError) as error:
            answer = service.answer(False, f"{text}: {error}")
        self._replier.reply(request, answer.serialize())

    def close(self) -> None:
        """Release the places in mailboxes, and leave the domain."""
        for client in self._clients:
            client.close()
        self._replier.close()
