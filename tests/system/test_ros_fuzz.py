"""The ROS bridge among clients that send anything: random bytes, spoilt messages, numbers that are none."""

from __future__ import annotations

import math
import random
import socket
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from cyclonedds.idl import IdlStruct

from tests.system.robot import Robot, wait_for
from tests.system.test_ros_bridge import Client, bridged, echo_position
from trocar.procs.ros_bridge.carrying_out import Addressee, topics_of
from trocar.procs.ros_bridge.incoming import CommandTopic
from trocar.procs.ros_messages.messages import Bool, Empty, Float64, JointStates, Joy, WrenchStamped

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
NUMBERS = (math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0)
EFFECTIVE = (Empty, Bool, Float64, Joy, WrenchStamped)
"""Messages of which many a one does what it may do."""
EFFORTS = ("servo_jf", "jaw/servo_jf", "servo_jv")
GAP, DATA, LITTLE = 0x08, 0x15, 0x01


class Liar:
    """Sends bytes of its own for a writer that the bridge knows: datagrams as DDS has them on the wire (RTPS 2.1)."""

    def __init__(self, gid: bytes, ports: list[int]) -> None:
        self._prefix, self._entity, self._ports = gid[:12], gid[12:], ports
        self._count = 0

    def send(self, out: socket.socket, payload: bytes) -> None:
        """The next message; those before it are told to be gone, whether they were lost or not."""
        self._count += 1
        number, unknown = struct.pack("<iI", 0, self._count), bytes(4)
        gap = unknown + self._entity + struct.pack("<iI", 0, 1) + number + struct.pack("<I", 0)
        data = struct.pack("<HH", 0, 16) + unknown + self._entity + number + payload
        datagram = b"RTPS\x02\x01\x01\x10" + self._prefix
        if self._count > 1:
            datagram += struct.pack("<BBH", GAP, LITTLE, len(gap)) + gap
        datagram += struct.pack("<BBH", DATA, LITTLE | 0x04, len(data)) + data
        for port in self._ports:
            out.sendto(datagram, ("127.0.0.1", port))


def fuzzed() -> list[tuple[str, CommandTopic]]:
    arms = [Addressee("PSM1", "arm", "PSM"), Addressee("MTMR", "arm", "MTM"), Addressee("system", "system"),
            Addressee("console", "console")]
    return [(f"{to.name}/{topic}", row) for to in arms for row, topic, _ in topics_of(to)
            if row.taken.message not in EFFECTIVE and topic not in EFFORTS]


def nonsense(kind: Any, chance: random.Random) -> Any:
    """A message in which hardly any part makes sense."""
    made = kind()
    for name, annotation in kind.__annotations__.items():
        what = annotation.__metadata__[0] if hasattr(annotation, "__metadata__") else annotation
        if hasattr(what, "subtype"):
            count = chance.choice((0, 1, 5, 6, 7, 8, 65, 1000))  # as many fill a datagram
            setattr(made, name, [_part(what.subtype, chance) for _ in range(count)])
        else:
            setattr(made, name, _part(what, chance))
    return made


def _part(what: Any, chance: random.Random) -> Any:
    inner = what.__metadata__[0] if hasattr(what, "__metadata__") else what
    if inner is bool:
        return chance.random() < 0.5
    if inner is str:
        return "".join(chance.choices("aä\n\0%{}/~ 😀", k=chance.choice((0, 3, 64, 1000))))
    if isinstance(inner, type) and issubclass(inner, IdlStruct):
        return nonsense(inner, chance)
    return chance.choice(NUMBERS) if str(inner).startswith("float") else chance.randrange(100)


def payload(row: CommandTopic, chance: random.Random) -> bytes:
    """Random bytes, a message with some bytes changed or cut off, or one of nonsense."""
    how = chance.random()
    if how < 0.3:
        return b"\0\1\0\0" + chance.randbytes(4 * chance.randrange(64))
    made = bytearray(nonsense(row.taken.message, chance).serialize()[:8000])
    if how < 0.6:
        for _ in range(chance.randrange(1, 6)):
            made[chance.randrange(len(made))] = chance.choice((0, 0xFF, chance.randrange(256)))
    elif how < 0.7:
        del made[chance.randrange(len(made)) :]
    return bytes(made.ljust(len(made) + 3 & ~3, b"\0"))


def shower(client: Client, ports: list[int], count: int) -> Iterator[int]:
    """Send so many of them, to all topics by turns; gives the number of each hundredth."""
    chance, topics = random.Random(20), fuzzed()
    writers = [client.participant.writer(topic, row.taken.message) for topic, row in topics]
    for writer in writers:
        wait_for(lambda: writer.look() or writer.is_read, 30, f"the bridge to listen to {writer.name}")  # noqa: B023
    liars = [Liar(bytes(writer.gid.data), ports) for writer in writers]
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as out:
        for number in range(count):
            place = number % len(topics)
            liars[place].send(out, payload(topics[place][1], chance))
            if number % 100 == 0:
                yield number


@pytest.mark.parametrize("count", [1000, pytest.param(100_000, marks=pytest.mark.soak)])
def test_no_message_makes_the_bridge_or_the_robot_do_what_it_should_not(
        robot: Robot, tmp_path: Path, count: int) -> None:
    with bridged(robot, tmp_path) as client:
        client.state("DISABLED")
        client.home()
        stood = echo_position(robot)
        pids = {name: robot.pid(name) for name in ("ros_bridge", "PSM1", "MTMR", "console", "system")}
        ports = [each.laddr.port for each in psutil.Process(pids["ros_bridge"]).net_connections("udp")]
        for number in shower(client, ports, count):
            state = client.got["PSM1/operating_state"]
            state.clear()
            client.wait(lambda: len(state) > 0, f"the bridge to go on after {number}")  # noqa: B023 waited for here
            assert state[-1].is_homed
        log = robot.trocar("logs", "ros_bridge", "-n", "100000")
        assert "cannot be read" in log and "PSM1:" in log, "some came that far, and others to the arm"
        assert {name: robot.pid(name) for name in pids} == pids
        assert np.allclose(echo_position(robot), stood, atol=1e-6)
        client.got["PSM1/measured_js"].clear()
        goal = [stood[0] + 0.1, *stood[1:]]
        joints = client.got["PSM1/measured_js"]
        client.insist(lambda: client.tell("PSM1/move_jp", JointStates(position=goal)),
                      lambda: joints and np.allclose(joints[-1].position, goal, atol=1e-6), "a move that makes sense")
