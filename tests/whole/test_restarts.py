"""Wherever a process is killed or stalled: what its new loop asks of others is what the real mailboxes accept."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
import yaml

from tests import stock
from tests.host.hosted import COARSE, document
from tests.whole.test_console import Room
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.host.host import Host
from trocar.shm.mailbox.client import Client
from trocar.shm.system import directory

GUARDED: Final = re.compile(r"person|authori|\d s late|^stopped by")
"""What mailboxes say, not owners."""
CAMERA, RIGHT = "MTML_MTMR_ECM", "MTMR_PSM1"
AT_100_HZ: Final = ("io.period_s=0.01", "arm.period_s=0.01",
                    *(f"processes.{name}.period_s=0.01" for name in ("SUJ", CAMERA, RIGHT)))
Steps = tuple[tuple[str, str, tuple[float, ...], str], ...]
ENABLED: Final = (("console", "teleop_enable", (1.0,), ""),)
PRESENT: Final = (*ENABLED, ("console", "emulate_operator_present", (1.0,), ""))
FOLLOWING: Final = (*PRESENT, (RIGHT, "", (), "follows"))
CAMERA_PEDAL: Final = ("console", "emulate_camera", (1.0,), "")
CLUTCH: Final = ("console", "emulate_clutch", (1.0,), "")
STATES: Final[dict[str, Steps]] = {
    "disabled": (),
    "disabled, the clutch is pressed": (CLUTCH,),
    "no operator is present": ENABLED,
    "aligning": PRESENT,
    "following": FOLLOWING,
    "following with another scale": (*FOLLOWING, ("console", "set_scale", (0.1,), "")),
    "the clutch is pressed": (*FOLLOWING, CLUTCH),
    "the camera is moved": (*FOLLOWING, CAMERA_PEDAL, (CAMERA, "", (), "follows")),
    "the camera is moved, the clutch is pressed": (*FOLLOWING, CAMERA_PEDAL, (CAMERA, "", (), "follows"), CLUTCH),
    "an arm is homed": (("PSM1", "state_command", (), "unhome"), *PRESENT),
    "arms are powered": (("system", "power_off", (), ""), ("system", "power_on", (), "")),
    "arms are homed": (("system", "power_off", (), ""), ("system", "home", (), "")),
}
RELEASED: Final = tuple(("console", f"emulate_{button}", (0.0,), "") for button in
                        ("operator_present", "clutch", "camera"))
NONE: Final = (("console", "teleop_enable", (0.0,), ""), *RELEASED, ("console", "set_scale", (0.2,), ""))
SHORT_S: Final = 0.05  # in the middle of what it is doing


class Audits:
    """What was refused by mailboxes."""

    def __init__(self, name: str, kinds: dict[str, str]) -> None:
        self._rings = {each: directory.reader(name, each, "audit", kind) for each, kind in kinds.items()}

    def refused(self) -> list[str]:
        """Since the last call."""
        found = []
        for owner, ring in self._rings.items():
            while ring.next():
                words = [bytes(ring.field(name).item()).decode() for name in ("command", "text", "outcome", "reason")]
                if words[2] == "refused" and GUARDED.search(words[3]):
                    found.append(f"{owner} {' '.join(words)}")
        return found

    def close(self) -> None:
        for ring in self._rings.values():
            ring.close()


class Restarts(Room):
    """A full robot, and a person."""

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        self.people |= {"PSM1": Client(host.name, "PSM1")}
        self.audits = Audits(host.name, {name: loop.node.kind for name, loop in host.loops.items()})

    def close(self) -> None:
        self.audits.close()
        super().close()

    def do(self, steps: Steps, seconds: float = SHORT_S) -> None:
        for owner, command, values, text in steps:
            if not command:
                assert self.settles(owner), (owner, self.following)
                continue
            assert self.says(owner, command, *values, text=text, seconds=seconds) in ("done", "accepted"), command

    def does_at_once(self, steps: Steps) -> bool:
        """Whether all was done that was sent in one cycle."""
        sent = {(owner, self.people[owner].send(command, values, text)) for owner, command, values, text in steps}
        self.host.run(SHORT_S)
        replies = {(owner, reply.id): reply.outcome for owner in {owner for owner, _ in sent}
                   for reply in self.people[owner].poll()}
        return all(replies.get(each) == "done" for each in sent)

    def ready(self) -> None:
        """Homed, nothing is wanted, nothing pressed."""
        assert self.does_at_once(NONE)
        self.says("system", "home")
        for _ in range(100):
            if self.homed() and not any(ring.field("is_busy").item() for ring in self.arms.values()):
                return
            self.host.run(0.2)
        pytest.fail("not homed")


def smaller(folder: Path) -> str:
    """The full robot with one instrument, which costs half: a system file."""
    full = yaml.safe_load((PROJECT_CONFIGS / "systems" / "kinematic-full.yaml").read_text())
    full["arms"] = [arm for arm in full["arms"] if arm["name"] not in ("PSM2", "PSM3")]
    del full["consoles"][0]["teleop_PSMs"][1:]
    (folder / "smaller.json").write_text(json.dumps(full))
    return str(folder / "smaller.json")


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Restarts]:
    system = document(smaller(tmp_path_factory.mktemp("room")), sets=AT_100_HZ)
    with Host(system) as host, contextlib.closing(Restarts(host)) as made:
        yield made


CASES: Final = (*itertools.product(STATES, (RIGHT, "console")),
                *((state, CAMERA) for state in STATES if "camera" in state), ("following", CAMERA),
                *((state, "system") for state in STATES if "arms" in state), ("following", "system"))


@pytest.mark.parametrize("number", range(len(CASES)), ids=[" ".join(case) for case in CASES])
def test_what_a_new_loop_asks_for_is_accepted_whatever_it_was_doing(room: Restarts, number: int) -> None:
    state, which = CASES[number]
    killed = bool((number + number // 2) % 2)  # one half of those of each process
    room.ready()
    room.do(STATES[state])
    assert not room.audits.refused()
    room.host.restart(which, killed=killed)
    room.host.run(0.15)
    room.does_at_once(RELEASED)
    room.says("console", "emulate_operator_present", 1.0, seconds=0.15)
    assert not room.audits.refused()


def warning(room: Restarts) -> str:
    """The newest of PSM1, as logs and /rosout show it."""
    events = room.host.reader("PSM1", "events")
    row = [row for row in events.last(100) if row["event"] == b"warning"][-1]
    return "; ".join(filter(None, (row["text"].decode(), row["hint"].decode())))


@pytest.mark.parametrize(("stalled_ms", "what"), [(0, "the arm's process was restarted"),
                                                  (50, "PSM1 stalled for 0.05 s")])
def test_a_stream_that_ended_with_its_arms_process_learns_whether_that_was_restarted_or_stalled(
        room: Restarts, stalled_ms: int, what: str) -> None:
    room.ready()
    if stalled_ms:
        node = room.host.loops["PSM1"].node
        node.held_up_ns = stalled_ms * 1_000_000
        node.begin_anew()
    room.host.restart("PSM1", killed=not stalled_ms)
    room.people["PSM1"].send("servo_jr", (0.0,) * 6)
    room.host.run(SHORT_S)
    (reply,) = room.people["PSM1"].poll()
    assert reply.text == (
        f"servo_jr: this stream has ended: {what}; pause for 0.5 s of the system's time before the next one")
    assert warning(room) == f"PSM1: {reply.text}"


def test_a_stream_beside_another_programs_is_refused_with_one_remedy(room: Restarts) -> None:
    room.ready()
    room.host.run(2.0)  # the warning is repeated only then
    other = Client(room.host.name, "PSM1", "another")
    for client in (room.people["PSM1"], other):
        client.send("servo_jr", (0.0,) * 6)
        room.host.run(SHORT_S)
    (reply,) = other.poll()
    other.close()
    assert re.fullmatch(r"servo_jr: .* is streaming positions; stop it first \(hold\)", reply.text)
    assert warning(room) == f"PSM1: {reply.text}"


# -- the lens of an endoscope, on emulated boards ----------------------------------------------------------------------

OUTPUTS: Final = ("endoscope_focus_in", "endoscope_focus_out")


@pytest.fixture
def lens(tmp_path: Path) -> Iterator[Host]:
    pedals = stock.find("dvrk-share/io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json")
    rows = [{"name": name, "board_id": 2, "bit_id": bit, "is_PWM": False} for bit, name in enumerate(OUTPUTS)]
    (tmp_path / "focus.json").write_text(
        json.dumps({"$id": "saw-robot-io.schema.json", "$version": "6", "digital_outputs": rows}))
    file = tmp_path / "lens.json"
    file.write_text(json.dumps({
        "$id": "dvrk-system.schema.json", "$version": "1",
        "IOs": [{"name": "IO1", "port": "udp", "configuration_files": [str(pedals)]}],
        "ISI_focus_controller": {"name": "lens", "IO": "IO1", "IO_file": "focus.json"}}))
    loaded = load_system(file, name=f"t{os.getpid()}-lens", sets=["clock=lockstep", *COARSE], boards="emulated")
    assert loaded.system is not None, loaded.errors
    with Host(loaded.system) as host:
        yield host


@pytest.mark.parametrize(("state", "killed"), [
    ("at rest", True), ("a pedal is pressed", True), ("commanded", True), ("commanded", False), ("locked", False)])
def test_a_new_loop_of_a_lens_stops_it_whatever_it_was_doing(lens: Host, state: str, killed: bool) -> None:
    boards, client, io = lens.client("boards"), lens.client("lens"), lens.reader("IO1")
    audits = Audits(lens.name, {"IO1": "io", "lens": "focus"})
    places = [io.info["outputs"].index(name) for name in OUTPUTS]
    lens.run(0.3)
    if state == "a pedal is pressed":
        boards.send("press", (1.0,), "focus_plus")
    elif state != "at rest":
        client.send("focus_out" if state == "commanded" else "lock", (1.0,))
    lens.run(0.3)
    boards.send("press", (0.0,), "focus_plus")
    lens.restart("lens", killed=killed)
    lens.run(0.5)
    assert io.newest() and io.field("output")[places].tolist() == [True, True] and not audits.refused()
    audits.close()
