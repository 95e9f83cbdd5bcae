"""Where setup joints put the arms they carry: numbers of the original, the reference arm, and what is not known."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests import stock
from tests.suj.harness import FakeMemory, SetupHarness, system_of
from trocar.procs.document.system import Cart
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import inverse, pose_from_matrix
from trocar.shm.topics import SUJ_STATE

ECM_TIP = np.array(((0.0, 1.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
NAMES = ("ECM", "PSM1", "PSM2", "PSM3")
SUJ = '{"name": "SUJ", "type": "SUJ_Classic", "simulation": "KINEMATIC", "arm_file": "arm/suj-simulated.json"}'
CARRIED = ", ".join(
    f'{{"name": "{name}", "type": "{name[:3]}", "simulation": "KINEMATIC", "arm_file": "arm/{file}.json",'
    f' "base_frame": {{"component": "SUJ", "interface": "{name}"}}}}'
    for name, file in (("ECM", "ECM_KIN_SIMULATED_STRAIGHT"), *(
        (psm, "PSM_KIN_SIMULATED_LARGE_NEEDLE_DRIVER_400006") for psm in NAMES[1:])))


@pytest.fixture(scope="module")
def tips() -> dict[str, np.ndarray]:
    """ECM at (0, 0, 0.12, 0), PSMs at (0, 0, 0.12, 0, 0, 0)."""
    ecm = Kinematics(stock.chain("ECM"), tip=ECM_TIP).fk(np.array((0, 0, 0.12, 0.0))).copy()
    psm = Kinematics(stock.chain("PSM"), stock.tool("LARGE_NEEDLE_DRIVER_400006")).fk(
        np.array((0, 0, 0.12, 0, 0, 0.0))).copy()
    return {"ECM": ecm, "PSM1": psm, "PSM2": psm, "PSM3": psm}


@pytest.fixture
def cart(tmp_path) -> Cart:
    return system_of(tmp_path, f"{SUJ}, {CARRIED}").cart("SUJ")


def measured(harness: SetupHarness, name: str, tips: dict[str, np.ndarray]) -> np.ndarray:
    return pose_from_matrix(harness.base(name)[0] @ tips[name])


def test_original_routines_agree_on_every_chain(cart: Cart) -> None:
    lines = stock.find("golden/kinematics/suj_fk.jsonl").read_text().splitlines()
    chains = {arm.name: Kinematics(arm.chain) for arm in cart.arms}
    compared = 0
    for line in lines:
        row = json.loads(line)
        if row["file"] == "arm/suj-simulated.json":
            assert np.allclose(chains[row["arm"]].fk(np.array(row["q"])), row["fk"], atol=1e-9)
            compared += 1
    assert compared > 10


@pytest.mark.parametrize(("name", "local"), [
    ("ECM", (0.060075, 1.242143, 0.994177)), ("PSM1", (-0.028795, 1.219772, 0.959059)),
    ("PSM2", (0.184254, 1.187733, 0.974223)), ("PSM3", (0.212812, 1.22536, 0.911495))])
def test_carried_arms_stand_where_the_original_puts_them(cart: Cart, name: str, local: tuple[float, ...]) -> None:
    harness = SetupHarness(cart)
    harness.step()
    assert np.allclose(harness.field("local_measured_cp")[harness.row(name), :3], local, atol=1e-6)
    assert harness.field("setup_valid").all() and harness.field("simulated").item()


@pytest.mark.parametrize(("name", "pose"), [
    ("ECM", (0.055999, 1.156901, 0.908821, 0.923635, -0.022072, -0.009141, 0.382527)),
    ("PSM1", (-0.062668, -0.075188, 0.009377, 0.277057, 0.206014, -0.270271, 0.89875)),
    ("PSM2", (0.081629, -0.041172, 0.011897, 0.326857, 0.148334, -0.813917, 0.456838)),
    ("PSM3", (0.139604, -0.126381, 0.028876, 0.184702, 0.306649, -0.873956, 0.328714))])
def test_tips_are_where_the_original_sees_them(
        cart: Cart, tips: dict[str, np.ndarray], name: str, pose: tuple[float, ...]) -> None:
    harness = SetupHarness(cart)
    harness.tips(**tips)
    harness.step()
    assert harness.base(name)[1:] == (True, "Cart" if name == "ECM" else "ECM")
    assert np.allclose(measured(harness, name, tips), pose, atol=1e-6)


def test_base_frames_follow_the_reference_arms_tip(cart: Cart, tips: dict[str, np.ndarray]) -> None:
    harness = SetupHarness(cart)
    harness.tips(**tips)
    harness.step()
    before = harness.base("PSM1")[0].copy()
    moved = tips["ECM"].copy()
    moved[:3, 3] += 0.01
    harness.tips(ECM=moved)
    harness.step()
    c = inverse(harness.base("ECM")[0] @ moved) @ (harness.base("ECM")[0] @ tips["ECM"])
    assert np.allclose(harness.base("PSM1")[0], c @ before, atol=1e-12)


def test_another_reference_arm_changes_all_frames(cart: Cart, tips: dict[str, np.ndarray]) -> None:
    harness = SetupHarness(cart)
    harness.tips(**tips)
    harness.step()
    in_ecm = {name: measured(harness, name, tips) for name in NAMES}
    assert harness.ask("set_reference_arm", "PSM1").outcome == "done"
    assert [harness.base(name)[1:] for name in NAMES] == [
        (True, "PSM1"), (True, "Cart"), (True, "PSM1"), (True, "PSM1")]
    assert harness.field("reference_arm").item() == b"PSM1"
    tip = harness.base("PSM1")[0] @ tips["PSM1"]
    for name in ("ECM", "PSM2", "PSM3"):
        local = harness.joints._setups.local[harness.row(name)]
        assert np.allclose(harness.base(name)[0], inverse(tip) @ local, atol=1e-12)
    assert harness.ask("set_reference_arm", "ECM").outcome == "done"
    assert all(np.allclose(measured(harness, name, tips), in_ecm[name], atol=1e-12) for name in NAMES)
    refused = harness.ask("set_reference_arm", "PSM4")
    assert refused.answers == [("refused", "set_reference_arm: no setup arm PSM4; there are ECM, PSM1, PSM2, PSM3")]


def test_bases_are_unknown_while_the_reference_tip_is(cart: Cart, tips: dict[str, np.ndarray]) -> None:
    harness = SetupHarness(cart)
    harness.step()
    assert [harness.base(name)[1] for name in NAMES] == [True, False, False, False], "the ECM has not shown anything"
    harness.tips(**tips)
    harness.step()
    assert all(harness.base(name)[1] for name in NAMES)
    harness.rings["ECM"].field("cartesian_valid")[...] = False
    harness.step()
    assert [harness.base(name)[1] for name in NAMES] == [True, False, False, False], "not homed"
    harness.rings["ECM"].field("cartesian_valid")[...] = True
    harness.step()
    harness.rings["ECM"].stamp_ns = 0  # its process has died
    harness.step(ms=60)
    assert [harness.base(name)[1] for name in NAMES] == [True, False, False, False], "too old"


def test_without_an_arm_on_the_reference_all_stand_in_the_cart(tmp_path) -> None:
    harness = SetupHarness(system_of(tmp_path, SUJ).cart("SUJ"))
    harness.step()
    for name in NAMES:
        base, valid, frame = harness.base(name)
        assert (valid, frame) == (True, "Cart") and np.allclose(base, harness.joints._setups.local[harness.row(name)])


def test_simulated_joints_go_where_they_are_told(cart: Cart, tips: dict[str, np.ndarray]) -> None:
    harness = SetupHarness(cart)
    harness.tips(**tips)
    goal = (0.1, 0.2, -0.3, 0.4, -0.5, 0.6)
    assert harness.ask("servo_jp", "PSM2", *goal).outcome == "done"
    assert np.allclose(harness.field("position")[2, :6], goal)
    arm = cart.arms[2]
    local = np.array(arm.world) @ Kinematics(arm.chain).fk(np.array(goal)) @ np.array(arm.tip)
    assert np.allclose(harness.joints._setups.local[2], local, atol=1e-12)
    assert harness.ask("move_jp", "PSM2", *([0.0] * 6)).outcome == "done"
    for text, values in (("PSM2", (1.0,)), ("PSM2", (np.nan,) * 6), ("", goal), ("PSM2", (1e9,) * 6)):
        assert harness.ask("servo_jp", text, *values).outcome == "refused"
    assert not harness.field("position")[2].any(), "nothing of what was refused was taken"
    for name, text in (("local/servo_cp", "PSM2"), ("clutch", "PSM2"), ("set_lift_velocity", "")):
        assert harness.ask(name, text, *((1.0,) if name != "local/servo_cp" else (0, 0, 0, 0, 0, 0, 1))).outcome == (
            "refused")


def test_a_restart_goes_on_from_the_record(cart: Cart, tips: dict[str, np.ndarray]) -> None:
    harness = SetupHarness(cart)
    harness.tips(**tips)
    harness.ask("state_command", "home")
    harness.ask("servo_jp", "PSM2", 0.1, 0.2, -0.3, 0.4, -0.5, 0.6)
    harness.ask("set_reference_arm", "PSM3")
    bases = harness.field("measured_cp").copy()
    again = SetupHarness(cart, memory=harness.memory)
    again.tips(**tips)
    again.step()
    assert np.allclose(again.field("measured_cp"), bases, atol=1e-12)
    assert (again.field("sub_state").item(), again.field("is_homed").item()) == (b"ENABLED", True)


def test_a_first_start_takes_nothing_from_an_empty_record(cart: Cart) -> None:
    harness = SetupHarness(cart, memory=FakeMemory(SUJ_STATE, setups=4))
    harness.step()
    assert harness.field("sub_state").item() == b"DISABLED" and np.allclose(
        harness.field("position")[0, :6], cart.arms[0].position)


# -- fixed -------------------------------------------------------------------------------------------------------------

FIXED = '{"name": "SUJ", "type": "SUJ_Fixed", "arm_file": "arm/suj-fixed-simulated.json"}'


def test_fixed_arms_stand_where_the_file_says_or_where_they_are_put(tmp_path) -> None:
    harness = SetupHarness(system_of(tmp_path, FIXED).cart("SUJ"))
    harness.step()
    assert np.array_equal(harness.field("local_measured_cp")[:, :3], [(0, 0, 0), (0, 1, 0), (0, 2, 0), (0, 0, 3)])
    pose = (0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5)
    assert harness.ask("local/servo_cp", "PSM1", *pose).outcome == "done"
    assert np.allclose(harness.field("local_measured_cp")[1], pose) and harness.field("setup_valid").all()
    for values in ((0.1,), (0, 0, 0, 0, 0, 0, 0), (np.nan, 0, 0, 0, 0, 0, 1)):
        assert harness.ask("local/servo_cp", "PSM1", *values).outcome == "refused"
    assert harness.ask("servo_jp", "PSM1", *([0.0] * 6)).outcome == "refused"
    again = SetupHarness(harness.cart, memory=harness.memory)
    again.step()
    assert np.allclose(again.field("local_measured_cp")[1], pose), "after a restart, too"


def test_fixed_files_may_name_the_reference_as_they_used_to(tmp_path) -> None:
    text = stock.find("dvrk-share/arm/suj-fixed-simulated.json").read_text()
    (tmp_path / "fixed.json").write_text(text.replace('"arms":', '"reference-arm": "PSM2", "arms":', 1))
    cart = system_of(tmp_path, FIXED.replace("arm/suj-fixed-simulated.json", "fixed.json")).cart("SUJ")
    assert cart.reference == "PSM2"
