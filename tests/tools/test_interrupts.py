"""Ctrl-C, and readers that leave early: verbs end without a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from tests.conftest import ROOT, World
from tests.tools.robot import robot
from trocar.shm.memory.segment import names_of
from trocar.tools.cli import guarded

PATIENCE_S = 240.0
INTERRUPTS = """
import os, signal, sys

class CtrlC:
    def find_spec(name, path=None, target=None):
        if name == os.environ["CTRL_C_AT"] and os.environ.pop("CTRL_C_AT"):
            os.environ["CTRL_C_AT"] = ""
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, CtrlC)
"""
"""As `sitecustomize`: Ctrl-C is pressed at the moment at which a program begins to load a module."""


def trocar(folder: Path, *words: str, **more: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "TROCAR_STATE": str(folder), "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", **more}
    return subprocess.run([sys.executable, "-P", "-m", "trocar", *words], cwd=folder, env=environment, text=True,
                          capture_output=True, timeout=PATIENCE_S, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("module", [
    "typer", "trocar.tools.verbs.echo", "trocar.tools.output.printing", "numpy", "trocar.shm.mailbox.client"])
def test_ctrl_c_while_a_verb_is_loaded_ends_it_without_a_word(module: str, tmp_path: Path, world: World) -> None:
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTS)
    done = trocar(tmp_path, "echo", "PSM1/state", "--system", world.name, CTRL_C_AT=module)
    assert done.returncode in (-2, 130) and not done.stdout + done.stderr, done


@pytest.mark.slow
@pytest.mark.parametrize("module", [
    "trocar.procs.supervisor.loop", "trocar.procs.supervisor.supervisor", "trocar.procs.supervisor.run"])
def test_ctrl_c_while_a_system_is_loaded_stops_it_in_order(module: str, tmp_path: Path, world: World) -> None:
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTS)
    done = trocar(tmp_path, "up", "--system", world.name, CTRL_C_AT=module)
    assert done.returncode == 0 and "stopping: got SIGINT" in done.stderr, done.stderr
    assert "Traceback" not in done.stderr and names_of(world.name) == []


def test_ctrl_c_in_a_verb_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    def verb() -> int:
        raise KeyboardInterrupt

    with pytest.raises(typer.Exit) as ended:
        guarded(verb)()
    assert ended.value.exit_code == 130 and capsys.readouterr().err == "trocar: stopped by Ctrl-C\n"


@pytest.mark.slow
@pytest.mark.parametrize("words", [
    ("status",), ("hz", "--window", "0.1"), ("echo", "PSM1/state", "--once"), ("--help",), ("echo", "PSM1/nosuch")],
    ids=" ".join)
def test_a_reader_that_leaves_at_once_hears_no_error(words: tuple[str, ...], tmp_path: Path, world: World) -> None:
    with robot(world.name) as made:
        made.show_arm()
        reading, writing = os.pipe()
        os.close(reading)
        environment = {**os.environ, "TROCAR_STATE": str(tmp_path), "TROCAR_SYSTEM": world.name,
                       "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": ""}
        for errors in (subprocess.PIPE, writing):  # the second as `2>&1 | head`
            done = subprocess.run([sys.executable, "-P", "-m", "trocar", *words], cwd=ROOT, env=environment, text=True,
                                  stdout=writing, stderr=errors, timeout=PATIENCE_S, check=False)
            assert done.returncode in (0, 1), done
            assert not any(word in (done.stderr or "") for word in ("Traceback", "BrokenPipe", "ignored")), done.stderr
        os.close(writing)


def test_what_this_machine_refuses_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    def verb() -> int:
        return len(Path("/proc/nosuch").read_text())

    with pytest.raises(typer.Exit) as ended:
        guarded(verb)()
    assert ended.value.exit_code == 1 and capsys.readouterr().err == "trocar: /proc/nosuch: No such file or directory\n"
