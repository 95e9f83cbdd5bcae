"""Setup joints at the edges: times to the very cycle, records of predecessors, emulated readings."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.arm.fake_requests import PERSON, FakeRequest
from tests.suj.fake_cart import MS, cart_of, setup_arm
from tests.suj.harness import FakeMemory
from tests.suj.test_traces import CartPlay
from trocar.procs.document.cart import CLASSIC, SI
from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.procs.node.fault_report import reported
from trocar.procs.suj.buttons import CLUTCH_COMMAND_NS
from trocar.procs.suj.classic import LIFT_COMMAND_NS, MAX_ROUND_NS, OLD_FAULT_NS, POWER_NS
from trocar.procs.suj.machine import SetupState
from trocar.procs.suj.multiplexer import INCREMENT, RESET, Multiplexer
from trocar.procs.suj.setups import Setups, moved_limits
from trocar.procs.suj.si import STALE_NS, EmulatedBoards
from trocar.shm.topics import SUJ_STATE

HERE = np.array((0.1, 0.2, -0.3))


class QuietCart(CartPlay):
    """A cart to which nothing happens by itself."""

    def step(self, ms: int = 2, *requests: FakeRequest) -> None:
        self.log.clear()
        for _ in range(max(1, ms // 2)):
            self.now_ns += min(ms, 2) * MS
            self.io.write(self.now_ns)
        for ring in self.tips:
            ring.stamp_ns = self.now_ns
        self.joints.step(self.now_ns, requests)

    def run(self, ms: int) -> None:
        for _ in range(ms // 2):
            self.step()

    def ask(self, name: str, text: str = "", *values: float) -> FakeRequest:
        """An operator asks, who has seen all faults until now."""
        request = FakeRequest(name, values, text, origin=replace(PERSON, generation=self.io.cell.valid_from))
        self.step(2, request)
        return request

    @property
    def now_in(self) -> SetupState:
        return self.joints.machine.state

    def said(self, code: str) -> list[str]:
        return [line for line in self.log if line.startswith(code)]


def test_channels_are_sixty_samples_after_thirty_ms() -> None:
    multiplexer, taken = Multiplexer(), 0
    assert multiplexer.begin(1000) == RESET
    for channel in range(16):
        begun = 1000 if not channel else multiplexer._ready_ns - 30_000_000
        assert multiplexer.take(begun + 29_999_999, channel, np.full(4, 1e9)) == "", "not settled yet"
        asked = ""
        for number in range(60):
            assert asked == ""
            asked = multiplexer.take(begun + 30_000_000 + number, channel, np.full(4, float(number)))
            taken += 1
        assert asked == (INCREMENT if channel < 15 else RESET)
    assert multiplexer.rounds == 1 and taken == 960 and (multiplexer.volts == 29.5).all()


def test_leaving_fault_makes_no_command_of_before_it_valid(enabled: QuietCart) -> None:
    """Else a bring-up, whose command disables them first, would power them after a fault that came after it."""
    cell: Any = enabled.joints._context.faults
    enabled.io.trip(3)
    enabled.run(20)
    assert enabled.now_in is SetupState.FAULT
    before = cell.valid_from
    enabled.ask("state_command", "disable")
    assert enabled.now_in is SetupState.DISABLED and (cell.valid_from, cell.exempt_origin) == (before, 0)


def test_the_lift_goes_for_a_second_to_the_cycle(enabled: QuietCart) -> None:
    assert enabled.ask("set_lift_velocity", "", -0.5).outcomes == ["done"]
    begun = enabled.now_ns
    while enabled.now_ns < begun + LIFT_COMMAND_NS - 2 * MS:
        enabled.step()
        assert enabled.state_of("lift") == -0.5
    enabled.step()
    assert enabled.state_of("lift") == 0.0 and "io < lift SUJ (0.0,)" in enabled.log


def test_a_clutch_by_command_holds_again_after_a_minute(enabled: QuietCart) -> None:
    assert enabled.ask("clutch", "PSM1", 1.0).outcomes == ["done"]
    begun = enabled.now_ns
    enabled.step()
    assert enabled.state_of("clutched").tolist() == [False, True, False, False]
    enabled.now_ns = begun + CLUTCH_COMMAND_NS - 4 * MS
    enabled.step()
    assert enabled.state_of("clutched")[1] and not enabled.said("clutch-released")
    enabled.step()
    assert not enabled.state_of("clutched")[1] and len(enabled.said("clutch-released")) == 1
    enabled.step()
    assert not enabled.said("clutch-released"), "it is said once"


def test_a_button_ends_what_a_command_began(enabled: QuietCart) -> None:
    enabled.ask("clutch", "PSM1", 1.0)
    enabled.io.pressed.add("SUJ_clutch_3")  # of PSM1's plug
    enabled.step()
    assert enabled.state_of("clutched")[1]
    enabled.io.pressed.clear()
    enabled.step()
    assert not enabled.state_of("clutched")[1] and not enabled.said("clutch-released")


def test_power_that_does_not_come_is_a_fault_after_four_seconds() -> None:
    cart = QuietCart(CLASSIC)
    cart.run(10)
    cart.io.has_supply = False
    cart.ask("state_command", "enable")
    begun = cart.now_ns
    cart.now_ns = begun + POWER_NS - 2 * MS
    cart.step()
    assert cart.now_in is SetupState.POWERING
    cart.step()
    assert cart.now_in is SetupState.FAULT and "failed to enable power" in str(cart.log)


def test_a_fault_of_before_is_cleared_by_power_on_or_counts_after_a_fifth_of_a_second() -> None:
    cart = QuietCart(CLASSIC)
    cart.run(10)
    cart.ask("state_command", "enable")
    begun, cart.io.power_at_ns = cart.now_ns, cart.now_ns + 10_000 * MS
    cart.io.trip(9)
    while cart.now_ns < begun + OLD_FAULT_NS:
        cart.step()
        assert cart.now_in is SetupState.POWERING
    cart.step()
    assert cart.now_in is SetupState.FAULT and cart.joints.machine.reason == reported(9).text


@pytest.mark.parametrize(("breaks", "reason"), [
    (lambda io: setattr(io, "has_supply", False), "detected power loss (actuators)"),
    (lambda io: io.flags.update(pid_enabled=0), "the current of the brakes was switched off"),
    (lambda io: io.restart(), "io was restarted"), (lambda io: io.trip(9), reported(9).text),
    (lambda io: io.flags.update(fault=9), reported(9).text)])
def test_what_brakes_need_and_is_gone_is_a_fault_at_once(enabled: QuietCart, breaks: Any, reason: str) -> None:
    breaks(enabled.io)
    enabled.step()
    enabled.step()
    assert enabled.now_in is SetupState.FAULT and enabled.joints.machine.reason == reason
    assert not enabled.state_of("brake_current").any()


def test_an_io_that_stalled_is_not_said_to_have_been_restarted(enabled: QuietCart) -> None:
    enabled.io_stall = "IO1 stalled for 0.31 s"
    enabled.io.restart()
    enabled.step()
    enabled.step()
    assert enabled.joints.machine.reason == enabled.io_stall


def test_a_counter_that_stands_still_for_five_seconds_makes_all_unknown(enabled: QuietCart) -> None:
    enabled.run(600)
    assert enabled.state_of("setup_valid").all()
    rounds = enabled.state_of("rounds").item()
    while enabled.state_of("rounds").item() == rounds:
        enabled.step()
    begun, enabled.io.deaf = enabled.now_ns, True
    enabled.now_ns = begun + MAX_ROUND_NS - 2 * MS
    enabled.step()
    assert enabled.state_of("setup_valid").all()
    enabled.step()
    assert not enabled.state_of("setup_valid").any() and len(enabled.said("multiplexer-stuck")) == 1


def test_an_io_that_was_away_for_long_is_no_counter_that_stands_still(enabled: QuietCart) -> None:
    enabled.run(600)
    enabled.io.alive = False
    enabled.run(100)
    assert not enabled.state_of("setup_valid").any() and not enabled.said("multiplexer-stuck")
    enabled.now_ns += MAX_ROUND_NS
    enabled.io.alive = True
    for _ in range(300):
        enabled.step()
        assert not enabled.said("multiplexer-stuck")
    assert enabled.state_of("setup_valid").all()


@pytest.mark.parametrize(("before", "after", "reason"), [
    (b"ENABLED", SetupState.ENABLED, ""), (b"POWERING", SetupState.ENABLED, ""),
    (b"FAULT", SetupState.FAULT, "the process was restarted; there was a fault before"),
    (b"DISABLED", SetupState.DISABLED, ""), (b"", SetupState.DISABLED, "")])
def test_a_successor_goes_on_where_its_predecessor_was(enabled: QuietCart, before: bytes, after: SetupState,
                                                       reason: str) -> None:
    enabled.state_of("sub_state")[...], enabled.state_of("is_homed")[...] = before, True
    enabled.start()
    enabled.step()
    assert enabled.now_in is after and enabled.joints.machine.waits == reason
    assert enabled.joints.machine.is_homed is (after is SetupState.ENABLED)
    assert not any("power" in line and line.startswith("io <") for line in enabled.log), "power is left as it is"


@pytest.mark.parametrize(("before", "flags", "code", "reason"), [
    (b"ENABLED", {"power_requested": 0, "powered": 0}, "power-lost", "detected power loss (actuators)"),
    (b"ENABLED", {"pid_enabled": 0}, "pid-off", "the current of the brakes was switched off"),
    (b"POWERING", {"amps_on": 0}, "power-timeout", "power-on was not complete"),
    (b"ENABLED", {"fault": 9}, "power-lost", "motor power went off unexpectedly")])
def test_a_successor_that_finds_less_power_is_in_fault(enabled: QuietCart, before: bytes, flags: dict[str, int],
                                                       code: str, reason: str) -> None:
    enabled.state_of("sub_state")[...] = before
    enabled.start()
    write = enabled.io.write

    def written(now_ns: int) -> None:
        write(now_ns)
        for name, value in flags.items():
            enabled.io._waiting[-1][1][name] = (7, value)

    enabled.io.write = written  # type: ignore[method-assign]
    enabled.step()
    assert enabled.now_in is SetupState.FAULT
    assert enabled.joints.machine.reason == f"{reason}; the process was restarted"
    (error,) = enabled.said(code)
    assert f"{reason}; the process was restarted" in error


def test_a_successor_waits_a_second_for_ios_first_record(enabled: QuietCart) -> None:
    enabled.io.alive = False
    enabled.start()
    enabled.step()
    begun = enabled.now_ns
    enabled.now_ns = begun + 1_000 * MS - 2 * MS
    enabled.step()
    assert enabled.now_in is SetupState.DISABLED and enabled.state_of("sub_state").item() == b"DISABLED"
    enabled.step()
    assert enabled.now_in is SetupState.FAULT


# -- setup arms by themselves ------------------------------------------------------------------------------------------


def setups_of(kind: str) -> tuple[Setups, FakeMemory]:
    cart = cart_of(kind)
    memory = FakeMemory(SUJ_STATE, setups=len(cart.arms))
    return Setups(cart, memory.field), memory


def test_only_what_a_record_holds_is_taken_over() -> None:
    setups, memory = setups_of("KINEMATIC")
    memory.field("position")[0, :3], memory.field("local_measured_cp")[0] = HERE, (0, 0, 0, 0, 0, 0, 1)
    assert not setups.take_over(0) and setups.changes == 0, "it was not valid"
    memory.field("setup_valid")[:] = True
    assert setups.take_over(0) and setups.changes == 1
    assert not setups.take_over(1), "its pose is none"
    memory.field("local_measured_cp")[1], memory.field("position")[1, 0] = (0, 0, 0, 0, 0, 0, 1), math.nan
    assert not setups.take_over(1) and setups.changes == 1
    fixed, memory = setups_of("Fixed")
    memory.field("setup_valid")[0], memory.field("local_measured_cp")[0] = True, (0.5, 0, 0, 0, 0, 0.6, 0.8)
    assert fixed.take_over(0) and fixed.local[0][:3, 3].tolist() == [0.5, 0, 0]


def test_an_arm_that_moves_less_than_counts_stays_where_it_was_settled() -> None:
    setups, _ = setups_of("KINEMATIC")
    assert setups.measure(0, HERE) == 0.0 and setups.valid[0] and setups.changes == 1
    settled = setups.local[0].copy()
    for by, changes in (((0.0019, 0, 0), 1), ((0, math.radians(0.99), 0), 1), ((0, 0, -math.radians(0.99)), 1),
                        ((0.0021, 0, 0), 2), ((0, math.radians(1.01), 0), 3)):
        moved = setups.measure(0, HERE + by)
        assert (moved >= 1.0) == (changes > 1) and setups.changes == changes
        assert np.array_equal(setups.local[0], settled) == (changes == 1)
        assert setups.position[0, :3] == pytest.approx(HERE + by)
    assert moved_limits(3) == pytest.approx((0.002, math.pi / 180, math.pi / 180))


def test_an_arm_that_was_lost_is_where_it_was_unless_it_may_have_moved() -> None:
    setups, _ = setups_of("KINEMATIC")
    setups.measure(0, HERE)
    settled = setups.local[0].copy()
    setups.lose(0, moved=False)
    setups.lose(0, moved=False)
    assert not setups.valid[0] and setups.changes == 2, "counted once"
    setups.measure(0, HERE + (0.001, 0, 0))
    assert setups.valid[0] and setups.changes == 3 and np.array_equal(setups.local[0], settled)
    setups.lose(0, moved=True)
    setups.measure(0, HERE + (0.001, 0, 0))
    assert setups.valid[0] and not np.array_equal(setups.local[0], settled)


def test_setup_arms_are_found_by_name() -> None:
    setups, _ = setups_of("KINEMATIC")
    assert [setups.place(name) for name in setups.names] == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="no setup arm X; there are ECM, PSM1, PSM2, PSM3"):
        setups.place("X")
    with pytest.raises(ValueError, match="no setup arm without a name"):
        setups.place("")


# -- Si ----------------------------------------------------------------------------------------------------------------


def test_emulated_boards_read_ten_times_a_second_where_their_arms_stand() -> None:
    cart = cart_of(SI)
    boards = EmulatedBoards(cart)
    assert boards.poll(5_000 * MS) and not boards.poll(5_100 * MS - 1)
    found = dict(boards.poll(5_100 * MS))
    assert list(found) == ["ff:ff", "aa:00", "aa:01", "aa:02", "aa:03"]
    assert {json.loads(reading)["timestamp"] for reading in found.values()} == {5100}
    pots = np.array(json.loads(found["aa:00"])["pots"])
    assert pots == pytest.approx(np.array(((2.0, -0.1 / 0.7), (2.5 / 1.1, 0.1 / 0.8)))), "all joints at 0"
    assert json.loads(found["ff:ff"])["pots"][0] == pytest.approx([0.4] * 4), "-offset / scale of each first joint"
    assert boards.problem("aa:00") == ""


def test_an_arms_reading_without_the_bases_is_none() -> None:
    cart = CartPlay(SI)
    poll = cart.link.poll
    cart.link.poll = lambda now_ns: [row for row in poll(now_ns) if row[0] != "ff:ff"]  # type: ignore[method-assign]
    cart.joints.step(cart.now_ns, ())
    assert cart.state_of("rounds").item() == 0
    cart.link.poll = poll  # type: ignore[method-assign]
    for rounds in (4, 8):
        cart.now_ns += MS
        cart.joints.step(cart.now_ns, ())
        assert cart.state_of("rounds").item() == rounds
    assert cart.state_of("setup_valid").all(), "the second reading is believed"


def test_a_base_that_was_read_five_seconds_ago_still_counts() -> None:
    cart = CartPlay(SI)
    for _ in range(3):
        cart.now_ns += MS
        cart.joints.step(cart.now_ns, ())
    poll = cart.link.poll
    cart.link.poll = lambda now_ns: [row for row in poll(now_ns) if row[0] != "ff:ff"]  # type: ignore[method-assign]
    cart.now_ns += STALE_NS
    cart.joints.step(cart.now_ns, ())
    assert cart.state_of("setup_valid").all() and cart.state_of("rounds").item() == 16
    cart.now_ns += 1
    cart.joints.step(cart.now_ns, ())
    assert not cart.state_of("setup_valid").any() and cart.state_of("rounds").item() == 16


def test_a_setup_arm_without_joints_has_no_pose_by_them() -> None:
    cart: Any = SimpleNamespace(arms=(setup_arm("PSM1", 0, chain=None),))
    setups = Setups(cart, FakeMemory(SUJ_STATE, setups=1).field)
    with pytest.raises(ValueError, match="PSM1 has no joints"):
        setups.set_joints(0, HERE)
    setups.put(0, matrix_from_pose(np.array((0.1, 0, 0, 0, 0, 0, 1.0))))
    assert setups.valid[0]


def test_potentiometers_that_agree_again_are_told_and_their_arm_is_known() -> None:
    cart = CartPlay(SI)

    def run(cycles: int) -> list[str]:
        cart.log.clear()
        for _ in range(cycles):
            cart.now_ns += MS
            cart.joints.step(cart.now_ns, ())
        return [line for line in cart.log if "potentiometers" in line]

    assert run(3) == [] and cart.state_of("setup_valid").all()
    cart.stand(2, HERE, math.radians(2.1))
    (said,) = run(3)
    assert said.startswith("setup-pots of PSM2: PSM2: the potentiometers of joint 2 don't agree; its position is not")
    assert "known (axis 1, " in said and not cart.state_of("setup_valid")[2]
    cart.stand(2, HERE)
    assert run(3) == ["status of PSM2: PSM2: the potentiometers agree"] and cart.state_of("setup_valid").all()
