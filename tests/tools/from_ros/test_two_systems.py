"""Two whole systems over DDS: a master and a slave of one are arms from ROS in the other, in both directions.

Each runs in one process, the distant one with its ROS bridge, the local one with the programs of its arms from ROS.
Their time is the test's: a step waits until the poses of the distant arms have come over the network, so stalls of a
busy machine have no effect. The same with all processes, in real time: tests/system/test_arms_from_ros.py.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from unittest import mock

import numpy as np
import pytest
import yaml

from tests.system.robot import ROOT
from tests.system.test_ros_bridge import own_domain
from tests.tools.from_ros.distant_system import HISTORY, SteppedSystem, SystemProcess
from trocar.procs.config import load_system
from trocar.procs.document.system import LOCKSTEP, SystemConfig
from trocar.procs.host import host as hosting
from trocar.procs.host.host import Host
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.tables.manifest import proc
from trocar.shm.mailbox.origins import ACTING
from trocar.tools.from_ros import arm, remote_commands
from trocar.tools.from_ros.arm import ArmFromRos

pytestmark = pytest.mark.slow
STEP_S: Final = 0.01
ARRIVES_S: Final = 20.0
SETS: Final = ["io.period_s=0.005", "arm.period_s=0.005"]
FROM_ROS: Final = ("MTMR", "PSM1")
HERE: Final = ("MTML", "PSM2")
TELEOPS: Final = (("MTMR", "PSM2"), ("MTML", "PSM1"))
SCALE: Final = 0.2
BASE: Final = (0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def kinematic(name: str, kind: str, file: str) -> dict[str, Any]:
    return {"name": name, "type": kind, "simulation": "KINEMATIC", "arm_file": f"{ROOT}/configs/arms/{file}-demo.yaml"}


def loaded(folder: Path, name: str, arms: list[dict[str, Any]], **keys: Any) -> SystemConfig:
    """For a host, which starts no programs of arms."""
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump({"$id": "dvrk-system.schema.json", "$version": "1", "arms": arms, **keys}))
    found = load_system(file, name=f"{name}{os.getpid()}", sets=SETS)
    assert found.system is not None, found.errors
    return replace(found.system, clock=LOCKSTEP, users=())


class StandingTime:
    """The clock of a program of an arm, which a host's time does not wait for."""

    simulated, spin_ns, wakeup = True, 0, None

    def __init__(self, host: Host) -> None:
        self._host = host

    def now_ns(self) -> int:
        return self._host.now_ns

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> None:
        """It never waits."""


class SteppedPair:
    """`local` has the console, `distant` the arms on ROS."""

    def __init__(self, local: SteppedSystem, document: SystemConfig) -> None:
        self.local, self._document = local, document
        self.start()
        self.programs = {name: ArmFromRos(Node(document_of(local.host.name), name, StandingTime(local.host)))
                         for name in FROM_ROS}
        for program in self.programs.values():
            program.setup()
            program.node.begin()
        self._away: dict[str, float] = {}

    def start(self) -> None:
        self.distant = SystemProcess(self._document, FROM_ROS)

    def kill(self) -> None:
        self.distant.process.kill()
        self.distant.process.communicate()

    def run(self, seconds: float, *, silent: bool = False) -> None:
        """Of both systems' time; `silent`: the distant one stands still."""
        for _ in range(round(seconds / STEP_S)):
            if not silent:
                self.distant.run(STEP_S)
            for program in self.programs.values():
                self._arrives(program, silent)
                program.process_messages()
                program.update()
            self.local.host.run(STEP_S)

    def _arrives(self, program: ArmFromRos, silent: bool) -> None:
        """The pose of this step, where the arm was there before it."""
        waits, end = program.arm.is_there and not silent, time.monotonic() + ARRIVES_S
        program._take()
        while waits and program.arm.is_there and program.arm._pose_ns < self.local.host.now_ns:
            assert time.monotonic() < end, f"no pose of {program.name} came"
            program.participant.wait(5_000_000)
            program._take()

    def run_until(self, condition: Callable[[], object], what: str, seconds: float = 30.0) -> None:
        end = self.local.host.now_ns + round(seconds * 1e9)
        while not condition():
            if self.local.host.now_ns > end:
                pytest.fail(f"{what}: not within {seconds} s; {self.reasons()} {self.problems()}")
            self.run(STEP_S)

    def does(self, name: str, command: str, values: Any = (), text: str = "") -> None:
        system = self.distant if name in FROM_ROS else self.local
        number, found = system.sent(name, command, values, text), list[str]()
        self.run_until(lambda: found.extend(system.outcomes(name, number)) or found[-1:] not in ([], ["accepted"]),
                       f"{name} {command} {text}")
        assert found[-1] == "done", f"{name} {command} {text}: {found}"

    def are_there(self) -> bool:
        return all(program.arm.is_there for program in self.programs.values())

    def come(self) -> None:
        """Until both arms are there: DDS takes real time to find other programs."""
        end = time.monotonic() + ARRIVES_S
        while not self.are_there():
            self.run(STEP_S)
            assert time.monotonic() < end, self.problems()

    def homes(self, *names: str) -> None:
        for name in names:
            for word in ("enable", "home"):
                self.does(name, "state_command", (), word)

    def move_masters(self) -> None:
        for master, _ in TELEOPS:
            self._away[master] = -self._away.get(master, -0.1)
            self.does(master, "move_jr", (self._away[master], 0, 0, 0, 0, 0, 0))

    def stay_while_masters_move(self) -> None:
        """Nothing follows, and the slaves hold."""
        places = [self.place(slave) for _, slave in TELEOPS]
        self.move_masters()
        self.run(1.0)
        assert not any(self.teleops("following"))
        for (_, slave), place in zip(TELEOPS, places, strict=True):
            assert np.abs(self.place(slave) - place).max() < 1e-6, slave

    def problems(self) -> list[str]:
        return [program.error for program in self.programs.values()]

    def teleops(self, field: str) -> list[Any]:
        return [self.local.value("_".join(pair), field).item() for pair in TELEOPS]

    def reasons(self) -> list[str]:
        return [reason.decode() for reason in self.teleops("reason")]

    def place(self, name: str) -> np.ndarray:
        """Of the goal of a slave."""
        return np.array((self.distant if name in FROM_ROS else self.local).value(name, "setpoint_cp")[:3])

    def follow(self) -> None:
        """An operator comes and enables it."""
        self.does("console", "emulate_operator_present", (1,), "stay")
        self.does("console", "teleop_enable", (1,))
        self.run_until(lambda: all(self.teleops("following")), "following", 5.0)

    def close(self) -> None:
        self.distant.close()
        for program in self.programs.values():
            program.quit()
            program.node.close()


@pytest.fixture
def two(tmp_path: Path) -> Iterator[SteppedPair]:
    """Homed."""
    domain, acting = own_domain(), ACTING.origin
    ros = {"from": "ros", "domain": domain}
    alone = {"MTM_is_haptic": False, "align_MTM": False, "start_gripper_threshold": 0.0}
    teleops = [{"MTM": master, "PSM": slave, "configure_parameter": alone} for master, slave in TELEOPS]
    distant = loaded(tmp_path, "distant", [kinematic("MTMR", "MTM", "MTMR"), kinematic("PSM1", "PSM", "PSM1")],
                     trocar={"ros": {"domain": domain, "period_s": 0.005}})
    local = loaded(tmp_path, "local", [
        {"name": "MTMR", "type": "MTM_GENERIC", "component": ros},
        {"name": "PSM1", "type": "PSM_GENERIC", "component": ros},
        kinematic("MTML", "MTM", "MTML"), kinematic("PSM2", "PSM", "PSM1")],
        consoles=[{"name": "console", "input_type": "SIMULATED", "teleop_PSMs": teleops}])
    participant = Participant(domain)
    shared = mock.Mock(wraps=participant, close=lambda: None)  # a process has only one
    with contextlib.ExitStack() as held:
        patch = mock.patch.object
        held.enter_context(patch(hosting, "proc", lambda kind: replace(
            proc(kind), in_time=proc(kind).in_time and kind != "third_party")))
        host = held.enter_context(Host(local, HISTORY))
        for module in (arm, remote_commands):
            held.enter_context(patch(module, "monotonic_ns", lambda: host.now_ns))
            held.enter_context(patch(module, "local_ns", lambda: host.now_ns))
        held.enter_context(patch(arm, "Participant", lambda *given: shared))
        names = (*HERE, "console", *("_".join(pair) for pair in TELEOPS))
        made = SteppedPair(SteppedSystem(host, names), distant)
        held.callback(participant.close)
        held.callback(made.close)
        made.come()
        made.homes(*FROM_ROS, *HERE)
        made.does("MTMR", "set_base_frame", BASE)  # its frame has another name then, which is a loss
        made.run(0.1)
        made.come()
        yield made
    ACTING.origin = acting


def test_each_follows_its_master_in_the_other_system_until_presence_ends_or_it_jumps(two: SteppedPair) -> None:
    two.follow()
    masters, slaves = ([two.place(pair[side]) for pair in TELEOPS] for side in (0, 1))
    two.move_masters()
    two.run(0.2)
    assert all(two.teleops("following")), two.reasons()
    for (master, slave), at, began in zip(TELEOPS, masters, slaves, strict=True):
        moved = np.linalg.norm(two.place(master) - at)
        assert moved > 0.02
        assert np.linalg.norm(two.place(slave) - began) == pytest.approx(SCALE * moved, abs=1e-4), slave

    two.does("console", "emulate_operator_present", (0,), "stay")
    two.run(0.05)
    assert not any(two.teleops("following"))
    two.stay_while_masters_move()

    two.follow()
    two.does("MTMR", "set_base_frame", (0.13, *BASE[1:]))
    two.run(0.05)
    assert two.teleops("following") == [False, True], two.reasons()
    assert "MTMR jumped by 30 mm" in two.reasons()[0]


def test_none_follows_by_itself_after_a_silence_a_loss_of_power_or_a_death(two: SteppedPair) -> None:
    two.follow()
    two.run(0.04, silent=True)
    assert not any(two.teleops("following"))
    two.run_until(lambda: all(two.teleops("following")), "following after a short silence")

    two.run(0.2, silent=True)
    two.local.host.run(0.05)
    assert two.teleops("state") == [b"DISABLED"] * 2
    assert all("is silent" in problem for problem in two.problems())
    two.come()
    assert two.teleops("state") == [b"DISABLED"] * 2
    two.stay_while_masters_move()

    two.follow()
    two.does("MTMR", "state_command", (), "disable")
    two.run(0.05)
    assert two.teleops("following") == [False, True]
    two.homes("MTMR")
    two.run(1.0)
    assert two.teleops("following") == [False, True]

    two.follow()
    two.kill()
    two.run(0.2, silent=True)
    assert two.teleops("state") == [b"DISABLED"] * 2
    two.start()
    two.come()
    two.homes(*FROM_ROS)
    two.stay_while_masters_move()
    two.follow()
