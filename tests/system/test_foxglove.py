"""A Foxglove client at a real system: what it is offered, what it sees, and that the robot does not notice it."""

from __future__ import annotations

import base64
import json
import os
import re
import signal
import socket
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.sync.client import connect

from tests.config.test_meshes import STL, XACRO, model_checkout
from tests.system.conftest import systems
from tests.system.robot import COARSE, ROOT, Robot, wait_for
from tests.system.test_socket_bridge import free
from trocar.procs.document.system import from_json
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriptions
from trocar.shm.time.control_page import ControlPage

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"
FULL = ROOT / "configs" / "systems" / "kinematic-full.yaml"
PROTOCOL, MESSAGE = "foxglove.sdk.v1", 1


class FoxgloveClient:
    """A client by the protocol's own page; messages are read by what the server says of them."""

    def __init__(self, port: int) -> None:
        self._socket = connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], max_size=None, legacy=True,
                               close_timeout=0.2)
        self.channels: dict[str, dict[str, Any]] = {}
        self.name = ""
        while "/scene" not in self.channels or "/tf" not in self.channels:
            said = self._socket.recv(timeout=30)
            if isinstance(said, str):
                told = json.loads(said)
                self.name = told.get("name", self.name)
                self.channels |= {row["topic"]: row for row in told.get("channels", ())}
        self._names: list[str] = []

    def listen(self, *topics: str) -> None:
        """Subscribe."""
        begin = len(self._names)
        self._names += topics
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": [
            {"id": begin + place, "channelId": self.channels[topic]["id"]} for place, topic in enumerate(topics)]}))

    def leave(self, topic: str) -> None:
        """Unsubscribe."""
        self._socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": [self._names.index(topic)]}))

    def heard(self) -> Iterator[tuple[str, int, Any]]:
        """Topic, time and message of all that comes."""
        while True:
            said = self._socket.recv(timeout=30)
            if isinstance(said, bytes) and said[0] == MESSAGE:
                number, ns = struct.unpack_from("<IQ", said, 1)
                topic = self._names[number]
                yield topic, ns, self._decoded(topic, said[13:])

    def next(self, topic: str, wanted: Callable[[Any], object] = lambda message: True) -> Any:
        """The next message of a topic that is as wanted."""
        return next(message for name, _, message in self.heard() if name == topic and wanted(message))

    def _decoded(self, topic: str, payload: bytes) -> Any:
        row = self.channels[topic]
        if row["encoding"] == "json":
            found = json.loads(payload)
            assert set(found) <= set(json.loads(row["schema"])["properties"]), topic
            return found
        files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(row["schema"]))
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(row["schemaName"])).FromString(payload)

    def close(self) -> None:
        """Leave."""
        self._socket.close()


def pose(translation: Any, rotation: Any) -> Any:
    """4×4, of a message."""
    numbers = [translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w]
    return matrix_from_pose(np.array(numbers))


def started(robot: Robot, file: Path, *options: str) -> tuple[int, FoxgloveClient]:
    port = free()
    robot.up(file, *COARSE, *options, "--set", f"foxglove.listen=127.0.0.1:{port}")
    wait_for(lambda: robot.state("foxglove") == "RUNNING", 30, "the server")
    return port, FoxgloveClient(port)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Robot, int]]:
    """One arm, homed, with a mesh for some of its links; the server's port."""
    folder = tmp_path_factory.mktemp("foxglove")
    made = model_checkout(folder)
    (made / "urdf/Classic/PSM_base.urdf.xacro").write_text(XACRO.replace("FILE", "a.stl"))
    with systems(folder, "paced") as make:
        robot = make()
        port, client = started(robot, KINEMATIC, "--path", str(folder))
        client.close()
        for text in ("enable", "home"):
            robot.trocar("send", "PSM1", "state_command", text, "--wait")
        yield robot, port
        assert robot.down() == 0


def test_the_robot_is_seen_where_it_says_it_is(served: tuple[Robot, int]) -> None:
    robot, client = served[0], FoxgloveClient(served[1])
    assert client.name == f"Trocar {robot.name}"
    robot.trocar("send", "PSM1", "move_jp", "0.3", "-0.2", "0.14", "0.5", "0.4", "-0.3", "--wait")
    client.listen("/tf", "/scene", "/PSM1/local/measured_cp", "/PSM1/measured_js")
    joints = client.next("/PSM1/measured_js", lambda message: abs(message.joints[0].position - 0.3) < 1e-9)
    assert [joint.name for joint in joints.joints][:3] == ["yaw", "pitch", "insertion"]
    assert joints.joints[2].position == pytest.approx(0.14, abs=1e-9)
    tip = client.next("/PSM1/local/measured_cp")
    assert tip.frame_id == "PSM1_base"
    frames = {row.child_frame_id: row for row in client.next("/tf").transforms}
    seen, name = np.eye(4), "PSM1"
    while name != "PSM1_base":
        seen, name = pose(frames[name].translation, frames[name].rotation) @ seen, frames[name].parent_frame_id
    assert np.abs(seen - pose(tip.pose.position, tip.pose.orientation)).max() < 1e-9
    client.close()


def test_every_arm_is_drawn_in_frames_that_hang_together(robot: Robot) -> None:
    port, client = started(robot, FULL)
    robot.trocar("power-on")
    client.listen("/tf", "/scene")
    scene = client.next("/scene")
    arms = [row.name for row in from_json(directory.document(robot.name)).arms]
    frames = {row.child_frame_id: row.parent_frame_id for row in client.next(
        "/tf", lambda message: set(arms) <= {row.child_frame_id for row in message.transforms}).transforms}
    roots = set(frames.values()) - frames.keys()
    assert "Cart" in roots or roots == {f"{arm}_base" for arm in arms}
    for arm in arms:
        drawn = [row for row in scene.entities if row.frame_id.startswith(f"{arm}_")]
        assert sum(len(row.cylinders) for row in drawn) >= 2, arm
        assert all(row.frame_locked and (row.frame_id in frames or row.frame_id in roots) for row in drawn)
    other = FoxgloveClient(port)
    other.listen("/scene")  # who comes late sees it, too
    assert len(other.next("/scene").entities) == len(scene.entities)
    for each in (client, other):
        each.close()


def test_meshes_of_a_checkout_of_the_model_are_drawn_in_frames_that_move_with_the_arm(
        served: tuple[Robot, int]) -> None:
    robot, client = served[0], FoxgloveClient(served[1])
    client.listen("/tf", "/scene")
    drawn = {row.frame_id: row.models for row in client.next("/scene").entities if row.models}
    assert drawn.keys() == {"PSM1_base_link", "PSM1_yaw_link", "PSM1_pitch_4_link"}
    assert drawn["PSM1_yaw_link"][0].data == STL and drawn["PSM1_yaw_link"][0].scale.x == 0.001

    def turned(message: Any) -> bool:
        rows = {row.child_frame_id: row.rotation for row in message.transforms}
        return abs(2.0 * np.arctan2(rows["PSM1_pitch_4_link"].z, rows["PSM1_pitch_4_link"].w) - 0.2) < 1e-6

    robot.trocar("send", "PSM1", "move_jp", "0.3", "-0.2", "0.14", "0.5", "0.4", "-0.3", "--wait")
    frames = {row.child_frame_id: row for row in client.next("/tf", turned).transforms}
    assert drawn.keys() <= frames.keys() and frames["PSM1_yaw_link"].parent_frame_id == "PSM1_yaw"
    client.close()


def test_walls_are_drawn_as_long_as_the_arm_has_them(served: tuple[Robot, int]) -> None:
    robot, client = served[0], FoxgloveClient(served[1])
    client.listen("/scene")
    shapes = {"plane": (), "box": (0.1, 0.2, 0.3), "sphere": (0.02,), "cylinder": (0.02, 0.1), "cone": (0.5,),
              "capsule": (0.02, 0.1)}
    for shape, size in shapes.items():
        keep = " in" if shape == "cone" else ""
        robot.trocar("send", "PSM1", "add_wall", *map(str, (0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0, *size)),
                     f"{shape} {shape} {'reference' if shape == 'box' else ''}{keep}")
    drawn: dict[str, Any] = {}
    while len(drawn) < len(shapes):
        drawn |= {row.id: row for row in client.next("/scene").entities if "/wall/" in row.id}
    made = {shape: drawn[f"PSM1/wall/{shape}"] for shape in shapes}
    assert all(row.frame_id == "PSM1_base" for row in made.values())
    (box,), (ball,), (cone,) = made["box"].cubes, made["sphere"].spheres, made["cone"].cylinders
    assert (box.size.x, box.size.y, box.size.z, box.pose.position.z) == (0.1, 0.2, 0.3, 0.5)
    assert ball.size.x == pytest.approx(0.04) and cone.bottom_scale == 0.0
    assert cone.size.x / 2.0 / cone.size.z == pytest.approx(np.tan(0.5)), "opens from its apex"
    assert cone.pose.position.z - cone.size.z / 2.0 == pytest.approx(0.5)
    assert len(made["capsule"].spheres) == 2 and made["plane"].cubes
    for shape in shapes:
        robot.trocar("send", "PSM1", "remove_wall", shape)
    left = set(drawn)
    while left:
        left -= {row.id for row in client.next("/scene").deletions}
    client.close()


def test_only_what_a_client_listens_to_is_requested(served: tuple[Robot, int]) -> None:
    robot, client = served[0], FoxgloveClient(served[1])
    page = ControlPage(robot.name, "PSM1")
    desired = Subscriptions(page)

    def wanted() -> int:
        desired.look()
        return int(desired.wanted)

    assert not wanted()
    client.listen("/PSM1/spatial/jacobian", "/PSM1/operating_state")
    told = client.next("/PSM1/operating_state")
    assert told["state"] == "ENABLED" and told["is_homed"], "the last one of before"
    assert np.shape(client.next("/PSM1/spatial/jacobian", lambda row: row["valid"] and row["data"][0][0] is not None
                                )["data"]) == (6, 6)
    assert wanted()
    client.leave("/PSM1/spatial/jacobian")
    wait_for(lambda: not wanted(), 30, "nobody wants it any more")
    client.listen("/PSM1/error", "/PSM1/warning")
    robot.types("send", "PSM1", "move_jp", "9", "0", "0.1", "0", "0", "0", "--wait")
    assert client.next("/PSM1/warning").message
    page.close()
    client.close()


def test_killed_or_stopped_it_changes_nothing_for_the_robot(served: tuple[Robot, int]) -> None:
    (robot, port), client = served, FoxgloveClient(served[1])
    for sent in (signal.SIGKILL, signal.SIGSTOP):
        pid, arm = robot.pid("foxglove"), robot.pid("PSM1")
        os.kill(pid, sent)
        robot.trocar("send", "PSM1", "move_jp", "0.1", "0", "0.1", "0", "0", "0", "--wait")
        wait_for(lambda old=pid: robot.pid("foxglove") != old, 60, "another process")
        wait_for(lambda: robot.state("foxglove") == "RUNNING", 60, "its return")
        assert robot.pid("PSM1") == arm
        robot.pids.add(robot.pid("foxglove"))
    client.close()
    again = FoxgloveClient(port)
    again.listen("/PSM1/measured_js")
    assert again.next("/PSM1/measured_js").joints
    again.close()


def test_an_address_that_is_taken_or_open_to_others_is_refused_in_words(robot: Robot) -> None:
    open_to_all = robot.trocar("check", str(KINEMATIC), "--set", "foxglove.listen=0.0.0.0:8765", code=1)
    assert "tls" in open_to_all and "other machines could read the data" in open_to_all
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        robot.up(KINEMATIC, "--set", f"foxglove.listen={address}")
        reason = re.compile(rf"cannot listen at {re.escape(address)}: [^;]*\(pid {os.getpid()}\)")
        wait_for(lambda: reason.search(robot.types("status", "--json").stdout), 30, "the reason")
    assert robot.down() == 0
