"""Two masters that carry the camera; on a fake clock."""

from __future__ import annotations

import numpy as np
import pytest

from tests.teleop.harness import EcmTheatre


@pytest.fixture
def theatre() -> EcmTheatre:
    made = EcmTheatre()
    assert made.console is not None
    made.console.set(operator_present=False)  # the head sensor is not asked
    made.state_command("enable")
    made.run(0.005)
    assert made.following, made.text("reason")
    return made


def test_masters_are_let_go_with_their_orientations_locked(theatre: EcmTheatre) -> None:
    for name in ("MTML", "MTMR"):
        assert theatre.arms[name].words()[:4] == ["body/set_cf_orientation_absolute", "body/servo_cf",
                                                  "use_gravity_compensation", "lock_orientation"]


def test_the_ecm_goes_against_the_hands(theatre: EcmTheatre) -> None:
    for name in ("MTML", "MTMR"):
        theatre.arms[name].shift(0.02, 0, 0)
    theatre.step()
    assert theatre.slave.asked("servo_jp")[-1][1] == pytest.approx((-0.049958, 0, 0.12 - 0.000099, 0), abs=1e-6)
    assert theatre.record.field("goal_jp")[0] == pytest.approx(-0.049958, abs=1e-6)
    assert theatre.arms["MTML"].asked("lock_orientation")[-1][1][1] == pytest.approx(np.sin(0.049958 / 2), abs=1e-6)


def test_hands_spread_are_pulled_together_with_forces_that_end(theatre: EcmTheatre) -> None:
    theatre.arms["MTML"].shift(0.01, 0, 0)
    theatre.arms["MTMR"].shift(-0.01, 0, 0)
    theatre.step()
    assert theatre.arms["MTML"].asked("body/servo_cf")[-1][1] == pytest.approx((-1.5, 0, 0, 0, 0, 0, 0.03), abs=1e-9)
    assert theatre.arms["MTMR"].asked("body/servo_cf")[-1][1] == pytest.approx((1.5, 0, 0, 0, 0, 0, 0.03), abs=1e-9)
    theatre.state_command("disable")
    assert theatre.arms["MTML"].words()[-4:] == ["body/servo_cf", "use_gravity_compensation",
                                                 "body/set_cf_orientation_absolute", "hold"]


def test_masters_elsewhere_are_refused_in_words() -> None:
    theatre = EcmTheatre()
    theatre.arms["MTML"].shift(0.5, 0, 0)
    theatre.state_command("enable")
    theatre.run(0.005)
    assert theatre.text("state") == "DISABLED" and theatre.text("reason").startswith("MTML is at (0.650,")


def test_the_clutch_begins_from_a_new_place(theatre: EcmTheatre) -> None:
    theatre.send("clutch", 1)
    assert not theatre.following and theatre.slave.words()[-1] == "hold"
    theatre.arms["MTML"].shift(0, 0.05, 0)
    theatre.forget()
    theatre.run(0.02)
    assert not theatre.slave.sent
    theatre.send("clutch", 0)
    theatre.run(0.005)
    assert theatre.following
    assert theatre.slave.asked("servo_jp")[-1][1] == pytest.approx((0, 0, 0.12, 0), abs=1e-9)


def test_another_scale_moves_nothing(theatre: EcmTheatre) -> None:
    for name in ("MTML", "MTMR"):
        theatre.arms[name].shift(0.0, 0, 0.05)
    theatre.step()
    before = theatre.slave.asked("servo_jp")[-1][1]
    assert theatre.send("set_scale", 0.5).outcomes == ["done"]
    assert theatre.slave.asked("servo_jp")[-1][1] == pytest.approx(before, abs=1e-9)


def test_a_silent_console_or_an_arm_in_trouble_ends_it(theatre: EcmTheatre) -> None:
    theatre.console_alive = False
    theatre.run(0.04)
    assert theatre.text("state") == "DISABLED" and not theatre.following
    theatre.console_alive = True
    theatre.run(0.01)
    theatre.state_command("enable")
    theatre.run(0.01)
    assert theatre.following
    theatre.arms["MTMR"].fail("MTMR: lost power")
    theatre.step()
    assert not theatre.following


def test_it_aligns_nothing_and_locks_nothing(theatre: EcmTheatre) -> None:
    assert theatre.state_command("align_MTM").outcomes == ["refused"]
    assert theatre.send("lock_rotation", 1).outcomes == ["refused"]
    assert theatre.following


def test_masters_that_are_played_are_left_to_who_moves_them(theatre: EcmTheatre) -> None:
    for name in ("MTML", "MTMR"):
        theatre.arms[name].ring.set(simulated=True)
    theatre.forget()
    theatre.arms["MTML"].shift(0.02, 0, 0)
    theatre.run(0.1)
    assert theatre.slave.asked("servo_jp") and not theatre.arms["MTML"].sent


def test_a_camera_at_its_limit_goes_on_following_and_says_so(theatre: EcmTheatre) -> None:
    theatre.slave.says["servo_jp"] = "clipped: insertion"
    theatre.run(0.005)
    assert theatre.following and theatre.text("reason") == "ECM at its limit: insertion"
