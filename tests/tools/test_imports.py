"""What verbs and scripts load before they do anything: a person waits for it each time; numpy alone takes 0.1 s."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import requires
from typing import Any

import pytest

from tests.tools.robot import robot
from trocar.tools import cli

READERS = ("trocar.procs.config", "trocar.procs.kinematics", "trocar.tools.converters")
"""They load the models of all files: half a second."""
LIBRARIES = ("mujoco", "pinocchio", "yaml", "psutil", "OpenGL", "glfw")
LOOKING = ("status", "logs", "list", "hz", "down")
"""They do without the document of a system, too."""
UNUSED_BY_TYPER = {"pydantic"} - {need.partition(">")[0] for need in requires("typer") or ()}
HEAVY = {"commission", "new-arm", "kinematics", "check", "convert", "doctor", "bench"}
"""Verbs about files or the machine: what they load is their work."""


def loaded_by(code: str, *arguments: str) -> set[str]:
    """The modules of a fresh interpreter after some code."""
    words = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)", *arguments]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def loaded_with(*verbs: str) -> set[str]:
    doors = [part.door for verb in cli.VERBS if verb.name in verbs for part in verb.parts or (verb,)]
    return loaded_by("from trocar.tools.cli import loaded\nfor door in sys.argv[1:]: loaded(door)", *doors)


@pytest.mark.slow
def test_verbs_load_no_readers_of_files() -> None:
    found = loaded_with(*{verb.name for verb in cli.VERBS} - HEAVY)
    assert not found & {*READERS, *LIBRARIES, "trocar.procs.node.runtime", "trocar.procs.supervisor"}


def test_verbs_that_look_load_no_document() -> None:
    assert not loaded_with(*LOOKING) & {"trocar.procs.document.system", "rich.console", "pydantic"}


def test_a_script_loads_no_document_and_no_code_of_processes(world: Any) -> None:
    with robot(world.name) as made:
        made.show_arm(age_s=-60.0)
        found = loaded_by("import trocar\nwith trocar.psm('PSM1', sys.argv[1]) as psm: psm.operating_state()",
                          world.name)
    assert "trocar.tools.client.shared" in found
    assert not found & {"trocar.procs.config", "trocar.procs.document.system", "trocar.procs.node.life", "ssl",
                        "trocar.tools.client.provider", "trocar.tools.inspect.processes", *LIBRARIES}


def test_status_loads_nothing_more_at_work(world: Any) -> None:
    with robot(world.name):
        code = "from trocar.tools.cli import main\ntry: main()\nexcept SystemExit: pass"
        found = loaded_by(code, "status", "--json", "--system", world.name)
    assert "trocar.tools.inspect.standing" in found
    assert not found & {*READERS, *LIBRARIES, *UNUSED_BY_TYPER, "trocar.procs.document.system", "rich.console"}


def test_verbs_start_no_threads_of_numpy(world: Any) -> None:
    code = ("import os\nfrom trocar.tools.cli import main\ntry: main()\nexcept SystemExit: pass\n"
            "print(len(os.listdir('/proc/self/task')))")
    bare = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")}
    words = [sys.executable, "-c", code, "status", "--system", world.name]
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=bare)
    assert done.stdout.split() == ["1"]
