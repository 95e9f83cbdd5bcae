"""Where pages draw arms: by the chain that the arm itself goes by."""

from __future__ import annotations

import dataclasses
import json
from contextlib import closing

import numpy as np
import pytest

from tests.conftest import World
from tests.gui.test_browsers import Console, play
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.scene_source import SceneCart, SceneSource, frames_of, joint_velocity, setup_frames, slowed
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.inverse.arms import carrying, inverse_carrying
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.procs.suj.setups import Setups
from trocar.procs.supervisor import memory
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.shm.memory.parts import remove_all
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns


@pytest.fixture(scope="module")
def full() -> SystemConfig:
    loaded = load_system(PROJECT_CONFIGS / "systems" / "kinematic-full.yaml")
    assert loaded.system is not None
    return loaded.system


def test_the_last_frame_is_the_tip_and_the_first_the_base(full: SystemConfig) -> None:
    base = matrix_from_pose(np.array((0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8)))
    for arm in full.arms:
        kinematics = carrying(arm, arm.tool.name if arm.tool is not None else arm.endoscope)
        q = 0.5 * (kinematics.lower + kinematics.upper) + 0.1 * (kinematics.upper - kinematics.lower)
        frames = np.reshape(frames_of(kinematics, q, base), (-1, 7))
        assert len(frames) == kinematics.n + 2
        assert np.allclose(matrix_from_pose(frames[0]), base, atol=1e-4)
        assert np.allclose(matrix_from_pose(frames[-1]), base @ kinematics.fk(q), atol=1e-4), arm.name


def test_a_preview_says_what_is_beyond_a_limit_and_asks_the_arm_for_nothing(world: World) -> None:
    async def story(console: Console) -> None:
        console.robot.show_arm(0.1)
        console.robot.arm.field("tool")[...] = b"TEST:1"
        console.robot.arm.publish(1)
        browser, page = console.page()
        answer = await console.ask(browser, page, "preview", arm="PSM1", position=[0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
        found = json.loads(answer["text"])
        assert found["beyond"] == [False] * 4 + [True, False] and len(found["frames"]) == 8 * 7
        assert found["seconds"] > 0.5
        answer = await console.ask(browser, page, "preview", arm="PSM1", position=[0.0])
        assert answer["outcome"] == "refused" and "6 joints" in answer["text"]
        assert "no arm PSM7" in (await console.ask(browser, page, "preview", arm="PSM7", position=[]))["text"]
        assert not list(console.robot.mailbox.drain())

    play(world.name, story)


@pytest.mark.parametrize("axis", range(6))
def test_a_jog_of_the_tip_goes_along_its_axis(full: SystemConfig, axis: int) -> None:
    base = matrix_from_pose(np.array((0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8)))
    twist = np.zeros(6)
    twist[axis] = 0.01
    for arm in full.arms:
        kinematics = carrying(arm, arm.tool.name if arm.tool is not None else arm.endoscope)
        if kinematics.n < 6 and axis >= 3:
            continue
        q = 0.5 * (kinematics.lower + kinematics.upper) + 0.1 * (kinematics.upper - kinematics.lower)
        velocity = joint_velocity(kinematics, q, twist, base[:3, :3])
        begin, end = (base @ kinematics.fk(at).copy() for at in (q, q + 0.01 * velocity))
        moved = (end - begin)[:3, 3] / 0.01
        assert np.allclose(moved, twist[:3], atol=1e-3), (arm.name, moved)
        if kinematics.n >= 6:
            turned = (end @ np.linalg.inv(begin))[:3, :3] / 0.01
            assert np.allclose((turned[2, 1], turned[0, 2], turned[1, 0]), twist[3:], atol=1e-3), (arm.name, turned)
        assert np.abs(joint_velocity(kinematics, q, twist, None) - velocity).max() > 1e-6


def test_an_arm_whose_joints_are_not_known_says_so(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()
        console.robot.show_arm(0.1)
        browser.handle(json.dumps({"op": "want", "sources": ["scene"]}))
        for known in (True, False):
            console.robot.show_arm(0.1, valid=known)
            await console.tick()
            assert page.last("tick")["data"]["scene"]["arms"]["PSM1"]["valid"] is known

    play(world.name, story)


def test_joints_are_found_for_the_tip_of_every_arm(full: SystemConfig) -> None:
    for arm in full.arms:
        carried = arm.tool.name if arm.tool is not None else arm.endoscope
        kinematics, solver = carrying(arm, carried), inverse_carrying(arm, carried)
        q = 0.5 * (kinematics.lower + kinematics.upper) + 0.1 * (kinematics.upper - kinematics.lower)
        goal = kinematics.fk(q).copy()
        assert solver.solve(goal, q + 0.05), (arm.name, solver.reason)
        assert np.allclose(kinematics.fk(solver.q), goal, atol=1e-6), arm.name


def test_a_preview_of_a_pose_says_why_there_is_none(world: World) -> None:
    async def story(console: Console) -> None:
        browser, page = console.page()

        async def answer(*pose: float) -> str:
            found = await console.ask(browser, page, "preview", arm="PSM1", pose=pose)
            assert found["outcome"] == "refused"
            return str(found["text"])

        console.robot.show_arm(0.1, valid=False)
        assert "tip is not known" in await answer(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        console.robot.show_arm(0.1)
        assert "7 numbers" in await answer(0.0, 0.0, 0.0)
        assert "no inverse kinematics" in await answer(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "no instrument"

    play(world.name, story)


def test_setup_arms_end_where_the_arms_that_they_carry_begin(full: SystemConfig, world: World) -> None:
    document = dataclasses.replace(full, name=world.name)
    memory.create_all(document)
    try:
        cart = document.carts[0]
        record = directory.writer(world.name, cart.name, "state", "suj")
        setups = Setups(cart, record.field)
        for place, arm in enumerate(cart.arms):
            setups.set_joints(place, np.array(arm.position) + 0.05)
        setups.lose(1, moved=True)
        record.publish(monotonic_ns())
        with closing(SceneCart(world.name, cart)) as scene:
            shown = scene.read(monotonic_ns())
            for place, arm in enumerate(cart.arms):
                ends = matrix_from_pose(np.array(shown[arm.name]["frames"][-7:]))
                assert np.allclose(ends, setups.local[place], atol=1e-4), arm.name
                assert shown[arm.name]["valid"] is (place != 1) and not shown[arm.name]["late"]
                assert shown[arm.name]["carries"] == arm.carries
            assert all(row["late"] for row in scene.read(monotonic_ns() + 10**9).values())
        record.close()
    finally:
        remove_all(world.name)


def test_a_pose_that_a_program_shows_is_drawn_while_the_system_says_so(full: SystemConfig, world: World) -> None:
    document = dataclasses.replace(full, name=world.name)
    memory.create_all(document)
    try:
        with (closing(directory.writer(world.name, "system", "state", "system")) as record,
              closing(SceneSource(document)) as scene):
            assert scene.read(monotonic_ns())["shown"] is None, "nothing was published yet"

            def shown(name: str, *position: float, after_ns: int = 0) -> object:
                record.field("shown_arm")[...] = name.encode()
                record.field("shown_position")[...] = np.nan
                record.field("shown_position")[: len(position)] = position
                record.publish(monotonic_ns())
                scene.read(monotonic_ns())
                return scene.read(monotonic_ns() + after_ns)["shown"]

            arm = full.arm("PSM1")
            kinematics = carrying(arm, "")
            q = np.zeros(kinematics.n)
            q[:3] = 0.2, -0.1, 0.05
            assert shown("PSM1", *q[:3]) == {"name": "PSM1", "frames": frames_of(kinematics, q, np.eye(4))}
            assert shown("PSM1", *q[:3], after_ns=10**9) is None, "the record is old: the system has crashed"
            cart, setup = full.carts[0], full.carts[0].arms[1]
            assert setup.chain is not None
            place = np.full(setup.joints, 0.3)
            assert shown(f"{cart.name}/{setup.name}", *place) == {
                "name": f"{cart.name}/{setup.name}", "frames": setup_frames(setup, Kinematics(setup.chain), place)}
            assert shown("") is None and shown("nothing like that", 0.1) is None
    finally:
        remove_all(world.name)


def test_walls_of_an_arm_are_where_its_record_has_them_and_light_up_when_it_is_near(
        full: SystemConfig, world: World) -> None:
    document = dataclasses.replace(full, name=world.name)
    memory.create_all(document)
    try:
        with (closing(directory.writer(world.name, "PSM1", "walls", "arm")) as record,
              closing(SceneSource(document)) as scene):
            assert scene.read(1)["walls"]["PSM1"] == {}, "nothing was published yet"
            rows = ((b"table", b"plane", 0.005, True), (b"arms", b"arms", 0.001, True), (b"far", b"sphere", 0.5, True),
                    (b"off", b"sphere", np.nan, False), (b"beyond", b"sphere", -0.001, True),
                    (b"spoiled", b"sphere", 0.0, True))
            record.field("count")[...] = len(rows)
            for place, row in enumerate(rows):
                for name, value in zip(("name", "shape", "distance", "active"), row, strict=True):
                    record.field(name)[place] = value
                record.field("frame")[place] = b"base"
                record.field("pose")[place] = (0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0)
                record.field("size")[place, 0] = 0.02
            record.field("pose")[len(rows) - 1, 3:] = 0.0
            record.field("stopped_by")[...] = b"beyond"
            record.publish(1)
            shown = scene.read(1)["walls"]["PSM1"]
            assert shown["at"] == "beyond" and scene.read(1)["walls"]["PSM2"] == {}
            assert {row["name"]: row["near"] for row in shown["walls"]} == {
                "table": pytest.approx(0.75), "far": 0.0, "off": None, "beyond": 1.0}, "other arms are drawn already"
            assert shown["walls"][1]["size"] == (0.02,) and shown["walls"][0]["pose"][2] == -0.1
    finally:
        remove_all(world.name)


def test_a_setup_arm_begins_where_its_cart_holds_it(full: SystemConfig) -> None:
    for arm in full.carts[0].arms:
        assert arm.chain is not None and arm.world is not None
        frames = np.reshape(setup_frames(arm, Kinematics(arm.chain), np.array(arm.position)), (-1, 7))
        assert np.allclose(matrix_from_pose(frames[0]), np.array(arm.world), atol=1e-4), arm.name
        assert len(frames) == len(arm.chain.links) + 2


def test_a_jog_of_the_tip_asks_no_joint_for_more_than_moves_do() -> None:
    most = ARM_TYPES["PSM"].moves.velocity
    slow = np.array((0.1, -0.2, 0.05, 1.0, 2.0, 3.0, 4.0, 4.0))
    assert slowed(slow, most) == pytest.approx(slow)
    fast = slowed(40.0 * slow, most)
    assert fast / fast[0] == pytest.approx(slow / slow[0]), "in the same direction"
    assert np.abs(fast[:7] / most).max() == pytest.approx(1.0)
