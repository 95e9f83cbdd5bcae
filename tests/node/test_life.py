"""The start and the end of a process: its name for others, and the cause of its end."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import World
from trocar.procs.document.system import Process, SystemConfig
from trocar.procs.document.user_process import UserCommand, UserProcess
from trocar.procs.node import life
from trocar.procs.node.node import Node
from trocar.procs.supervisor.memory import create_all
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.origins import ACTING

BOX = UserProcess("box", "box.py", 0.01, commands=(UserCommand("go"),))


PRINTS = """
import logging
from trocar.procs.node.life import arguments
arguments("user")
for _ in range(3):
    print("as a process of a user")
    logging.getLogger("box").warning("as one of ours")
"""


@pytest.fixture
def box(world: World) -> Iterator[Node]:
    system = SystemConfig(world.name, "a test", "wall", (), (), None, (Process("box", "user", 0.01),), users=(BOX,))
    create_all(system)
    made = Node(system, "box")
    yield made
    made.close()
    world.remove()


def test_others_see_its_commands_under_its_name_in_the_system_file(box: Node, world: World,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    mailbox = box.mailbox()
    monkeypatch.setattr(ACTING, "process", "", raising=False)
    monkeypatch.setattr("sys.argv", ["/trocar/procs/user/loop.py", "--system", world.name, "--name", "other"])
    life.arguments("user")
    with contextlib.closing(Client(world.name, "box")) as other:
        other.send("go")
        assert [received.holder.program for received in mailbox.drain()] == ["other"]


@pytest.mark.parametrize(("end", "told"), [
    (lambda: sys.exit(3), f"sys.exit(3) in {Path(__file__).name} line "), (lambda: next(iter(())), "StopIteration: "),
])
def test_its_log_says_of_its_end_what_status_says(
    box: Node, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, end: Callable[[], None],
    told: str
) -> None:
    monkeypatch.setattr(life, "on_stop", lambda stop: None)
    with pytest.raises(SystemExit), life.lived(box):
        end()
    why = bytes(box.page.field("error")[()]).rstrip(b"\0").decode()
    assert why.startswith(told) and caplog.messages[-1] == f"ended by an error: {why}"


def test_a_process_whose_log_is_on_a_full_disk_goes_on_and_ends_well() -> None:
    words = [sys.executable, "-P", "-c", PRINTS, "--system", "none", "--name", "box"]
    with Path("/dev/full").open("wb") as full:
        assert subprocess.run(words, stdout=full, stderr=full, check=False).returncode == 0
