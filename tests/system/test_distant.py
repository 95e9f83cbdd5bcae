"""The classes of `trocar.py` over a socket: the same script as over shared memory."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import yaml

import trocar
from tests.system.conftest import systems
from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_socket_bridge import PATIENT, free

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
SLOW = 0.001
"""A ratio at which moves take minutes: they are under way when something else comes, on a busy machine as well."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Robot, str]]:
    """A master, a slave, a console and setup joints with a bridge; where that is."""
    folder, at = tmp_path_factory.mktemp("distant"), f"127.0.0.1:{free()}"
    made = yaml.safe_load((ROOT / "configs/systems/kinematic-teleop.yaml").read_text())
    made["arms"].append({"name": "SUJ", "type": "SUJ_Classic", "simulation": "KINEMATIC",
                         "arm_file": "arms/SUJ-kinematic.yaml"})
    (folder / "lab.yaml").write_text(yaml.safe_dump(made))
    with systems(folder, "paced") as make:
        robot = make()
        robot.up(folder / "lab.yaml", "--path", str(ROOT / "configs"), "--set", f"socket.listen={at}", *PATIENT)
        yield robot, at
        robot.pids.add(robot.pid("socket_bridge"))
        assert robot.down() == 0


def seen(arm: trocar.Psm) -> list[Any]:
    """What a script does with a PSM, and what it sees of it."""
    arm.home()
    arm.move_jp([0.1, 0.0, 0.12, 0, 0, 0]).wait()
    pose, _ = arm.measured_cp()
    pose[0, 3] += 0.01
    arm.move_cp(pose).wait()
    start, _ = arm.setpoint_cp()
    arm.servo_cp(start)
    arm.jaw.open().wait()
    joints, _ = arm.setpoint_jp()
    angles = arm.inverse_kinematics(joints, arm.local.measured_cp()[0])
    state, _ = arm.measured_js()
    with pytest.raises(trocar.Refused, match="finite"):
        arm.move_jr([0.0, 0.0, math.nan, 0, 0, 0])
    arm.trajectory_j_set_ratio(SLOW)
    with pytest.warns(trocar.Clipped):
        far = arm.move_jp([0, 0, 5.0, 0, 0, 0])
    arm.hold()
    with pytest.raises(trocar.Refused):
        far.wait()
    arm.wait_for_busy(False)
    arm.trajectory_j_set_ratio(1.0)
    arm.move_jp([0, 0, 0.12, 0, 0, 0]).wait()
    wait_for(lambda: not (arm.is_busy() or arm.measured_jv()[0].any()), 60, "it stands")
    words = [arm.operating_state()[0], arm.is_homed(), arm.is_busy(), arm.joint_names(), arm.reference_frame(),
             arm.trajectory_j_get_ratio(), arm.tool()[0], arm.crtk_version()]
    numbers = [pose, start, joints, angles, state.position, arm.jaw.measured_jp()[0], arm.body.jacobian()[0],
               arm.spatial.measured_cf()[0], arm.measured_cv()[0], arm.forward_kinematics([0, 0, 0.12, 0, 0, 0])]
    arm.disable()
    return [*words, arm.is_enabled(), *(np.round(each, 4) + 0.0 for each in numbers)]


def test_a_script_sees_the_same_from_elsewhere(shared: tuple[Robot, str]) -> None:
    robot, at = shared
    with trocar.psm("PSM1", at=at, timeout=60.0) as arm:
        elsewhere = seen(arm)
    with trocar.psm("PSM1", robot.name) as arm:
        here = seen(arm)
        with trocar.system(at=at, timeout=60.0) as system:
            assert system.arms() == ["MTMR", "PSM1"] and system.name == robot.name
            system.home()
            assert arm.is_homed()
            system.power_off()
            assert arm.is_disabled()
    logs = ("logs", "PSM1", "--commands", "-n", "200")
    asked = [json.loads(line) for line in robot.trocar(*logs, "--json").splitlines()]
    refused = max(k for k, row in enumerate(asked) if row["outcome"] == "refused" and "finite" in row["reason"])
    assert asked[refused]["command"] == "move_jr" and asked[-1]["command"] != "move_jr" and refused < len(asked) - 5
    assert "finite" in robot.trocar(*logs)
    for one, other in zip(elsewhere, here, strict=True):
        assert np.array_equal(one, other, equal_nan=True) if isinstance(one, np.ndarray) else one == other
    with trocar.system(at=at, timeout=60.0):  # so that the bridge stays
        with pytest.raises(trocar.Problem, match="no arm PSM9; did you mean PSM1"):
            trocar.arm("PSM9", at=at, timeout=60.0)
        with pytest.raises(trocar.Problem, match="is not of type ECM"):
            trocar.ecm("PSM1", at=at, timeout=60.0)


def test_a_master_is_driven_from_elsewhere(shared: tuple[Robot, str]) -> None:
    robot, at = shared
    with trocar.mtm("MTMR", at=at, timeout=60.0) as mtm:
        mtm.home()
        mtm.body.servo_cf([0, 0, 0, 0, 0, 0])
        mtm.lock_orientation_as_is()
        place, _ = mtm.measured_cp()
        mtm.servo_ci(trocar.Impedance(force_position=place[:3, 3]))
        assert mtm.gripper.measured_jp()[0].shape == (1,) and mtm.orientation_locked() in (True, False)
        mtm.hold()
        robot.kill("socket_bridge")
        with pytest.raises(trocar.Problem, match="gone"):
            while True:
                mtm.is_homed()
    with trocar.mtm("MTMR", at=at, timeout=30) as mtm:
        assert mtm.is_homed()


def test_a_console_is_operated_from_elsewhere(shared: tuple[Robot, str]) -> None:
    robot, at = shared
    robot.trocar("send", "system", "home", "--wait")
    with trocar.console(at=at, timeout=60.0) as console, trocar.console("console", robot.name) as same:
        assert console.teleops() == same.teleops() and "MTMR_PSM1" in console.teleops()
        assert console.teleop_is_selected("MTMR_PSM1")
        with pytest.raises(trocar.Problem, match="no teleoperation x"):
            same.teleop_is_selected("x")
        console.teleop_set_scale(0.3)
        wait_for(lambda: console.teleop_get_scale() == same.teleop_get_scale() == 0.3, 20, "its scale")
        with trocar.teleop("MTMR_PSM1", at=at, timeout=60.0) as teleop:
            wait_for(lambda: teleop.get_scale() == 0.3, 20, "the scale of its teleoperation")
            assert teleop.current_state() == "DISABLED" and not teleop.following()
            with pytest.raises(ValueError, match="ALIGNING_MTM"):
                teleop.wait_for_state("FOLLOWING", 60)
            console.teleop_start()
            console.emulate_operator_present()
            teleop.wait_for_state("ENABLED", 60)
            assert console.operator_present() and teleop.desired_state() == "ENABLED"
            assert isinstance(teleop.reason(), str)
            same.teleop_stop()
            teleop.wait_for_state("DISABLED", 60)
        assert not console.teleop_enabled()
    with pytest.raises(trocar.Problem, match="no teleop nobody; there are: MTMR_PSM1"):
        trocar.teleop("nobody", at=at, timeout=60.0)


def test_moves_are_awaited(shared: tuple[Robot, str]) -> None:
    robot, at = shared
    ticks = []

    async def tick() -> None:
        while True:
            ticks.append(1)
            await asyncio.sleep(0.01)

    async def both() -> None:
        ticking = asyncio.ensure_future(tick())
        with trocar.psm("PSM1", robot.name) as here, trocar.psm("PSM1", at=at, timeout=60.0) as there:
            here.home()
            for arm in (here, there):
                handle = arm.move_jp([0.3, 0, 0.12, 0, 0, 0])
                handle.wait(is_busy=True)
                await handle
                assert abs(arm.measured_jp()[0][0] - 0.3) < 1e-3
                await arm.move_jp([0, 0, 0.12, 0, 0, 0])
            there.trajectory_j_set_ratio(SLOW)
            lost = there.move_jp([0.3, 0, 0.12, 0, 0, 0])
            there.hold()
            with pytest.raises(trocar.Refused):
                await lost
            there.trajectory_j_set_ratio(1.0)
        ticking.cancel()

    asyncio.run(both())
    assert len(ticks) > 20


def test_setup_joints_are_placed_from_elsewhere(shared: tuple[Robot, str]) -> None:
    robot, at = shared
    with trocar.suj(at=at, timeout=60.0) as suj:
        suj.home()
        assert "PSM1" in suj.arms()
        with trocar.suj("SUJ", robot.name) as same:
            assert same.arms() == suj.arms() and same.reference_arm() == suj.reference_arm()
        suj.PSM2.servo_jp([0.1, 0.2, 1.5, -0.1, 0.4, 0.0])
        wait_for(lambda: np.allclose(suj.PSM2.measured_jp()[0], [0.1, 0.2, 1.5, -0.1, 0.4, 0.0]), 60, "its place")
        assert suj.PSM2.local.measured_cp()[0].shape == (4, 4)


def test_events_and_sounds_are_the_same_from_elsewhere(shared: tuple[Robot, str]) -> None:
    robot, at = shared
    with trocar.psm("PSM1", robot.name) as here, trocar.psm("PSM1", at=at, timeout=60.0) as there, \
            trocar.system(robot.name) as system, trocar.system(at=at, timeout=60.0) as same, \
            trocar.console(at=at, timeout=60.0) as console:
        seen: dict[str, list[Any]] = {"here": [], "there": [], "volume": [], "present": []}
        here.on_event("operating_state", seen["here"].append)
        there.on_event("operating_state", seen["there"].append)
        same.on_event("volume", seen["volume"].append)
        console.on_event("operator_present", seen["present"].append)
        for each in (here, there):
            with pytest.raises(trocar.Problem, match="did you mean operating_state"):
                each.on_event("operating_stat", print)
        here.disable()
        here.home()
        wait_for(lambda: here.process_events() + there.process_events() == 0 and seen["there"] == seen["here"], 20,
                 "the same events")
        assert [event["state"] for event in seen["here"]][-1] == "ENABLED" and seen["here"][-1]["is_homed"]
        system.set_volume(0.3)
        same.beep(0.05)
        same.string_to_speech("hello")
        wait_for(lambda: same.volume() == 0.3, 20, "the volume")
        assert same.process_events() == 1 and seen["volume"][0]["volume"] == 0.3
        console.emulate_operator_present()
        assert console.process_events(20) == 1 and seen["present"][0]["operator_present"] is True
        there.check_connections()


def test_words_are_awaited_here_and_elsewhere(shared: tuple[Robot, str]) -> None:
    robot, at = shared

    async def story(**where: Any) -> list[str]:
        states = []
        async with trocar.aio(trocar.psm, "PSM1", **where) as psm:

            async def listen() -> None:
                async for name, _ in psm.events("operating_state", "goal_reached"):
                    states.append(name)
                    if name == "goal_reached":
                        return

            listening = asyncio.ensure_future(listen())
            await psm.home()
            while not listening.done():
                await psm.move_jp([0.1, 0, 0.12, 0, 0, 0])
                await psm.move_jp([0.0, 0, 0.12, 0, 0, 0])
            assert (await psm.measured_jp())[0][2] == pytest.approx(0.12)
            await psm.trajectory_j_set_ratio(SLOW)
            moving = asyncio.ensure_future(psm.move_jp([0.5, 0, 0.2, 0, 0, 0]))
            while not await psm.is_busy():
                await asyncio.sleep(0.001)
            await psm.hold()
            with pytest.raises(trocar.Refused):
                await moving
            await psm.trajectory_j_set_ratio(1.0)
            await psm.disable()
        return states

    for where in ({"system": robot.name}, {"at": at, "timeout": 60.0}):
        assert asyncio.run(story(**where))[-1] == "goal_reached"
