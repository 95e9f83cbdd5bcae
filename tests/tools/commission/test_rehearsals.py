"""Stages rehearsed on emulated robots, good ones and broken ones: what must stop them does, and says where and why."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import pytest

from tests import stock
from tests.tools.commission.harness import RigBench
from trocar.tools.commission import axis, power, read
from trocar.tools.commission.person import Declined
from trocar.tools.commission.window import Window

Break = Callable[[RigBench], object]


def _problem(outcome) -> str:
    assert outcome.problems, outcome.figures
    return str(outcome.problems[0])


@pytest.mark.parametrize("file", [
    "demo.yaml", "demo-mtm.yaml", "demo-ecm-si.yaml"])
@pytest.mark.slow
def test_a_good_robot_passes_and_is_off_afterwards(file: str) -> None:
    bench = RigBench(file)
    bench.harness.run(0.5)
    pressed = bench.harness.record.input.copy()
    for stage in (read, power, axis):
        outcome = stage.run(bench)
        assert [str(problem) for problem in outcome.problems] == [], stage.__name__
        assert outcome.figures
        assert not bench.harness.record.amp_on.any()
        assert not bench.harness.record.powered.any()
    bench.harness.run(0.5)
    assert (bench.harness.record.input == pressed).all()  # hands have left all buttons as they were
    arms = [subject.name for subject in bench.subjects if subject.arm]
    assert bench.person.confirmed == [*arms, *arms]  # before power, and before motion, of each


@pytest.mark.slow
def test_a_master_that_weighs_something_is_supported_while_its_motors_are_tried() -> None:
    bench = RigBench(stock.find("dvrk-site/jhu-dVRK/system-MTMR.json"), search=[stock.find("dvrk-share")])
    bench.harness.run(2.0)
    assert axis.run(bench).problems == []
    bench.person.supporting = lambda subject: contextlib.nullcontext()  # type: ignore[method-assign]
    assert _problem(axis.run(bench))


@pytest.mark.parametrize(("breaks", "where", "says"), [
    (lambda b: b.faults.kill_pot("PSM1", 3, True), "PSM1 axis 3 (disc_1), board 6",
     "potentiometer 0.000 V; allowed: 0.09 to 4.41 V; its cable is loose"),
    (lambda b: b.faults.shift_current("PSM1", 4, 0.15), "PSM1 axis 4", "A are measured without power; allowed: 0.1 A"),
    (lambda b: b.faults.heat(7, 30.0, 66.0), "board 7", "amplifier at 66.0 °C; allowed: 5 to 50 °C"),
    (lambda b: b.faults.jam("PSM1", 0, True), "PSM1 axis 0", "is it stuck"),
    (lambda b: b.faults.scale_encoder("PSM1", 0, 1.3), "PSM1 axis 0", "0.77 times as far as its encoder"),
    (lambda b: b.faults.scale_encoder("PSM1", 0, -1.0), "PSM1 axis 0", "go opposite ways (-1.00)"),
    (lambda b: setattr(b.person, "says", False), "PSM1 axis 0", "the other way for the operator"),
])
def test_what_is_read_stops_at_sensors_that_are_wrong(breaks: Break, where: str, says: str) -> None:
    bench = RigBench("demo.yaml")
    breaks(bench)
    bench.harness.run(0.1)
    problem = _problem(read.run(bench))
    assert where in problem
    assert says in problem
    assert not bench.harness.record.powered.any()


@pytest.mark.parametrize(("looks", "finds"), [(2, ""), (99, "50.0 % of its samples are good; allowed: 99 % at least")])
@pytest.mark.slow
def test_a_rehearsal_forgives_a_machine_that_stalled_but_not_silent_boards(looks: int, finds: str) -> None:
    bench = RigBench("demo.yaml")
    sample, taken = bench.sample, []

    def held_up(io: str, seconds: float) -> Window:
        window = sample(io, seconds)
        taken.append(window)
        window.fields["valid"][: len(window) // 2] &= len(taken) > looks
        return window

    bench.sample = held_up  # type: ignore[method-assign]
    problems = [str(problem) for problem in read.run(bench).problems]
    assert problems == [] if not finds else finds in problems[0]


def test_a_potentiometer_far_outside_the_limits_is_that_of_other_files() -> None:
    bench = RigBench("demo.yaml")
    window, subject = bench.sample("IO1", 0.1), bench.subjects[0]
    assert read.judge_rest(window, subject) == []
    window.fields["pot_position"][:, 1] += 1.5
    (found,) = read.judge_rest(window, subject)
    assert "PSM1 axis 1 (pitch), board 6: potentiometer says 1." in str(found)
    assert "allowed: -1.203 to 1.203 rad; are the files this arm's?" in str(found)


def test_a_master_s_roll_may_be_where_its_potentiometer_reads_nothing() -> None:
    bench = RigBench("demo-mtm.yaml")
    window, subject = bench.sample("IO1", 0.1), bench.subjects[0]
    roll = subject.axes.stop - 1
    window.fields["pot_voltage"][:, roll] = 0.0
    assert read.judge_rest(window, subject) == []
    window.fields["pot_voltage"][:, roll - 1] = 0.0
    assert f"{subject.title(5)}, board" in str(read.judge_rest(window, subject)[0])


def test_a_noisy_potentiometer_has_a_bad_contact() -> None:
    bench = RigBench("demo.yaml", sets=["emulation.pot_noise_v=0.1"])
    assert "bad contact" in str(read.judge_rest(bench.sample("IO1", 0.5), bench.subjects[0])[0])


@pytest.mark.parametrize(("breaks", "where", "says"), [
    (lambda b: b.faults.stop(True), "PSM1, boards 6, 7", "within 3 s; allowed: supply and relay good on every board"),
    (lambda b: b.faults.lose_supply("PSM1", True), "PSM1, boards 6, 7", "is the emergency stop released"),
])
def test_relays_without_a_supply_stop(breaks: Break, where: str, says: str) -> None:
    bench = RigBench("demo.yaml")
    breaks(bench)
    problem = _problem(power.run(bench))
    assert where in problem
    assert says in problem
    assert not bench.harness.record.amp_on.any()


@pytest.mark.parametrize(("file", "breaks", "where", "says"), [
    ("demo.yaml", lambda b: b.faults.scale_encoder("PSM1", 0, 1.6), "PSM1 axis 0 (yaw), board 6", "is wrong"),
    ("demo.yaml", lambda b: b.faults.scale_encoder("PSM1", 0, -1.0), "PSM1 axis 0 (yaw), board 6",
     "allowed: the positive direction; the sign of current_to_bits or of bits_to_position is wrong"),
    ("demo.yaml", lambda b: b.faults.swap_motors("PSM1", 0, 1), "PSM1 axis 0 (yaw), board 6",
     "PSM1 axis 1 (pitch) moves in its place; allowed: it moves itself; the motor or encoder plugs of axes 0 and 1"),
    ("demo.yaml", lambda b: b.faults.jam("PSM1", 0, True), "PSM1 axis 0 (yaw), board 6",
     " A; allowed: 0.035 rad; is it stuck or at a stop?"),
    ("demo.yaml", lambda b: b.faults.kill_pot("PSM1", 0, True), "PSM1 axis 0 (yaw), board 6",
     "the potentiometer is dead, loose, or that of another axis"),
    ("demo.yaml", lambda b: setattr(b.person, "says", False), "PSM1 axis 0 (yaw), board 6", "the operator saw"),
    ("demo.yaml", lambda b: b.faults.fail_amplifier("PSM1", 0, True), "", "power_on"),
    ("demo-ecm.yaml", lambda b: b.faults.jam("ECM", 0, True), "ECM axis 0 (yaw), board 4",
     "its brake does not release, or it is stuck"),
])
def test_one_motor_at_a_time_stops_at_what_moves_wrongly(file: str, breaks: Break, where: str, says: str) -> None:
    bench = RigBench(file)
    breaks(bench)
    if says == "power_on":
        with pytest.raises(AssertionError, match="amplifier"):
            axis.run(bench)
        return
    problem = _problem(axis.run(bench))
    assert where in problem
    assert says in problem
    assert not bench.harness.record.amp_on.any()


@pytest.mark.parametrize("stage", [power, axis])
def test_nothing_is_switched_on_unless_the_word_is_typed(stage, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = RigBench("demo.yaml")

    def refuses(danger: str, word: str) -> None:
        raise Declined("no")

    monkeypatch.setattr(bench.person, "confirm", refuses)
    with pytest.raises(Declined):
        stage.run(bench)
    assert not bench.harness.record.powered.any()
    assert not bench.harness.record.power_requested.any()
