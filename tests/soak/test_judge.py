"""The judge of the storm on records made by hand: it sees what is wrong, and nothing where all is well."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.soak.diary import Diary, Entry
from tests.soak.judge import (
    LAG_NS,
    Ask,
    Attempt,
    Command,
    Intervention,
    LiftEnd,
    Loss,
    beyond_bounds,
    continued,
    lifts_on,
    lost_by_numbers,
    obtained,
    powered_by_nobody,
    too_fast,
    unprotected,
)
from tests.soak.motion import MotionTruth
from trocar.procs.config import load_system
from trocar.procs.document.system import SystemConfig
from trocar.procs.tables.codes import TRACKING
from trocar.tools.verbs.demo import SYSTEM

MS = 1_000_000
EPOCH_NS = 5_000_000_000
SECOND = 1000  # records
INSERTION, YAW, ROLL = 2, 0, 3


@pytest.fixture(scope="module")
def document() -> SystemConfig:
    loaded = load_system(SYSTEM, boards="emulated", name="judged").system
    assert loaded is not None
    return loaded


class JudgedWorld:
    """A second of truth in which both robots stand with power; tests change it."""

    def __init__(self, document: SystemConfig) -> None:
        self.robots = {name: MotionTruth(document, document.arm(name)) for name in ("MTMR", "PSM1")}
        axes = sum(len(robot.actuators) for io in document.ios for robot in io.robots)
        self.truth: Any = np.zeros(SECOND, dtype=[
            ("epoch", "<u8"), ("sequence", "<u8"), ("stamp_ns", "<i8"), ("position", "<f8", (axes,)),
            ("amp_on", "?", (axes,))])
        self.truth["epoch"] = 1
        self.truth["sequence"] = np.arange(1, SECOND + 1)
        self.truth["stamp_ns"] = EPOCH_NS + MS * np.arange(SECOND)
        self.truth["amp_on"] = True
        self.truth["position"][:, self.robots["PSM1"].axes][:, INSERTION] = 0.1
        self.part("PSM1", INSERTION)[:] = 0.1

    def part(self, robot: str, actuator: int) -> Any:
        return self.truth["position"][:, self.robots[robot].axes.start + actuator]

    def power(self, robot: str) -> Any:
        return self.truth["amp_on"][:, self.robots[robot].axes]

    def too_fast(self, robot: str, *asks: Ask, deaths: Any = ()) -> list[Any]:
        motions = {name: each.motion(self.truth, 0.001) for name, each in self.robots.items()}
        return too_fast(motions[robot], asks, list(motions.values()), deaths)

    def powered_by_nobody(self, robot: str, commands: Any = (), losses: Any = ()) -> list[Any]:
        return powered_by_nobody(self.robots[robot], self.truth, commands, losses)


@pytest.fixture
def world(document: SystemConfig) -> JudgedWorld:
    return JudgedWorld(document)


def ask(robot: str, *joints: float, end_ms: int = SECOND, begin_ms: int = 0, **more: Any) -> Ask:
    return Ask(robot, "asked", EPOCH_NS + begin_ms * MS, EPOCH_NS + end_ms * MS, joints, **more)


def test_robots_that_stand_are_no_violation(world: JudgedWorld) -> None:
    assert world.too_fast("PSM1") == world.too_fast("MTMR") == []


def test_a_jump_that_nobody_asked_for_is_seen_and_said(world: JudgedWorld) -> None:
    world.part("PSM1", INSERTION)[500:] += 0.001
    (found,) = world.too_fast("PSM1")
    assert (found.robot, found.mode, found.limit) == ("PSM1", "hold", pytest.approx(0.005))
    assert found.value == pytest.approx(0.1) and abs(found.stamp_ns - EPOCH_NS - 500 * MS) <= 10 * MS


def test_a_creep_of_five_millimetres_a_second_is_allowed_and_six_are_not(world: JudgedWorld) -> None:
    world.part("PSM1", INSERTION)[:] += 0.0049e-3 * np.arange(SECOND)
    assert world.too_fast("PSM1") == []
    world.part("PSM1", INSERTION)[:] += 0.0011e-3 * np.arange(SECOND)
    assert len(world.too_fast("PSM1")) == 1


def test_a_rotary_joint_is_judged_at_the_tip(world: JudgedWorld) -> None:
    reach = 0.1 - 0.0156 + 0.0091  # from the remote centre, insertion 0.1 m, Classic with its wrist straight
    speed = 0.0045 / reach
    world.part("PSM1", YAW)[:] = speed * 1e-3 * np.arange(SECOND)
    assert world.too_fast("PSM1") == []
    world.part("PSM1", YAW)[:] *= 1.3
    (found,) = world.too_fast("PSM1")
    assert found.value == pytest.approx(0.0045 * 1.3, rel=0.1)


def test_motion_that_was_asked_for_may_be_a_fifth_faster(world: JudgedWorld) -> None:
    asked = ask("PSM1", 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0)
    world.part("PSM1", INSERTION)[:] += 0.06e-3 * np.arange(SECOND)
    assert world.too_fast("PSM1", asked) == []
    world.part("PSM1", INSERTION)[:] += 0.01e-3 * np.arange(SECOND)
    assert len(world.too_fast("PSM1", asked)) == 1
    assert len(world.too_fast("PSM1", ask("MTMR", *(9.0,) * 7))) == 1, "it was another robot that was asked"


def test_what_goes_on_when_the_asking_is_over_is_seen(world: JudgedWorld) -> None:
    world.part("PSM1", INSERTION)[:] += 0.05e-3 * np.arange(SECOND)
    (found,) = world.too_fast("PSM1", ask("PSM1", 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, end_ms=300))
    assert found.mode == "hold" and abs(found.stamp_ns - EPOCH_NS - 300 * MS - LAG_NS) <= 20 * MS


def test_an_exact_limit_has_no_slack(world: JudgedWorld) -> None:
    world.part("PSM1", INSERTION)[:] += 0.062e-3 * np.arange(SECOND)
    joints = 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0
    assert world.too_fast("PSM1", ask("PSM1", *joints)) == []
    assert len(world.too_fast("PSM1", ask("PSM1", *joints, exact=True))) == 1


def test_efforts_of_a_dead_arm_may_act_until_io_holds(world: JudgedWorld) -> None:
    diary = Diary()
    diary.entries.append(Entry(EPOCH_NS + 500 * MS, "event", "kill -9 PSM1"))
    diary.entries.append(Entry(EPOCH_NS + 500 * MS, "event", "kill -9 the client (wrench)"))
    asked = ask("PSM1", 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, exact=True)
    insertion = world.part("PSM1", INSERTION)
    insertion[500:560] += 0.07e-3 * np.arange(60)
    insertion[560:] += 0.07e-3 * 60
    assert world.too_fast("PSM1", asked, deaths=diary.deaths("PSM1")) == []
    assert len(world.too_fast("PSM1", asked, deaths=diary.deaths("MTMR"))) == 1
    insertion[700:] += 0.07e-3 * np.arange(SECOND - 700)
    assert len(world.too_fast("PSM1", asked, deaths=diary.deaths("PSM1"))) == 1


def test_unpowered_motion_is_not_judged(world: JudgedWorld) -> None:
    world.power("PSM1")[400:700] = False
    world.part("PSM1", INSERTION)[450:650] += 0.1e-3 * np.arange(200)
    world.part("PSM1", INSERTION)[650:] += 0.02
    assert world.too_fast("PSM1") == []


def test_motion_is_judged_until_power_is_about_to_go(world: JudgedWorld) -> None:
    world.power("PSM1")[500:] = False
    world.part("PSM1", INSERTION)[470:] += 0.001
    assert world.too_fast("PSM1") == []
    world.part("PSM1", INSERTION)[440:] += 0.001
    assert len(world.too_fast("PSM1")) == 1


def test_motion_of_boards_that_begin_afresh_is_none(world: JudgedWorld) -> None:
    world.part("PSM1", INSERTION)[500:] += 0.05
    world.truth["epoch"][500:] = 2
    assert world.too_fast("PSM1") == []


def test_records_that_are_lost_are_no_motion(world: JudgedWorld) -> None:
    world.part("PSM1", INSERTION)[500:] += 0.05
    world.truth["sequence"][500:] += 70
    assert world.too_fast("PSM1") == []


def test_a_slave_may_go_as_fast_as_its_hand_and_no_lurch_more(world: JudgedWorld) -> None:
    asked = ask("PSM1", leader="MTMR", scale=0.2)
    world.part("MTMR", YAW)[:] = 0.2e-3 * np.arange(SECOND)
    hand = world.robots["MTMR"].motion(world.truth, 0.001).linear.max()
    assert hand > 0.05
    world.part("PSM1", INSERTION)[:] += 0.2 * hand * 1e-3 * np.arange(SECOND)
    assert world.too_fast("PSM1", asked) == []
    world.part("PSM1", INSERTION)[500:600] += 0.145e-3 * np.arange(100)
    world.part("PSM1", INSERTION)[600:] += 0.0145
    (found,) = world.too_fast("PSM1", asked)
    assert found.what.startswith("tip, m/s") and found.value > 0.145


def test_a_slave_that_turns_with_its_hand_may_swing_its_wrist_and_no_more(world: JudgedWorld) -> None:
    asked = ask("PSM1", leader="MTMR", scale=0.2)
    world.part("MTMR", 6)[:] = 0.6e-3 * np.arange(SECOND)  # on the spot
    assert world.robots["MTMR"].motion(world.truth, 0.001).linear.max() < 1e-6
    world.part("PSM1", INSERTION)[:] += 0.0115e-3 * np.arange(SECOND)
    assert world.too_fast("PSM1", asked) == []
    world.part("PSM1", INSERTION)[:] += 0.002e-3 * np.arange(SECOND)
    assert len(world.too_fast("PSM1", asked)) == 1


def test_a_slave_whose_wrist_spins_is_seen(world: JudgedWorld) -> None:
    world.part("PSM1", ROLL)[:] = 5.9e-3 * np.arange(SECOND)
    assert any(found.what.startswith("tip, rad/s") for found in world.too_fast("PSM1", ask("PSM1", leader="MTMR")))


def test_an_amplifier_that_comes_on_by_itself_is_seen(world: JudgedWorld) -> None:
    world.truth["amp_on"][:100] = False
    world.power("PSM1")[300:400] = False
    given = [Command("PSM1", EPOCH_NS + 50 * MS, "PSM1 enable"), Command("MTMR", EPOCH_NS + 50 * MS, "MTMR enable")]
    (found,) = world.powered_by_nobody("PSM1", given)
    assert found.stamp_ns == EPOCH_NS + 400 * MS and "PSM1 enable" in found.what
    assert world.powered_by_nobody("MTMR", given) == []
    again = [*given, Command("PSM1", EPOCH_NS + 350 * MS, "PSM1 enable")]
    assert world.powered_by_nobody("PSM1", again) == []
    assert len(world.powered_by_nobody("PSM1", [given[0], Command("MTMR", EPOCH_NS + 350 * MS, "")])) == 1


def test_one_amplifier_alone_counts_and_so_does_a_fault_without_power(world: JudgedWorld) -> None:
    given = [Command("PSM1", EPOCH_NS + 50 * MS, "PSM1 enable")]
    world.truth["amp_on"][:100] = False
    world.power("PSM1")[300:340, 4] = False
    assert world.powered_by_nobody("PSM1", given) == [], "io lets it blink"
    world.power("PSM1")[300:370, 4] = False
    assert [found.stamp_ns for found in world.powered_by_nobody("PSM1", given)] == [EPOCH_NS + 370 * MS]
    world.power("PSM1")[600:610] = False
    assert len(world.powered_by_nobody("PSM1", given)) == 2, "all of them at once are no blinking"
    stop = [Loss("PSM1", EPOCH_NS + 70 * MS, "emergency stop")]
    assert EPOCH_NS + 100 * MS in [found.stamp_ns for found in world.powered_by_nobody("PSM1", given, stop)]


def test_the_diary_ends_what_a_fault_ends_but_not_a_hand() -> None:
    diary = Diary()
    diary.ask("PSM1", "move", (1.0,))
    hand = diary.ask("PSM1", "hand", (1.0,), voidable=False)
    diary.ask("MTMR", "move", (1.0,))
    diary.ask("PSM1", "stream", (1.0,), stream=True)
    diary.void(["PSM1"], streams=False)
    never = diary.asks()[2].end_ns
    assert [ask.end_ns < never for ask in diary.asks()] == [True, False, False, False]
    diary.lose(["PSM1"], "amplifier fault")
    assert [ask.end_ns < never for ask in diary.asks()] == [True, False, False, True]
    hand.close()
    assert [ask.end_ns < never for ask in diary.asks()] == [True, True, False, True]


def test_a_joint_that_was_pushed_may_swing_out_when_a_stop_ends_the_push() -> None:
    diary = Diary()
    diary.ask("PSM1", "push", (1.0,), stream=True, settling_ns=150 * MS)
    diary.ask("PSM1", "stream", (1.0,), stream=True)
    diary.stop(["PSM1"], "hold")
    push, stream = diary.asks()
    assert 149 * MS < push.end_ns - stream.end_ns < 151 * MS


# -- setpoints, stops, wrong numbers, lifts, clients that may not power ------------------------------------------------

SPEED = np.full(7, 2.0)


class JudgedRecords:
    """A second of io's records, at 500 Hz, in which the slave's joints go nowhere; tests change it."""

    def __init__(self, world: JudgedWorld) -> None:
        robot, rows = world.robots["PSM1"], SECOND // 2
        self.robot, self.world, axes = robot, world, robot.axes.stop
        self.io: Any = np.zeros(rows, dtype=[
            ("epoch", "<u8"), ("stamp_ns", "<i8"), ("setpoint_position", "<f8", (axes,)), ("effort_mode", "?", (axes,)),
            *((name, "?", (2,)) for name in ("pid_enabled", "tracking_check")),
            *((name, "<u4", (2,)) for name in ("pid_generation", "bias_generation")), ("fault", "<u2", (2,))])
        self.io["stamp_ns"] = EPOCH_NS + 2 * MS * np.arange(rows)
        self.io["pid_enabled"] = self.io["tracking_check"] = True

    @property
    def yaw(self) -> Any:
        return self.io["setpoint_position"][:, self.robot.axes.start + YAW]

    def mine(self, name: str) -> Any:
        return self.io[name][:, self.robot.place]

    def beyond_bounds(self) -> list[Any]:
        return beyond_bounds(self.robot.setpoints(self.io), SPEED)

    def continued(self, *asks: Ask, robot: str = "PSM1") -> list[Any]:
        return continued(self.robot.setpoints(self.io), [Intervention(robot, EPOCH_NS + 200 * MS, "hold")], asks)

    def lost(self, *others: Intervention, at_ms: int = 200) -> list[Any]:
        numbers = [Intervention("PSM1", EPOCH_NS + at_ms * MS, "1e6 rad")]
        return lost_by_numbers(self.robot, self.world.truth, self.io, numbers, others)


@pytest.fixture
def records(world: JudgedWorld) -> JudgedRecords:
    return JudgedRecords(world)


def test_a_setpoint_that_keeps_to_its_bounds_is_no_violation(records: JudgedRecords) -> None:
    records.yaw[:] = 2.0 * 0.002 * np.arange(len(records.yaw))
    assert records.beyond_bounds() == []


def test_a_setpoint_that_jumps_is_seen(records: JudgedRecords) -> None:
    records.yaw[250:] += 0.05
    (found,) = records.beyond_bounds()
    assert found.value == pytest.approx(0.05) and found.stamp_ns == EPOCH_NS + 500 * MS


@pytest.mark.parametrize("name", ["pid_generation", "bias_generation", "epoch"])
def test_a_setpoint_that_is_set_anew_does_not_jump(records: JudgedRecords, name: str) -> None:
    records.yaw[250:] += 0.05
    (records.io if name == "epoch" else {name: records.mine(name)})[name][250:] += 1
    assert records.beyond_bounds() == []


def test_a_setpoint_that_nobody_follows_may_jump(records: JudgedRecords) -> None:
    records.yaw[250:] += 0.05
    records.mine("pid_enabled")[249:251] = False
    assert records.beyond_bounds() == []
    records.mine("pid_enabled")[:] = True
    records.io["effort_mode"][200:250, records.robot.axes] = True
    assert records.beyond_bounds() == []


def test_what_goes_on_after_a_foreign_stop_is_seen(records: JudgedRecords) -> None:
    records.yaw[:] = 0.05 * 0.002 * np.arange(len(records.yaw))
    (found,) = records.continued()
    assert found.mode == "stopped" and found.value > 0.01
    assert records.continued(robot="MTMR") == [], "it was another robot that was stopped"


def test_what_stops_or_is_asked_for_again_is_no_violation(records: JudgedRecords) -> None:
    records.yaw[:120] = 0.05 * 0.002 * np.arange(120)
    records.yaw[120:] = records.yaw[119]
    assert records.continued() == []
    records.yaw[300:] += 0.05 * 0.002 * np.arange(len(records.yaw) - 300)
    assert records.continued(ask("PSM1", 0.1, begin_ms=590)) == []
    assert len(records.continued(ask("PSM1", 0.1, begin_ms=100))) == 1, "that was before the stop"


def test_an_arm_that_becomes_limp_after_a_foreign_stop_is_seen(records: JudgedRecords) -> None:
    records.io["effort_mode"][:150, records.robot.axes] = True
    assert records.continued() == []
    records.io["effort_mode"][250:, records.robot.axes] = True
    (found,) = records.continued()
    assert "effort mode" in found.what


def test_power_that_goes_after_wrong_numbers_is_seen(records: JudgedRecords) -> None:
    assert records.lost() == []
    records.world.power("PSM1")[700:] = False
    (found,) = records.lost()
    assert found.value == pytest.approx(0.5) and "power" in found.what
    assert records.lost(at_ms=800) == [], "it went before"


def test_power_that_goes_by_something_else_is_not_blamed_on_numbers(records: JudgedRecords) -> None:
    records.world.power("PSM1")[700:] = False
    assert records.lost(Intervention("PSM1", EPOCH_NS + 650 * MS, "emergency_stop")) == []
    assert len(records.lost(Intervention("PSM1", EPOCH_NS + 750 * MS, "emergency_stop"))) == 1


def test_a_tracking_error_is_blamed_on_numbers_whatever_else_happens(records: JudgedRecords) -> None:
    records.mine("fault")[300:] = TRACKING.number
    (found,) = records.lost(Intervention("PSM1", EPOCH_NS + 550 * MS, "pause"))
    assert "tracking" in found.what
    assert records.lost(at_ms=700) == []


def test_a_lift_that_goes_on_is_seen_until_somebody_lifts_again() -> None:
    stamps, lifting = EPOCH_NS + 2 * MS * np.arange(500), np.zeros(500, dtype=np.bool_)
    begins, ends = [Intervention("lift", EPOCH_NS, "lift")], [LiftEnd(EPOCH_NS + 200 * MS, 0.1, "kill")]
    lifting[:149] = True
    assert lifts_on(stamps, lifting, begins, ends) == []
    lifting[:160] = True
    (found,) = lifts_on(stamps, lifting, begins, ends)
    assert found.value == pytest.approx(0.118) and found.limit == pytest.approx(0.1)
    lifting[149:] = False
    lifting[400:] = True
    assert len(lifts_on(stamps, lifting, begins, ends)) == 1
    assert lifts_on(stamps, lifting, [*begins, Intervention("lift", EPOCH_NS + 790 * MS, "lift")], ends) == []


def test_what_a_client_that_may_not_power_is_not_refused_is_seen() -> None:
    outcomes = ("refused", "", "accepted", "done")
    found = obtained([Attempt("PSM1", EPOCH_NS, "enable", outcome) for outcome in outcomes])
    assert [each.what for each in found] == ["enable was accepted", "enable was done"]


def test_power_that_comes_and_checks_that_go_by_such_a_client_are_seen(records: JudgedRecords) -> None:
    world, attempts = records.world, [Attempt("system", EPOCH_NS + 200 * MS, "home", "refused")]
    assert unprotected(records.robot, world.truth[1:], records.io, attempts, []) == []
    world.power("PSM1")[:500] = False
    (found,) = unprotected(records.robot, world.truth, records.io, attempts, [])
    assert "amplifier" in found.what
    given = [Command("PSM1", EPOCH_NS + 100 * MS, "PSM1 enable")]
    assert unprotected(records.robot, world.truth, records.io, attempts, given) == []
    world.power("PSM1")[:] = True
    records.mine("tracking_check")[300:] = False
    (found,) = unprotected(records.robot, world.truth, records.io, attempts, [])
    assert "tracking" in found.what
