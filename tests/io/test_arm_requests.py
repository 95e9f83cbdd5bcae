"""What an arm wants of io travels in its set-points: what counts, what voids it, what io answers."""

from __future__ import annotations

import pytest

from procs import codes
from procs.wishes import OFF, ON
from shm.origins import Origin
from tests.io.harness import FakeCommand, Stand
from tests.io.test_io_fault_matrix import braked
from tests.io.test_io_persons import Cell

OLD, NEW = Origin(77, 0, "trocar home"), Origin(78, 1, "trocar home")


def held(stand: Stand) -> Stand:
    """Power and joint controller, by wishes alone."""
    stand.arms[0].wish(power=ON)
    stand.run(10)
    stand.arms[0].wish(power=ON, pid=ON)
    stand.run(2)
    assert stand.record.amps_on[0] and stand.record.pid_enabled[0] and not stand.record.wish_void[0]
    return stand


def refusal(stand: Stand) -> str:
    return stand.record.wish_refused[0].decode()


def test_wishes_power_hold_and_let_go() -> None:
    stand = held(braked())
    generation = stand.record.pid_generation[0]
    stand.arms[0].wish(power=ON, pid=ON, brakes=ON, limits=OFF, tracking=ON, velocity=ON, pots=ON)
    stand.run_s(0.2)
    record = stand.record
    assert record.brakes_released[0] and record.tracking_check[0] and record.velocity_used[0] and record.pot_check[0]
    assert record.pid_generation[0] == generation and not refusal(stand) and stand.codes == []
    stand.arms[0].wish(power=OFF, brakes=OFF)
    stand.run(1)
    assert not record.power_wanted[0] and not record.pid_enabled[0] and not record.brakes_released[0]
    assert record.tracking_check[0], "no wish changes nothing"


def test_generation_0_changes_nothing() -> None:
    stand = held(Stand())
    stand.arms[0].wish(power=OFF, pid=OFF)
    stand.arms[0].wished("wish_generation")[...] = 0
    stand.run(10)
    assert stand.record.pid_enabled[0] and stand.record.amps_on[0]


@pytest.mark.parametrize("code", [3, 255])
def test_what_is_no_wish_changes_nothing(code: int) -> None:
    stand = held(Stand())
    stand.arms[0].wish(power=code, pid=code)
    stand.run(10)
    assert stand.record.pid_enabled[0] and stand.record.amps_on[0]


def test_wishes_of_a_silent_arm_change_nothing() -> None:
    stand = Stand()
    stand.arms[0].wish(power=ON)
    stand.arms_alive = False
    stand.arms[0].stamp_ns = stand.clock.ns - 31_000_000
    stand.run(10)
    assert not stand.record.power_wanted[0] and stand.record.wish_generation[0] == 0
    stand.arms_alive = True
    stand.run(1)
    assert stand.record.power_wanted[0] and stand.record.wish_generation[0] == 1


def test_a_wish_comes_true_as_soon_as_it_can() -> None:
    stand = Stand()
    stand.arms[0].wish(pid=ON)
    stand.run(100)
    assert refusal(stand) == "it is not powered" and not stand.record.pid_enabled[0]
    stand.arms[0].wish(power=ON, pid=ON)
    stand.run(10)
    assert stand.record.pid_enabled[0] and not refusal(stand)


@pytest.mark.parametrize("fault", [fault for fault in codes.FAULTS if fault.action != codes.NOTHING],
                         ids=lambda fault: fault.code)
def test_after_every_fault_the_same_wish_gives_nothing_back(fault: codes.Code) -> None:
    stand = held(Stand())
    stand.core.reports.trip(fault, 0)
    stand.run(1)
    on = stand.record.power_wanted[0]
    assert stand.record.wish_void[0] and stand.record.fault[0] == fault.number and not stand.record.pid_enabled[0]
    stand.run_s(1.0)
    assert stand.record.power_wanted[0] == on and not stand.record.pid_enabled[0]
    assert stand.record.fault[0] == fault.number


def test_a_wish_in_the_cycle_of_a_fault_is_void() -> None:
    stand = held(Stand())
    stand.arms[0].wish(power=ON, pid=ON, fault=OFF)
    stand.core.reports.trip(codes.POWER_LOST, 0)
    stand.run_s(0.5)
    assert not stand.record.power_wanted[0] and stand.record.fault[0] == codes.POWER_LOST.number


def test_a_wish_older_than_the_last_fault_counts_for_nothing() -> None:
    stand, cell = held(Stand()), Cell()
    stand.core._commands._faults = stand.core._reactions._cells = [cell]
    stand.core.reports.trip(codes.POWER_LOST, 0)
    stand.run(1)
    assert cell.void == 1
    stand.arms[0].wish(OLD, power=ON)
    stand.run(10)
    assert "a person has to ask for it again" in refusal(stand) and not stand.record.wish_void[0]
    assert not stand.record.power_wanted[0] and stand.record.fault[0] == codes.POWER_LOST.number
    stand.arms[0].wish(Origin(0, 1 << 60, ""), power=OFF, limits=OFF)
    stand.run(1)
    assert not refusal(stand), "to end something nobody needs to have asked"
    stand.arms[0].wish(NEW, power=ON)
    stand.run(10)
    assert stand.record.amps_on[0] and stand.record.fault[0] == 0


@pytest.mark.parametrize(("name", "values"), [("power_off", ()), ("servo_zero", ()), ("pid_enable", (0.0,)),
                                              ("tracking_check", (1.0,))])
def test_a_persons_command_voids_the_wishes(name: str, values: tuple[float, ...]) -> None:
    stand = held(Stand())
    assert stand.ask(name, *values).outcome == "done"
    assert stand.record.wish_void[0] and refusal(stand) == f"test asked for {name} meanwhile"
    controlled, powered = stand.record.pid_enabled[0], stand.record.power_wanted[0]
    assert (controlled, powered) == (name == "tracking_check", name != "power_off")
    stand.run_s(0.5)
    assert stand.record.pid_enabled[0] == controlled and stand.record.power_wanted[0] == powered
    stand.arms[0].wish(power=ON)
    stand.run(10)
    assert stand.record.amps_on[0] and not stand.record.wish_void[0]


def test_a_persons_command_wins_over_a_wish_of_the_same_cycle() -> None:
    stand = held(Stand())
    stand.arms[0].wish(power=ON, pid=ON)
    stand.ask("power_off")
    stand.run_s(0.5)
    assert not stand.record.power_wanted[0] and stand.record.wish_generation[0] == 3


def test_a_wish_that_came_of_an_older_command_than_a_persons_power_off_gives_no_power() -> None:
    """An arm held up between what it decided and what it published: its wish comes after the power-off."""
    stand, cell = held(Stand()), Cell()
    stand.core._commands._faults = stand.core._reactions._cells = [cell]
    assert stand.ask("power_off").outcome == "done"
    stand.arms[0].wish(OLD, power=ON)
    stand.run(10)
    assert refusal(stand) == "trocar home asked before its last fault or power-off; a person has to ask for it again"
    assert not stand.record.power_wanted[0]
    stand.arms[0].wish(Origin(cell.spared, 0, "test"), power=ON)
    stand.run(10)
    assert stand.record.power_wanted[0], "the command that the power-off was a part of goes on"


def test_a_wish_of_nobody_gives_no_power() -> None:
    stand = Stand()
    stand.arms[0].wish(Origin(0, 1 << 60, ""), power=ON, limits=OFF)
    stand.run(10)
    assert refusal(stand) == "nobody asked; a person has to ask for it again" and not stand.record.power_wanted[0]


def test_other_commands_and_refused_ones_leave_the_wishes() -> None:
    stand = Stand()
    stand.arms[0].wish(power=ON, pid=ON)
    assert stand.ask("clear_faults").outcome == stand.ask("pid_enable", 2).outcome == "refused"
    stand.ask("set_gains")
    stand.run(10)
    assert stand.record.pid_enabled[0] and not stand.record.wish_void[0]


def test_one_robots_wishes_are_not_anothers() -> None:
    stand = Stand(2)
    for arm in stand.arms:
        arm.wish(power=ON)
    stand.run(10)
    stand.ask("power_off", robot="PSM2")
    assert list(stand.record.wish_void) == [False, True] and list(stand.record.power_wanted) == [True, False]


def test_power_that_does_not_come_is_not_tried_again_by_the_same_wish() -> None:
    stand = Stand()
    stand.port.has_supply = False
    stand.arms[0].wish(power=ON)
    stand.run_s(3.5)
    assert stand.record.fault[0] == codes.POWER_TIMEOUT.number and stand.record.wish_void[0]
    assert not stand.record.power_wanted[0] and stand.codes == ["power-timeout"]
    stand.port.has_supply = True
    stand.arms[0].wish(power=OFF, fault=OFF)
    stand.run(1)
    stand.arms[0].wish(power=ON)
    stand.run(10)
    assert stand.record.amps_on[0]


def test_what_became_of_wishes_is_told_once_with_the_person_behind() -> None:
    stand, told = braked(), []
    stand.core._commands._wishes._tell = lambda asked, *what: told.append((asked.name, asked.origin, *what))
    stand.arms[0].wish(NEW, pid=ON)
    stand.run(50)
    stand.arms[0].wish(NEW, power=ON)
    stand.run(50)
    assert told == [("pid_enable", NEW, "refused", "it is not powered"), ("power_on", NEW, "accepted", ""),
                    ("power_on", NEW, "done", "")]
    told.clear()
    stand.arms[0].wish(NEW, pid=ON, brakes=ON)
    stand.run_s(0.2)
    assert [row[0] for row in told] == ["pid_enable", "brake_release"] and stand.record.brakes_released[0]


def test_a_new_io_begins_with_nothing_seen() -> None:
    stand = held(Stand())
    stand.record.restart()
    record = stand.record
    assert not record.wish_generation[0] and not record.wish_void[0] and refusal(stand) == ""


def test_a_command_of_the_arm_with_an_outcome_voids_nothing() -> None:
    stand = Stand()
    stand.arms[0].wish(power=ON)
    stand.run(10)
    stand.run(1, FakeCommand("bias_encoders", "PSM1", 10.0))
    assert not stand.record.wish_void[0]
