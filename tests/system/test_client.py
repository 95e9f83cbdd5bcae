"""`import trocar` beside running systems: every word of it, and every command of an arm."""

from __future__ import annotations

import functools
import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import trocar
from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.commands import COMMANDS
from trocar.tools.client.instance import Instance
from trocar.tools.client.kinds import SetupLocal
from trocar.tools.client.parts import Body, Frame, Local, Measured, Setpoint
from trocar.tools.client.remote import Remote

pytestmark = [pytest.mark.slow, pytest.mark.simulated("hosted")]
SYSTEMS = ROOT / "configs/systems"
HOME = np.array((0, 0, 0.12, 0, 0, 0))
SECONDS = 120.0
SLOW = 0.001  # a ratio at which moves take minutes: they are under way when we look, on a busy machine as well


class Noted:
    """Which methods of some classes have not been called yet, and which commands were sent."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *kinds: type) -> None:
        self.left: set[str] = set()
        self.sent: set[str] = set()
        for kind in kinds:
            for name, method in list(vars(kind).items()):
                if inspect.isfunction(method) and not name.startswith("_"):
                    self.left.add(f"{kind.__name__}.{name}")
                    monkeypatch.setattr(kind, name, self._noting(method, f"{kind.__name__}.{name}"))
        send = Remote.send

        def posting(remote: Remote, command: str, *rest: Any) -> int:
            self.sent.add(command)
            return send(remote, command, *rest)

        monkeypatch.setattr(Remote, "send", posting)

    def _noting(self, method: Any, name: str) -> Any:
        @functools.wraps(method)
        def called(*values: Any, **named: Any) -> Any:
            self.left.discard(name)
            return method(*values, **named)

        return called


def refused(*text: str) -> Any:
    return pytest.raises(trocar.Refused, match="|".join(text))


def shifted(pose: Any, *shift: float) -> Any:
    pose = pose.copy()
    pose[:3, 3] += shift
    return pose


def test_every_word_of_a_psm(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    noted = Noted(monkeypatch, Instance, trocar.Arm, trocar.Psm, trocar.Jaw, Measured, Setpoint, Frame, Body, Local,
                  trocar.MoveHandle)
    monkeypatch.setattr("trocar.tools.client.shared.FRESH_S", SECONDS)  # a busy machine computes late what is wanted
    robot.up(SYSTEMS / "kinematic.yaml")
    with trocar.psm("PSM1", robot.name) as psm:
        states(psm)
        psm.trajectory_j_set_ratio(1.0)
        moves(psm)
        servos(psm)
        reads(psm)
        efforts(psm)
        questions(psm)
        settings(psm)
        jaw(psm)
        tools(psm)
    assert not noted.left
    others = {"set_endoscope_type", "lock_orientation", "unlock_orientation"}
    assert {command.name for command in COMMANDS["arm"]} - others <= noted.sent


def states(psm: trocar.Psm) -> None:
    psm.check_connections(SECONDS)
    assert psm.connected() and psm.is_disabled() and not psm.is_enabled()
    with refused("not ready"):
        psm.move_jp(HOME)
    with pytest.raises(TimeoutError, match="not valid"):
        psm.measured_cp()
    psm.enable(SECONDS)
    assert psm.operating_state()[0] == "ENABLED" and not psm.is_homed()
    psm.home(SECONDS)
    assert psm.is_homed() and psm.desired_state()[0] == "HOMED"
    psm.pause(SECONDS)
    with refused("not allowed"):
        psm.state_command("home")
    psm.resume(SECONDS)
    psm.unhome(SECONDS)
    psm.disable(SECONDS)
    psm.wait_for_operating_state("DISABLED", SECONDS)
    psm.home(SECONDS)
    psm.wait_for_busy(False, SECONDS)
    with pytest.raises(TimeoutError, match="is not busy after"):
        psm.wait_for_busy(True, 0.01)
    assert set(psm.period_statistics()) <= {"period", "work"}


def is_known(psm: trocar.Psm) -> bool:
    try:
        psm.measured_cp()
    except TimeoutError as error:
        assert "measured_cp is not valid" in str(error)
        return False
    return True


def moves(psm: trocar.Psm) -> None:
    """A command is done a cycle or two before a record shows that it is: see `becomes`."""
    psm.trajectory_j_set_ratio(SLOW)
    handle = psm.move_jp(HOME + (0.1, -0.1, 0.02, 0.2, 0.1, -0.1))
    assert handle.is_busy()
    psm.trajectory_j_set_ratio(1.0)
    handle.wait(SECONDS)
    psm.move_jr((-0.1, 0.1, -0.02, -0.2, -0.1, 0.1)).wait(SECONDS)
    becomes(lambda: np.allclose(psm.measured_jp()[0], HOME, atol=1e-9))
    psm.insert_jp(0.15).wait(SECONDS)
    becomes(lambda: np.allclose(psm.measured_jp()[0], HOME + (0, 0, 0.03, 0, 0, 0), atol=1e-9))
    goal = shifted(psm.setpoint_cp()[0], 0.01, 0.0, 0.0)
    psm.move_cp(goal).wait(SECONDS)
    becomes(lambda: np.allclose(psm.measured_cp()[0], goal, atol=1e-6))
    back = np.eye(4)
    back[0, 3] = -0.01
    psm.move_cr(back).wait(SECONDS)
    becomes(lambda: np.allclose(psm.measured_cp()[0], shifted(goal, -0.01, 0.0, 0.0), atol=1e-6))
    with refused("unable to solve inverse kinematics"):
        psm.move_cp(shifted(goal, 1.0, 0.0, 0.0))
    psm.trajectory_j_set_ratio(SLOW)
    handle = psm.move_jp(HOME)
    psm.hold()
    with refused("replaced by hold"):
        handle.wait(SECONDS)
    psm.trajectory_j_set_ratio(1.0)


def servos(psm: trocar.Psm) -> None:
    here, _ = psm.setpoint_jp()
    psm.servo_jp(here + 0.001)
    psm.servo_jp(here, np.zeros(6))
    psm.servo_jr(np.full(6, 0.001))
    psm.servo_jv(np.full(6, 0.01))
    pose, _ = psm.setpoint_cp()
    psm.servo_cp(pose)
    psm.servo_cp(pose, np.zeros(6))
    psm.servo_cr(np.eye(4))
    psm.servo_cs(pose, np.zeros(6), np.zeros(6))
    psm.servo_cs(pose)
    with refused("a twist needs a pose"):
        psm.servo_cs(twist=np.zeros(6))
    psm.hold()


def reads(psm: trocar.Psm) -> None:
    state, stamp = psm.measured_js()
    assert [part.shape for part in state] == [(6,)] * 3 and stamp > 0
    assert psm.joint_names()[:3] == ["yaw", "pitch", "insertion"]
    for read in (psm.measured_jv, psm.measured_jf, psm.setpoint_jp, psm.setpoint_jv, psm.setpoint_jf, psm.measured_cv,
                 psm.setpoint_cv, psm.local.measured_cv, psm.measured_cf, psm.body.measured_cf,
                 psm.spatial.measured_cf):
        assert read()[0].shape == (6,)
    assert psm.setpoint_js()[0].position.shape == (6,)
    assert psm.body.jacobian()[0].shape == psm.spatial.jacobian()[0].shape == (6, 6)
    assert psm.gravity_compensation.setpoint_js()[0].effort.tolist() == [0.0] * 6
    assert np.allclose(psm.local.setpoint_cp()[0], psm.setpoint_cp()[0])
    assert np.allclose(psm.local.measured_cp()[0], psm.measured_cp()[0])


def efforts(psm: trocar.Psm) -> None:
    psm.servo_jf(np.zeros(6))
    psm.free()
    psm.hold()
    psm.body.servo_cf(np.zeros(6))
    psm.spatial.servo_cf(np.zeros(6))
    psm.servo_cf(np.zeros(6))
    psm.servo_cs(wrench=np.zeros(6))
    psm.body.set_cf_orientation_absolute()
    psm.body.set_cf_orientation_absolute(False)
    place, _ = psm.measured_cp()
    psm.servo_ci(trocar.Impedance(place[:3, 3], position_negative=trocar.Gains(p=(0, 0, -100), d=(0, 0, -5))))
    psm.hold()


def questions(psm: trocar.Psm) -> None:
    joints = HOME + 0.01
    pose = psm.forward_kinematics(joints)
    assert np.allclose(pose, psm.local.forward_kinematics(joints), atol=1e-9)
    assert np.allclose(psm.inverse_kinematics(HOME, pose), joints, atol=1e-6)
    with refused("inverse kinematics failed"):
        psm.inverse_kinematics(HOME, shifted(pose, 1.0, 0.0, 0.0))
    assert psm.actuator_to_joint_position(np.zeros(7)).tolist() == [0.0] * 7
    assert psm.crtk_version() == "1.1.0"


def settings(psm: trocar.Psm) -> None:
    psm.end_stream()
    psm.trajectory_j_set_ratio_v(0.5)
    psm.trajectory_j_set_ratio_a(0.25)
    becomes(lambda: (psm.trajectory_j_get_ratio(), psm.trajectory_j_get_ratio_v(), psm.trajectory_j_get_ratio_a())
            == (0.0, 0.5, 0.25))
    psm.use_gravity_compensation(False)
    with refused("no gravity model"):
        psm.use_gravity_compensation()
    before, _ = psm.measured_cp()
    psm.set_base_frame(shifted(np.eye(4), 0.1, 0.2, 0.3), "table")
    becomes(lambda: psm.reference_frame() == "table")
    becomes(lambda: np.allclose(psm.measured_cp()[0], shifted(before, 0.1, 0.2, 0.3), atol=1e-6))
    psm.set_base_frame(None)
    becomes(lambda: not is_known(psm))
    psm.add_wall("far", "sphere", shifted(np.eye(4), 0.0, 0.0, 2.0), (0.1,), 0.001, keep="out", of="tip")
    with refused("far"):
        psm.add_wall("far", "plane", np.eye(4))
    psm.remove_wall("far")
    becomes(lambda: np.allclose(psm.local.measured_cp()[0], before, atol=1e-6))


def jaw(psm: trocar.Psm) -> None:
    psm.trajectory_j_set_ratio(1.0)
    psm.jaw.open().wait(SECONDS)
    becomes(lambda: np.allclose(psm.jaw.measured_jp()[0], np.radians(60.0), atol=1e-9))
    psm.jaw.close().wait(SECONDS)
    psm.jaw.move_jp(0.1).wait(SECONDS)
    psm.jaw.servo_jp(0.2)
    assert psm.jaw.setpoint_jv()[0].size == 0
    assert psm.jaw.joint_names() == ["jaw"]
    psm.jaw.servo_jf(0.0)


def tools(psm: trocar.Psm) -> None:
    assert psm.tool()[0] == "LARGE_NEEDLE_DRIVER:400006"
    with refused("effort mode"):
        psm.set_tool_type("LARGE_NEEDLE_DRIVER:400006")
    psm.hold()
    psm.set_tool_type("LARGE_NEEDLE_DRIVER:400006")
    psm.emulate_adapter_present()
    psm.emulate_tool_present()


def test_every_word_of_a_master(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    noted = Noted(monkeypatch, trocar.Mtm, trocar.Gripper)
    robot.up(SYSTEMS / "kinematic-mtm.yaml")
    with trocar.mtm("MTML", robot.name) as mtm:
        assert mtm.gripper.measured_jp()[0].tolist() == [0.0], "also without power"
        assert mtm.gripper.measured_js()[0].effort.size == 0
        assert mtm.gripper.closed() is False
        mtm.home(SECONDS)
        with refused("Cartesian effort mode"):
            mtm.lock_orientation_as_is()
        mtm.body.servo_cf(np.zeros(6))
        mtm.lock_orientation_as_is()
        becomes(mtm.orientation_locked)
        mtm.unlock_orientation()
        becomes(lambda: not mtm.orientation_locked())
        mtm.lock_orientation(mtm.measured_cp()[0][:3, :3])
        becomes(mtm.orientation_locked)
        mtm.hold()
        with pytest.raises(AttributeError):
            mtm.jaw  # noqa: B018
        with pytest.raises(trocar.Problem, match="PSM"):
            trocar.psm("MTML", robot.name)
    assert not noted.left


def test_every_word_of_a_cart_and_its_endoscope(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    noted = Noted(monkeypatch, trocar.Ecm, trocar.Suj, trocar.SetupArm, trocar.System)
    robot.up(SYSTEMS / "kinematic-cart.yaml")
    with trocar.system(robot.name) as system, trocar.ecm(system=robot.name) as ecm, trocar.suj(
            system=robot.name) as suj, trocar.psm("PSM1", robot.name) as psm:
        assert set(system.arms()) == {"ECM", "PSM1", "PSM2", "PSM3"}
        system.power_on(SECONDS)
        system.home(SECONDS)
        assert {process.name for process in system.status()} >= {"SUJ", "ECM", "PSM1"}
        assert ecm.endoscope()[0] == "Classic_SD_STRAIGHT"
        ecm.set_endoscope_type("Classic_HD_UP")
        becomes(lambda: ecm.endoscope()[0] == "Classic_HD_UP")  # its record comes after its answer
        with refused("no endoscope"):
            ecm.set_endoscope_type("Classic_4D")
        ecm.use_gravity_compensation()
        ecm.insert_jp(0.1).wait(SECONDS)
        assert suj.arms() == ["ECM", "PSM1", "PSM2", "PSM3"]
        with pytest.raises(trocar.Problem, match="no setup arm PSM4"):
            suj.arm("PSM4")
        with pytest.raises(AttributeError, match="PSM4"):
            suj.PSM4  # noqa: B018
        cart(suj)
        base, _ = suj.PSM1.measured_cp()
        becomes(lambda: np.allclose(psm.measured_cp()[0], base @ psm.local.measured_cp()[0], atol=1e-9))
        with refused("SUJ gives the base frame"):
            psm.set_base_frame(np.eye(4))
        system.power_off(SECONDS)
        assert suj.is_disabled() and ecm.is_disabled()
    assert not noted.left


def cart(suj: trocar.Suj) -> None:
    assert suj.operating_state()[0] == "ENABLED" and suj.is_homed()
    there = np.array((0.1, 0.2, 1.5, -0.1, 0.4, 0.0))
    suj.PSM2.servo_jp(there)
    becomes(lambda: np.allclose(suj.PSM2.measured_jp()[0], there))
    before, _ = suj.PSM2.local.measured_cp()
    suj.arm("PSM2").move_jp(there + (0.05, 0, 0, 0, 0, 0)).wait(SECONDS)
    becomes(lambda: np.isclose(suj.PSM2.local.measured_cp()[0][2, 3], before[2, 3] + 0.05))
    assert suj.PSM2.primary_voltage.measured_jp()[0].shape == (6,)
    assert suj.PSM2.secondary_voltage.measured_js()[0].velocity.size == 0
    suj.set_reference_arm("PSM1")
    becomes(lambda: suj.reference_arm() == "PSM1")
    suj.set_reference_arm("ECM")
    with refused("only that of SUJ_Fixed can be set"):
        suj.PSM2.local.servo_cp(before)
    with refused("cannot be moved"):
        suj.PSM2.clutch()
    with refused("there is no lift"):
        suj.set_lift_velocity(0.5)


def becomes(condition: Any) -> None:
    wait_for(condition, SECONDS, "it is not so")


def test_a_fixed_cart_is_told_where_it_stands_and_an_instrument_what_it_is(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    noted = Noted(monkeypatch, SetupLocal)
    psm = yaml.safe_load((ROOT / "configs/arms/PSM1-demo.yaml").read_text()) | {"tool_detection": "MANUAL"}
    del psm["tool"]
    files = {
        "psm.yaml": psm,
        "suj.yaml": {"arms": [{"name": name, "measured_cp": np.eye(4).tolist()} for name in ("ECM", "PSM1")]},
        "system.yaml": {"$id": "dvrk-system.schema.json", "$version": "1", "arms": [
            {"name": "SUJ", "type": "SUJ_Fixed", "arm_file": "suj.yaml"},
            {"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "psm.yaml",
             "base_frame": {"component": "SUJ", "interface": "PSM1"}}]},
    }
    for name, content in files.items():
        (tmp_path / name).write_text(yaml.dump(content))
    robot.up(tmp_path / "system.yaml")
    with trocar.suj("SUJ", robot.name) as suj, trocar.psm("PSM1", robot.name) as psm1:
        suj.home(SECONDS)
        there = shifted(np.eye(4), 0.5, 0.6, 0.7)
        suj.PSM1.local.servo_cp(there)
        becomes(lambda: np.allclose(suj.PSM1.local.measured_cp()[0], there))
        psm1.home(SECONDS)
        psm1.set_tool_type("LARGE_NEEDLE_DRIVER:400006")
        becomes(lambda: psm1.measured_jp()[0].size == 6)
        assert psm1.tool()[0].startswith("LARGE_NEEDLE_DRIVER:400006")
        psm1.emulate_tool_present(False)
        becomes(lambda: psm1.tool()[0] == "")
        assert psm1.measured_jp()[0].size == 7
    assert not noted.left
