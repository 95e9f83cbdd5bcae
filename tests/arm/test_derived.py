"""An arm derived from ours, on a fake io: commands and states of its own, what it refuses and what ends it."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from tests.arm.arm_configs import fixed_arm
from tests.arm.fake_io import ArmHarness
from tests.arm.test_recovery import restart
from trocar.procs.arm.derived import DerivedArm, DerivedEcm, DerivedMtm, DerivedPsm, State
from trocar.procs.arm.loop import logic_of
from trocar.procs.crtk.user_rows import command_row
from trocar.procs.document.user_process import UserCommand, UserField
from trocar.procs.user.classes import class_named

COMMANDS = (UserCommand("nod", (UserField("angle", "float", "rad"),)), UserCommand("rest", stops=True),
            UserCommand("jump"))


class Nodding(State):
    arm: Nodder

    def enter(self) -> None:
        self.begun_s = self.now_s
        goal = self.control.here.copy()
        goal[0] += self.arm.angle
        self.arm.move(goal)

    def run(self) -> None:
        if not self.arm.is_moving:
            self.arm.end()


class Jumping(State):
    def run(self) -> None:
        goal = self.control.here.copy()
        goal[0] += 1.0
        self.arm.follow(goal)


class Nodder(DerivedPsm):
    states: ClassVar = {"NODDING": Nodding, "JUMPING": Jumping}
    angle = 0.0

    def on_nod(self, angle: float) -> str:
        if abs(angle) > 0.5:
            raise ValueError("too far")
        self.angle = angle
        self.begin("NODDING")
        return "nods"

    def on_rest(self) -> None:
        self.end()

    def on_jump(self) -> None:
        self.begin("JUMPING")


def nodder(kind: type[DerivedArm] = Nodder) -> ArmHarness:
    return ArmHarness(dataclasses.replace(fixed_arm(), commands=COMMANDS), kind=kind)


def shown(harness: ArmHarness) -> str:
    return str(harness.state.text("sub_state"))


def test_a_command_and_a_state_of_its_own() -> None:
    harness = nodder().homed()
    begin = harness.io.position[0]
    nod = harness.send("nod", (0.2,))
    harness.run(0.1)
    assert nod.replies == [("done", "nods")] and shown(harness) == "NODDING"
    assert harness.state["is_homed"] and harness.state["is_busy"] and harness.state.text("state") == "ENABLED"
    assert "it is in NODDING and must be in HOMED" in harness.send("move_jp", (0.0,) * 6).replies[-1][1]
    harness.until(lambda: harness.arm.state == "HOMED", 5.0)
    assert harness.io.position[0] == pytest.approx(begin + 0.2, abs=1e-6) and not harness.state["is_busy"]


def test_it_is_ended_where_it_is() -> None:
    harness = nodder().homed()
    begin = harness.io.position[0]
    harness.send("nod", (0.5,))
    harness.run(0.2)
    assert harness.send("rest").outcomes == ["done"]
    harness.run(0.2)
    held = harness.io.position[0]
    harness.run(0.5)
    assert harness.arm.state == "HOMED" and begin < held < begin + 0.4 and harness.io.position[0] == held


def test_what_it_refuses_is_said() -> None:
    harness = nodder()
    assert "must be in HOMED" in harness.send("nod", (0.1,)).replies[-1][1]
    harness.homed()
    assert harness.send("nod", (0.6,)).replies == [("refused", "nod: too far")]
    assert command_row(COMMANDS[0]).objection(()) == "takes angle [rad]; none was given"


def test_what_cannot_be_followed_ends_the_state() -> None:
    harness = nodder().homed()
    begin = harness.io.position.copy()
    harness.send("jump")
    harness.run(0.1)
    assert harness.arm.state == "HOMED" and np.allclose(harness.io.position, begin)
    assert any("own-state" in str(event) and "JUMPING ended" in str(event) for event in harness.reports.of("warning"))


def test_a_goal_of_another_number_of_joints_is_told_which_there_are() -> None:
    class Short(Nodder):
        def on_jump(self) -> None:
            self.move([0.1, 0.2])

    harness = nodder(Short).homed()
    assert harness.send("jump").replies[-1][1].startswith(
        "jump: [0.1, 0.2]: follow and move take 7 finite joints: yaw (rad), pitch (rad), insertion (m), ")


def test_a_fault_ends_it_and_a_pause_does_not_resume_it() -> None:
    harness = nodder().homed()
    harness.send("nod", (0.5,))
    harness.run(0.1)
    harness.state_command("pause")
    harness.run(0.1)
    harness.state_command("resume")
    harness.run(0.1)
    assert harness.arm.state == "HOMED"
    harness.send("nod", (-0.5,))
    harness.run(0.1)
    harness.io.drop_power()
    harness.run(0.1)
    assert harness.arm.state == "FAULT"


def test_its_successor_goes_on_homed_without_a_jump() -> None:
    harness = nodder().homed()
    harness.send("nod", (0.5,))
    harness.run(0.1)
    assert shown(harness) == "NODDING"
    restart(harness)
    held = harness.io.setpoint.copy()
    harness.run(0.2)
    assert harness.arm.state == "HOMED" and np.allclose(harness.io.setpoint, held, atol=1e-12)


def test_mistakes_of_the_class_are_told_at_once() -> None:
    class Deaf(DerivedPsm):
        pass

    class Homed(Nodder):
        states: ClassVar = {"HOMED": Nodding}

    with pytest.raises(ValueError, match="Deaf has no on_nod"):
        nodder(Deaf)
    with pytest.raises(ValueError, match="HOMED cannot be a new state"):
        nodder(Homed)
    with pytest.raises(ValueError, match="hold is a command of every arm"):
        ArmHarness(dataclasses.replace(fixed_arm(), commands=(UserCommand("hold"),)), kind=Nodder)


def test_its_class_is_found_and_has_to_be_one_of_its_type(tmp_path: Path) -> None:
    file = tmp_path / "arm_of_a_test.py"
    file.write_text("from trocar.procs.arm import derived\nclass A(derived.DerivedPsm): pass\n"
                    "class B(derived.DerivedMtm): pass\n")
    arm = fixed_arm()
    assert issubclass(logic_of(dataclasses.replace(arm, derived=f"{file}:A")), DerivedPsm)
    assert class_named(f"{file}:B", DerivedMtm, "DerivedMtm") and not issubclass(logic_of(arm), DerivedArm)
    for name, wrong in (
            ("B", "has no class B that is derived from DerivedPsm; it has: A$"), ("C", "has no class C that")):
        with pytest.raises(ImportError, match=wrong):
            logic_of(dataclasses.replace(arm, derived=f"{file}:{name}"))
    file.write_text("import nothing_of_this_name\n")
    with pytest.raises(ImportError, match=r"arm_of_a_test.py: ModuleNotFoundError: No module named"):
        class_named(f"{file}:A", DerivedEcm, "DerivedEcm")
