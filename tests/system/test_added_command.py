"""What a new command of CRTK takes: its row, and what carries it out. Every way in then has it."""

from __future__ import annotations

import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from tests.system.recipes import Recipe, tree_with
from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_ros_bridge import file_with
from tests.system.test_socket_bridge import SocketClient, free
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.messages import Bool
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]

BLINK: Recipe = {
    "shm/commands.py": (('        CommandRow("crtk_version", READ,', '''
        CommandRow("body/set_blinking", SETTING, "blink", (ON,), ros=BOOL),
'''),),
    "procs/arm/settings.py": (
        ('            "crtk_version": ', '            "body/set_blinking": ArmCommandRow(self._blink),\n'),
        ("    def _set_ratios(self", '''    def _blink(self, request: Request) -> str:
        return f"blinks {request.values[0]:g}"

'''),
    ),
}
SCRIPT = """
import sys, trocar
with trocar.arm("PSM1") as psm:
    print(psm.body_set_blinking(1))
"""
TOPIC = "PSM1/body/set_blinking"


def asked_by_ros(robot: Robot, domain: int) -> None:
    """Publish until the command has come through."""
    with closing(Participant(domain, name="client")) as participant, \
            closing(directory.reader(robot.name, "PSM1", "audit")) as audit:
        writer, before = participant.writer(TOPIC, Bool), audit.head

        def is_done() -> bool:
            writer.write(Bool(True))
            return audit.head > before

        wait_for(is_done, 60, f"what is published on {TOPIC}")
        assert audit.newest() and audit.field("command").item() == b"body/set_blinking"


def test_a_command_is_added_in_two_files_and_every_way_in_has_it(robot: Robot, tmp_path: Path) -> None:
    robot.root = tree_with(BLINK, tmp_path / "tree")
    made, domain = file_with(tmp_path, file=ROOT / "configs/systems/kinematic.yaml")
    port = free()
    robot.up(made, "--path", str(ROOT / "configs"), "--set", f"socket.listen=127.0.0.1:{port}")
    assert "blinks 1" in robot.trocar("send", "PSM1", "body/set_blinking", "1")
    assert "blink" in robot.trocar("send", "PSM1")
    assert "allowed: 0|1" in robot.trocar("send", "PSM1", "body/set_blinking", "2", code=2)
    python = subprocess.run([sys.executable, "-c", SCRIPT], cwd=robot.root, env=robot.environment, text=True,
                            capture_output=True, check=True, timeout=60)
    assert python.stdout == "blinks 1\n"
    client = SocketClient(port)
    answer = client.ask(op="call", to="PSM1", command="body/set_blinking", values=[0.0])
    client.close()
    assert (answer["outcome"], answer["text"]) == ("done", "blinks 0")
    asked_by_ros(robot, domain)
    assert robot.down() == 0
