"""The recorder as a whole, stepped by the test, and `trocar record`, which waits for it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from tests.system.robot import ROOT
from tests.tools.robot import ScriptedRobot
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.recorder.loop import RecorderLoop
from trocar.procs.recordings import names
from trocar.procs.recordings.reading import open_recording
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.clock import pause as really_pause
from trocar.tools import cli
from trocar.tools.client import remote
from trocar.tools.verbs import record


@dataclass
class AskedRecorder:
    """A command as the recorder gets it, and what became of it."""

    name: str
    text: str = ""
    place: int = 1
    pid: int = 10
    values: Any = ()
    heard: Callable[[], Any] = str
    has_client: bool = True
    answers: list[Any] = field(default_factory=list)

    def done(self, text: str = "") -> None:
        self.answers.append((text, self.heard()))

    fail = done


class Recording:
    """A recorder whose time goes on while others wait."""

    def __init__(self, robot: ScriptedRobot, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.robot, self.folder = robot, folder / robot.name
        self.loop = RecorderLoop(Node(document_of(robot.name), "recorder"))
        self.loop.begin()
        self.ahead_ns = 0
        self.happens: Callable[[], None] | None = None
        for module in (remote, record):
            patch.setattr(module, "pause", self.wait)
        patch.setattr(record, "monotonic_ns", lambda: monotonic_ns() + self.ahead_ns)
        patch.setattr("trocar.shm.time.system_time.monotonic_ns", lambda: monotonic_ns() + self.ahead_ns)

    def wait(self, seconds: float) -> None:
        really_pause(0.001)
        if self.happens is not None:
            self.happens()
            return
        self.robot.show_arm(0.5, "ENABLED", homed=True)
        self.loop.step()

    def until(self, met: Callable[[], bool]) -> None:
        end = monotonic_ns() + 30_000_000_000
        while not met():
            assert monotonic_ns() < end
            self.wait(0.0)

    def events(self) -> list[dict[str, str]]:
        reader = directory.reader(self.robot.name, "recorder", "events")
        try:
            return [{"text": bytes(row["text"]).decode()} for row in reader.last(100)]
        finally:
            reader.close()

    def types(self, *words: str) -> Result:
        return CliRunner().invoke(cli.build("record"), ["record", *words, "--system", self.robot.name])

    def asks(self, asked: AskedRecorder) -> object:
        return self.loop.carries_out(asked)  # type: ignore[arg-type]

    def state(self) -> dict[str, Any]:
        reader = directory.reader(self.robot.name, "recorder", "state")
        try:
            return {key: reader.field(key).item() for key in ("name", "messages")} if reader.newest() else {}
        finally:
            reader.close()


@pytest.fixture
def recording(world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Recording]:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    robot = ScriptedRobot(world.name, tmp_path / "shared")
    found = Recording(robot, tmp_path / "shared", monkeypatch)
    yield found
    found.loop.quit()
    found.loop.node.close()
    robot.close()


def test_it_is_in_a_folder_of_its_system_and_ends_with_its_last_figures(recording: Recording) -> None:
    count, for_s = 0, 0.1
    while not count and for_s < 30.0:  # a busy machine needs longer until the arm writes something
        said = recording.types("grasp", "PSM1", "--for", str(for_s), "--json")
        assert said.exit_code == 0, said.output
        found = json.loads(said.stdout.splitlines()[-1])
        path = Path(found["path"])
        assert path.parent == recording.folder and found["name"] == "" and found["messages"] > 0
        with open_recording(path) as made:
            assert made.is_whole
            count = len(made.records("PSM1/state").rows)
        for_s *= 3.0
    assert count


@pytest.mark.slow
def test_whoever_hears_of_the_end_finds_the_last_figures(recording: Recording) -> None:
    asked = AskedRecorder("record", "grasp", values=np.array([0.05]), heard=recording.state)
    recording.asks(asked)
    recording.until(lambda: bool(asked.answers))
    (said, then), = asked.answers
    assert then["name"] == b"" and f" {then['messages']} messages" in said


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, None],
                         ids=["killed", "asked to end", "terminal closed", "nobody reads"])
@pytest.mark.slow
def test_it_ends_with_the_program_that_asked_for_it(recording: Recording, how: signal.Signals | None) -> None:
    command = [sys.executable, "-m", "trocar", "record", "run", "PSM1", "--json", "--system", recording.robot.name]

    def begin() -> subprocess.Popen[bytes]:
        return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                env={**os.environ, "PYTHONPATH": str(ROOT)})

    def goes_on() -> bool:
        nonlocal client
        if client.poll() is not None:  # it does not wait for long, and we may have had no core
            client.stdout.close()  # type: ignore[union-attr]
            client = begin()
        return bool(recording.state().get("messages", 0) > 5)

    client = begin()
    try:
        recording.until(goes_on)
        if how is not None:
            client.send_signal(how)
        client.stdout.close()  # type: ignore[union-attr]
        recording.until(lambda: recording.state().get("name") == b"")
        recording.until(lambda: client.poll() is not None)
    finally:
        client.kill()
        client.wait()
    [path] = recording.folder.glob("run-*.mcap")
    with open_recording(path) as made:
        assert made.is_whole and len(made.records("PSM1/state").rows)


def test_what_is_begun_for_good_goes_on_without_its_client(recording: Recording) -> None:
    asked = AskedRecorder("record", "run", values=np.array([0.0]), has_client=False)
    recording.asks(asked)
    recording.until(lambda: recording.state().get("messages", 0) > 5)
    assert recording.loop._named is not None and not recording.loop._named.is_ending


@pytest.mark.slow
def test_it_ends_when_another_program_has_its_client_s_place(recording: Recording) -> None:
    asked = AskedRecorder("record", "run", values=np.array([0.0, 1.0]))
    recording.asks(asked)
    recording.until(lambda: recording.state().get("messages", 0) > 5)
    asked.pid = 11
    recording.until(lambda: bool(asked.answers))


def test_topics_that_one_client_chose_are_not_anothers_at_the_same_place(recording: Recording) -> None:
    recording.asks(AskedRecorder("choose", "PSM1/state", pid=10))
    recording.asks(AskedRecorder("choose", "IO1/state", pid=11))
    recording.asks(AskedRecorder("record", "grasp", pid=11, values=np.array([0.05])))
    assert recording.loop._named is not None
    assert sorted(recording.loop._named.topics) == ["IO1/state", "recorder/state"]


def test_what_was_chosen_goes_when_a_choice_is_refused(recording: Recording) -> None:
    recording.asks(AskedRecorder("choose", "IO1/state"))
    with pytest.raises(ValueError, match="no topic PSM7"):
        recording.asks(AskedRecorder("choose", "PSM7"))
    recording.asks(AskedRecorder("record", "all", values=np.array([0.05])))
    assert recording.loop._named is not None and "PSM1/state" in recording.loop._named.topics


@pytest.mark.parametrize("word", names.WORDS)
def test_no_recording_is_called_as_files_of_others(recording: Recording, word: str) -> None:
    for name in (word, f"{word}-x"):
        with pytest.raises(ValueError, match=f"is no name.*{word}-…"):
            recording.asks(AskedRecorder("record", name))
    recording.asks(AskedRecorder("record", f"{word}x", values=np.array([0.05])))


@pytest.mark.slow
def test_what_is_to_be_kept_is_named(recording: Recording) -> None:
    said = recording.types("--keep", "it shook", "--json")
    assert said.exit_code == 0, said.output
    with open_recording(Path(json.loads(said.stdout)["path"])) as kept:
        assert kept.is_whole and kept.metadata[names.SYSTEM]["reason"] == "it shook"


def test_ctrl_c_ends_it_in_order(recording: Recording) -> None:
    count = 0

    def interrupted() -> None:
        nonlocal count
        count += 1
        if count == 20:
            recording.happens = None
            raise KeyboardInterrupt
        recording.robot.show_arm()
        recording.loop.step()

    recording.happens = interrupted
    said = recording.types("run", "PSM1", "--json")
    assert said.exit_code == 0 and json.loads(said.stdout.splitlines()[-1])["name"] == "", said.output


def test_ctrl_c_before_it_was_accepted_ends_it_too(recording: Recording) -> None:
    def interrupted() -> None:
        recording.happens = None
        raise KeyboardInterrupt

    recording.happens = interrupted
    assert recording.types("run").exit_code == 130
    recording.until(lambda: any("run has ended" in row["text"] for row in recording.events()))


@pytest.mark.slow
def test_a_stop_that_is_refused_is_told(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(request: Any) -> object:
        raise ValueError("not now")

    def interrupted() -> None:
        recording.robot.show_arm()
        recording.loop.step()
        if recording.state().get("messages", 0) > 5 and recording.happens is not None:
            recording.happens = None
            raise KeyboardInterrupt

    monkeypatch.setattr(recording.loop, "_stop_named", refused)
    recording.happens = interrupted
    said = recording.types("run", "PSM1")
    assert said.exit_code == 1 and "not now; the recording up to then is in" in said.stderr


def test_a_recorder_that_dies_does_not_keep_anybody_waiting(recording: Recording) -> None:
    def silent() -> None:
        if recording.state().get("name") == b"run":
            recording.ahead_ns += 500_000_000
        else:
            recording.loop.step()

    recording.happens = silent
    said = recording.types("run", "PSM1")
    assert said.exit_code == 1 and "has shown nothing for 3 s: it hangs; the recording up to then" in said.stderr
    assert "/run-" in said.stderr
