"""The template forks processes that become children of its supervisor, which does without it when it cannot."""

from __future__ import annotations

import dataclasses
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from tests.conftest import World
from trocar.procs.config import load_system
from trocar.procs.document.system import to_json
from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.node.life import document_of
from trocar.procs.supervisor import template as forked_off
from trocar.procs.supervisor.forking import Forked, Template, reap_orphans
from trocar.shm.system.directory import publish_document

pytestmark = pytest.mark.slow
NO_SYSTEM = 3
Fork = Callable[[], Forked | None]


@pytest.fixture
def template(monkeypatch: pytest.MonkeyPatch) -> Iterator[Template]:
    made = Template()
    with monkeypatch.context() as plain:  # a supervisor has no handlers yet, and the streams of its interpreter
        plain.setattr(logging.getLogger(), "handlers", [])
        plain.setattr(sys, "stdout", sys.__stdout__)
        plain.setattr(sys, "stderr", sys.__stderr__)
        made.start()
    made.prepare("none")
    yield made
    made.close()


@pytest.fixture
def fork(template: Template, world: World, tmp_path: Path) -> Fork:
    """Begins a console of a system that does not exist."""
    words = [sys.executable, "-m", "trocar.procs.console.loop", "--system", world.name, "--name", "console"]

    def do() -> Forked | None:
        with (tmp_path / "output").open("ab") as output:
            return template.fork(words, output.fileno())

    return do


def forked(fork: Fork, world: World) -> Forked:
    """A process of the template, once that has imported everything and has a core to answer on."""
    found: list[Forked] = []
    world.until(lambda: found.extend(filter(None, [fork()])) or found, "the template answers")
    return found[0]


def ended(process: Forked, world: World) -> int | None:
    world.until(lambda: process.poll() is not None, "it ends")
    return process.returncode


def pid_of(template: Template) -> int:
    assert template._forked is not None
    return template._forked.pid


def test_a_forked_process_is_a_child_with_a_command_line_output_and_exit_code_of_its_own(
    fork: Fork, template: Template, world: World, tmp_path: Path
) -> None:
    process = forked(fork, world)
    row = psutil.Process(process.pid)
    assert row.ppid() == os.getpid()
    assert ended(process, world) == NO_SYSTEM
    assert world.name in (tmp_path / "output").read_text()


def test_its_command_line_is_that_of_a_fresh_interpreter(fork: Fork, world: World, tmp_path: Path) -> None:
    code = ("import os,sys; from pathlib import Path; from trocar.procs.supervisor import template\n"
            "template.show([sys.executable, '-m', 'trocar.procs.arm.loop', '--system', 'a b', '--name', 'PSM1'])\n"
            "print(Path('/proc/self/cmdline').read_bytes().rstrip(b'\\0').split(b'\\0')[1:])")
    shown = subprocess.run([sys.executable, "-c", code, " " * 300], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[b'-m', b'trocar.procs.arm.loop', b'--system', b'a b', b'--name', b'PSM1']"


def test_it_has_the_environment_that_the_supervisor_has_now(
    fork: Fork, template: Template, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended(forked(fork, world), world)
    publish_document(world.name, b"{}")  # there is something to attach to, so that it is looked at whose it is
    monkeypatch.setenv("TROCAR_SERVICE_USER", "no-such-user")
    ended(forked(fork, world), world)
    monkeypatch.undo()
    world.remove()
    assert "no-such-user" in (tmp_path / "output").read_text()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_without_a_template_that_answers_there_are_no_forks(
    number: signal.Signals, fork: Fork, template: Template, world: World
) -> None:
    assert ended(forked(fork, world), world) == NO_SYSTEM
    old = psutil.Process(pid_of(template))
    old.send_signal(number)
    if number == signal.SIGKILL:
        world.until(lambda: old.status() == psutil.STATUS_ZOMBIE, "it is dead")
    assert fork() is None
    assert not old.is_running()
    assert fork() is None


def test_a_template_that_ended_does_not_keep_orphans_from_being_reaped(
    fork: Fork, template: Template, world: World
) -> None:
    forked(fork, world).wait()
    old = psutil.Process(pid_of(template))
    old.kill()
    world.until(lambda: old.status() == psutil.STATUS_ZOMBIE, "it is dead")
    world.until(lambda: reap_orphans([]) or not old.is_running(), "it is reaped")
    assert fork() is None


def test_changed_sources_are_not_forked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "module.py"
    source.write_text("")
    monkeypatch.setattr(forked_off, "PACKAGE", tmp_path)
    monkeypatch.setitem(sys.modules, "module", type("Module", (), {"__file__": str(source)}))
    before = forked_off._stamps(forked_off._sources())
    assert before == forked_off._stamps(before) != {}
    os.utime(source, ns=(1, 1))
    assert before != forked_off._stamps(before)


@pytest.mark.parametrize("stopped", [False, True])
def test_a_template_ends_with_its_supervisor(world: World, stopped: bool) -> None:
    code = ("import sys; from trocar.procs.supervisor.forking import Template\n"
            "from trocar.shm.time.clock import pause\n"
            "template = Template(); template.start(); template.prepare('none')\n"
            "while not template.has_imported(): pause(0.01)\n"
            "print(template._forked.pid, flush=True); sys.stdin.read()\n")
    child = world.start(code)
    assert child.stdout is not None
    row = psutil.Process(int(child.stdout.readline()))
    if stopped:
        row.suspend()
    world.kill(child)
    world.until(lambda: not row.is_running() or row.status() == psutil.STATUS_ZOMBIE, "the template ends")


def test_a_template_whose_supervisor_ended_while_it_imported_says_nothing(world: World) -> None:
    code = ("import select; from trocar.procs.supervisor.forking import Template\n"
            "template = Template(); template.start(); template.prepare('none')\n"
            "while not select.select([template._ours], [], [], 1.0)[0]: pass")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_a_process_that_a_dead_child_left_behind_is_collected_when_it_ends(template: Template, world: World) -> None:
    leaves = subprocess.run(["sh", "-c", "sleep 0.2 & echo $!"], capture_output=True, text=True, check=True)
    left = psutil.Process(int(leaves.stdout))
    assert left.ppid() == os.getpid()
    world.until(lambda: left.status() == psutil.STATUS_ZOMBIE, "it ends")
    world.until(lambda: reap_orphans([]) or not left.is_running(), "it is collected")


def test_forks_have_the_document_that_the_template_has_decoded(world: World) -> None:
    system = load_system(PROJECT_CONFIGS / "systems" / "kinematic.yaml", name=world.name).system
    assert system is not None
    publish_document(world.name, to_json(system))
    forked_off.prepare(world.name)
    first = document_of(world.name)
    assert first == system and document_of(world.name) is first
    world.remove()
    publish_document(world.name, to_json(dataclasses.replace(system, history_s=0.5)))
    assert document_of(world.name) != first, "another document of this name is decoded"
    world.remove()
