"""The ROS bridge beside a robot, seen by another participant; its process: test_ros_streams.py, test_ros_fuzz.py."""

from __future__ import annotations

import atexit
import contextlib
import json
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from cyclonedds.core import DDSException
from cyclonedds.domain import Domain

from tests.ros_bridge.cyclone_client import CycloneClient
from tests.ros_bridge.hosted_bridge import STEP_S, HostedBridge
from tests.system.robot import ROOT, Robot, wait_for
from tests.system.robot_in_host import RobotInHost
from tests.system.test_socket_bridge import COARSE
from trocar.procs.ros_bridge import loop
from trocar.procs.ros_bridge.services import SERVICES
from trocar.procs.ros_messages import dds
from trocar.procs.ros_messages.dds import Participant, TopicReader, TopicWriter
from trocar.procs.ros_messages.messages import (
    Bool,
    Clock,
    Empty,
    Float64,
    JointStates,
    Joy,
    MessageHeader,
    OperatingState,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    String,
    StringStamped,
    TFMessage,
)
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.time.clock import pause, sleeping_by

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
FILE = ROOT / "configs/systems/kinematic-teleop.yaml"
Q = Quaternion(0.0, 0.0, 0.0, 1.0)


class Client:
    """What came, by topic, and what is to go out."""

    def __init__(self, domain: int, robot: Robot | None = None) -> None:
        self.domain, self.participant = domain, Participant(domain, name="client")
        self.robot = robot
        self.readers: dict[str, TopicReader[Any]] = {}
        self.writers: dict[str, TopicWriter[Any]] = {}
        self.got: dict[str, list[Any]] = {}

    def hear(self, topic: str, message: Any) -> None:
        self.readers[topic] = self.participant.reader(topic, message, 100)
        self.got[topic] = []

    def tell(self, topic: str, message: Any) -> None:
        """Publish, once the bridge listens."""
        if topic not in self.writers:
            self.writers[topic] = writer = self.participant.writer(topic, type(message))
            wait_for(lambda: writer.look() or writer.is_read, 30, f"the bridge to listen to {topic}")
        self.writers[topic].write(message)

    def spin(self) -> bool:
        if isinstance(self.robot, RobotInHost):
            pause(STEP_S)
        else:
            self.participant.wait(5_000_000)
        for topic, reader in self.readers.items():
            self.got[topic] += reader.take()
        return True

    def wait(self, condition: Callable[[], object], what: str) -> None:
        wait_for(lambda: self.spin() and condition(), 60, what)

    def insist(self, do: Callable[[], object], condition: Callable[[], object], what: str) -> None:
        """Do it, and wait until it has come true: again where the bridge was too late for it, and left it out."""
        def attempt() -> str:
            do()
            try:
                self.wait(condition, what)
            except pytest.fail.Exception as problem:
                return str(problem)
            return ""

        assert self.robot is not None
        problem = self.robot.retry(attempt, what)
        assert not problem, problem

    def repeat(self, do: Callable[[], object], condition: Callable[[], object], what: str,
               every_s: float = 5.0) -> None:
        """Do it every 5 s until it has come true: refusals are reported no more often than that."""
        next_s = 0.0

        def again() -> object:
            nonlocal next_s
            if time.monotonic() > next_s:
                next_s = time.monotonic() + every_s
                do()
            return condition()

        self.wait(again, what)

    def last(self, topic: str) -> Any:
        return self.got[topic][-1]

    def close(self) -> None:
        self.participant.close()

    def home(self) -> None:
        state = self.got["PSM1/operating_state"]
        self.insist(lambda: self.tell("system/home", Empty()), lambda: state and state[-1].is_homed, "PSM1 homed")

    def state(self, text: str) -> None:
        self.wait(lambda: self.got["PSM1/operating_state"] and self.last("PSM1/operating_state").state == text, text)


def own_domain() -> int:
    """A domain that no other system of ours gets, on this machine, while we live: we hold a name for it."""
    for domain in range(1, 231):
        holder = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            holder.bind(f"\0trocar-test-domain-{domain}")
        except OSError:
            holder.close()
        else:
            atexit.register(holder.close)
            return domain
    pytest.fail("every domain is taken")


def file_with(folder: Path, *, file: Path = FILE, **ros: Any) -> tuple[Path, int]:
    """A system with a bridge in a domain of its own."""
    domain = own_domain()
    system = yaml.safe_load(file.read_text())
    system["trocar"] = {"ros": {"domain": domain, **ros}}
    made = folder / f"ros{domain}.yaml"
    made.write_text(yaml.safe_dump(system))
    return made, domain


@contextlib.contextmanager
def bridged(robot: Robot, folder: Path, *sets: str, **ros: Any) -> Iterator[Client]:
    made, domain = file_with(folder, **ros)
    options = [word for each in ("processes.ros_bridge.hung_s=60", *sets) for word in ("--set", each)]
    robot.up(made, "--path", str(ROOT / "configs"), *COARSE, *options)
    with client_of(robot, domain) as client:
        yield client


@contextlib.contextmanager
def client_of(robot: Robot, domain: int) -> Iterator[Client]:
    """A client in the domain of a system that runs; its bridge as well, if the system is in this process."""
    with contextlib.ExitStack() as held:
        if isinstance(robot, RobotInHost):
            held.enter_context(hosted_bridge(robot))
        client = held.enter_context(contextlib.closing(Client(domain, robot)))
        for topic, message in (("PSM1/operating_state", OperatingState), ("PSM1/measured_js", JointStates),
                               ("PSM1/measured_cp", PoseStamped), ("PSM1/warning", String)):
            client.hear(topic, message)
        yield client


@contextlib.contextmanager
def hosted_bridge(robot: RobotInHost) -> Iterator[None]:
    """A bridge in this process, for which time passes as well; a slow machine does not stall it."""
    acting = ACTING.origin
    with mock.patch.object(loop, "boottime_ns", lambda: 0), mock.patch.object(dds, "Domain", domain_of_several), \
            contextlib.closing(HostedBridge(robot.host)) as bridge, sleeping_by(bridge.run):
        yield
    ACTING.origin = acting


def domain_of_several(domain: int, settings: str) -> Domain | None:
    """DDS has one of a number in each process, for all participants: the bridge and its client."""
    try:
        return Domain(domain, settings)
    except DDSException:
        return None


def test_a_client_homes_moves_and_hears_what_a_client_of_the_original_hears(robot: Robot, tmp_path: Path) -> None:
    with bridged(robot, tmp_path) as client:
        client.hear("PSM1/goal_reached", Bool)
        client.hear("/clock", Clock)
        client.hear("/tf", TFMessage)
        client.readers["PSM1/robot_description"] = client.participant.read_latched("PSM1/robot_description", String, 1)
        client.got["PSM1/robot_description"] = []
        client.state("DISABLED")
        client.wait(lambda: client.got["PSM1/measured_js"], "joints, although they are not valid")
        stamp = client.last("PSM1/measured_js").header.stamp
        assert stamp.sec == stamp.nanosec == 0
        client.home()
        client.wait(lambda: client.last("PSM1/measured_js").header.stamp.sec > 0, "a valid record")
        names = client.last("PSM1/measured_js").name
        assert names == ["yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw"]
        here = client.last("PSM1/measured_js").position
        client.got["PSM1/operating_state"].clear()
        client.insist(lambda: client.tell("PSM1/move_jp", JointStates(position=[here[0] + 0.2, *here[1:]])),
                      lambda: client.got["PSM1/goal_reached"], "the end of the move")
        client.wait(lambda: not client.last("PSM1/operating_state").is_busy, "not busy")
        assert any(state.is_busy for state in client.got["PSM1/operating_state"])
        stamps = [(s.header.stamp.sec, s.header.stamp.nanosec) for s in client.got["PSM1/operating_state"]]
        assert stamps == sorted(set(stamps)), "stamps increase strictly"
        client.wait(lambda: abs(client.last("PSM1/measured_js").position[0] - here[0] - 0.2) < 1e-6, "it to be there")
        pose = client.last("PSM1/measured_cp")
        frames = {t.child_frame_id: t for message in client.got["/tf"] for t in message.transforms}
        assert frames["PSM1"].header.frame_id == pose.header.frame_id == "PSM1_base"
        joints = {each.attrib["name"] for each in ElementTree.fromstring(client.last("PSM1/robot_description").data)
                  if each.tag == "joint"}
        assert joints == {*names, "PSM1_to_tip"}
        assert client.got["/clock"], "time is simulated: ROS is told it"
        commands_that_make_no_sense_are_refused_and_move_nothing(client)
        questions_are_answered_as_rmw_cyclonedds_asks_them(client, here)


def commands_that_make_no_sense_are_refused_and_move_nothing(client: Client) -> None:
    before = client.last("PSM1/measured_js").position
    nan, far = float("nan"), 1e300
    for message in (JointStates(position=[nan] * 6), JointStates(position=[1.0]), JointStates(position=[far] * 6),
                    JointStates()):
        for topic in ("PSM1/servo_jp", "PSM1/move_jp"):
            client.got["PSM1/warning"].clear()
            client.tell(topic, message)
    for pose in (Pose(Point(nan, 0.0, 0.0), Q), Pose(Point(), Quaternion(0.0, 0.0, 0.0, 0.0)),
                 Pose(Point(), Quaternion(9.0, 9.0, 9.0, 9.0))):
        client.tell("PSM1/servo_cp", PoseStamped(MessageHeader(), pose))
        client.tell("PSM1/move_cp", PoseStamped(MessageHeader(), pose))
    client.tell("PSM1/state_command", StringStamped(string="dance"))
    for _ in range(20):
        client.spin()
    count = len(client.got["PSM1/measured_js"])
    client.wait(lambda: len(client.got["PSM1/measured_js"]) > count + 20, "more records")
    assert np.allclose(client.last("PSM1/measured_js").position, before, atol=1e-9)
    assert client.last("PSM1/operating_state").is_homed


def questions_are_answered_as_rmw_cyclonedds_asks_them(client: Client, joints: list[float]) -> None:
    service = CycloneClient(client.participant, "PSM1/forward_kinematics", SERVICES["forward_kinematics"])
    found = service.answer(jp=list(joints), cp=Pose())
    assert found.result and found.cp.position.z != 0.0
    found = service.answer(jp=[1.0] * 40, cp=Pose())
    assert not found.result and found.message
    state = CycloneClient(client.participant, "PSM1/operating_state", SERVICES["operating_state"])
    assert state.answer(structure_needs_at_least_one_member=0).operating_state.is_homed


def test_a_console_is_operated_and_says_what_it_does(robot: Robot, tmp_path: Path) -> None:
    with bridged(robot, tmp_path) as client:
        for topic, message in (("enabled", Bool), ("selected", String), ("unselected", String), ("scale", Float64)):
            client.readers[topic] = client.participant.read_latched(f"console/teleop/{topic}", message, 10)
            client.got[topic] = []
        client.hear("MTMR_PSM1/current_state", String)
        client.wait(lambda: [each.data for each in client.got["selected"]] == ["MTMR_PSM1"], "what is selected")
        client.insist(lambda: client.tell("console/teleop/set_scale", Float64(0.4)),
                      lambda: client.got["scale"] and client.last("scale").data == 0.4, "the scale")
        client.insist(lambda: client.tell("console/teleop/unselect", String("MTMR_PSM1")),
                      lambda: [each.data for each in client.got["unselected"]] == ["MTMR_PSM1"], "it to be unselected")
        client.insist(lambda: client.tell("console/teleop/select", String("MTMR_PSM1")),
                      lambda: len(client.got["selected"]) == 2, "it to be selected again")
        client.home()
        client.insist(lambda: client.tell("console/teleop/enable", Bool(True)),
                      lambda: client.got["enabled"] and client.last("enabled").data, "teleoperation to be enabled")
        client.insist(lambda: client.tell("console/emulate_operator_present", Joy(buttons=[1])),
                      lambda: client.got["MTMR_PSM1/current_state"]
                      and client.last("MTMR_PSM1/current_state").data == "ENABLED", "it to run")


def test_old_commands_are_not_carried_out_by_a_bridge_that_begins(robot: Robot, tmp_path: Path) -> None:
    made, domain = file_with(tmp_path)
    with contextlib.closing(Participant(domain, name="before")) as before:
        latched = before.writer("PSM1/state_command", StringStamped, latched=10)
        latched.write(StringStamped(string="enable"))
        robot.up(made, "--path", str(ROOT / "configs"))
        with client_of(robot, domain) as client:
            states = client.got["PSM1/operating_state"]
            client.wait(lambda: (latched.look() or latched.is_read) and len(states) > 20, "the bridge to listen")
            assert {state.state for state in states} == {"DISABLED"}
            client.insist(lambda: latched.write(StringStamped(string="enable")),
                          lambda: states[-1].state == "ENABLED", "ENABLED")


def test_people_on_the_network_power_nothing_where_the_file_says_so(robot: Robot, tmp_path: Path) -> None:
    with bridged(robot, tmp_path, may_power=False) as client:
        client.hear("system/warning", String)
        client.state("DISABLED")
        for topic, message in (("system/home", Empty()), ("PSM1/state_command", StringStamped(string="enable"))):
            refusals = client.got[f"{topic.partition('/')[0]}/warning"]
            client.tell(topic, message)
            client.wait(lambda: any("may not power" in each.data for each in refusals), topic)  # noqa: B023
        assert client.last("PSM1/operating_state").state == "DISABLED"
        robot.trocar("home")
        client.wait(lambda: client.last("PSM1/operating_state").is_homed, "an operator at the robot may")
        here = client.last("PSM1/measured_js").position
        client.tell("PSM1/move_jp", JointStates(position=[here[0] + 0.1, *here[1:]]))
        client.wait(lambda: abs(client.last("PSM1/measured_js").position[0] - here[0] - 0.1) < 1e-6, "a move")


def echo_position(robot: Robot) -> Any:
    row = json.loads(robot.trocar("echo", "PSM1/measured_js", "--json", "--once"))
    return row["position"]
