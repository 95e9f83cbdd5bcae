"""Classic setup joints as a host sees them: sixteen voltages of every arm through one input each."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.boards.carts import (
    CHANNELS,
    DISABLE,
    INCREMENT,
    JOINTS,
    PLACES,
    PLUGS,
    PWM,
    RESET,
    V_PER_BIT,
    CartHost,
    cart,
    described,
    with_arms,
)
from tests.boards.rails import START, Rails, two_buses
from tests.cases import cases
from tests.examples import examples
from tests.fpga import board_side
from trocar.procs.boards.controllers.interface_board import FEW_CHANGES, EmulatedInterfaceBoard
from trocar.procs.boards.devices.outputs import EVERY_OUTPUT, MAX_CHANGES, PLAY, BoardOutputs, Changes
from trocar.procs.boards.devices.waveform import VALID
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.setup_joints import SetupJointsPlant
from trocar.procs.document.emulated import EmulatedSetupArm
from trocar.procs.document.emulated import EmulatedSetupJoints as Described
from trocar.procs.document.system import Controller, SystemConfig
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire


@pytest.fixture(scope="module")
def plain() -> SystemConfig:
    return cart()


@pytest.fixture
def host(plain: SystemConfig) -> CartHost:
    made = CartHost(plain)
    made.reset()
    return made


# -- the multiplexer ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("firmware", "fpga"), [(7, "V2"), (9, "V3")])
def test_a_host_that_steps_through_all_channels_finds_the_joints(firmware: int, fpga: str) -> None:
    host = CartHost(system := cart(Controller(12, firmware=firmware, fpga=fpga)))
    host.reset()
    for arm, place in PLACES.items():
        host.joints.settle(arm, place)
    host.sweep()
    for secondary in (False, True):
        for arm, found in host.joints_of(described(system), secondary).items():
            assert found == pytest.approx(PLACES[arm], abs=0.6 * 1.42 * V_PER_BIT), arm
    for arm, place in PLACES.items():  # and they are looked at again the next time round
        host.joints.settle(arm, [0.9 * value for value in place])
    host.sweep()
    assert host.joints_of(described(system), True)["PSM2"][4] == pytest.approx(0.9 * -0.4, abs=1e-4)


def test_noise_of_the_potentiometers_averages_out() -> None:
    host = CartHost(system := cart(noise=0.002), settle_ms=2, samples=20)
    host.reset()
    host.joints.settle("PSM1", PLACES["PSM1"])
    host.sweep()
    found = np.array(host.joints_of(described(system), False)["PSM1"]) - PLACES["PSM1"]
    assert 1e-4 < np.abs(found).max() < 5 * 0.002 * 1.4 / np.sqrt(20)


def test_the_channel_is_in_the_position_words_of_a_dqla() -> None:
    host = CartHost(cart(Controller(12, hardware="DQLA", fpga="V3")))
    for step in range(1, 19):
        host.outputs = ~host.read(reg.DIGITAL_OUTPUT) & 0xF
        host.set(INCREMENT, True)
        host.wait(1)
        words = [host.read(reg.axis_register(axis, reg.ENCODER)) for axis in range(PLUGS)]
        assert sum((word >> 28 & 1) << k for k, word in enumerate(words)) == step % CHANNELS


def test_arms_start_where_all_potentiometers_see_them(plain: SystemConfig, host: CartHost) -> None:
    host.sweep()
    both = [host.joints_of(described(plain), secondary) for secondary in (False, True)]
    for arm in host.joints.arms:
        assert both[0][arm] == pytest.approx(both[1][arm], abs=2e-4)
        assert list(host.joints.positions[arm]) == pytest.approx(both[0][arm], abs=2e-4)
    assert (host.volts[1:, : 2 * JOINTS] > 0.5).all() and (host.volts[1:, : 2 * JOINTS] < 4.0).all()


def test_a_start_position_of_the_file_is_taken(plain: SystemConfig) -> None:
    joints = described(plain)
    arms = (dataclasses.replace(joints.arms[0], position=PLACES["ECM"]), *joints.arms[1:])
    world = Emulation(with_arms(plain, *arms), Rails(4), START)
    assert world.setup_joints["SUJ"].positions["ECM"] == PLACES["ECM"]


def test_pulses_turn_back_by_themselves_and_count_once(host: CartHost) -> None:
    assert host.look()[0] == 0 and host.outputs >> INCREMENT & 1 == 0 and host.outputs >> RESET & 1
    host.set(INCREMENT, True)
    host.wait(0.05)
    assert host.look()[0] == 1 and host.outputs >> INCREMENT & 1, "the pulse is 0.1 ms long"
    host.wait(0.1)
    assert host.look()[0] == 1 and not host.outputs >> INCREMENT & 1
    host.set(INCREMENT, False)
    host.wait(1)
    assert host.look()[0] == 1, "only rising counts"


def test_fast_pwm_and_long_silence_lose_no_pulse(host: CartHost) -> None:
    host.pwm(0.6)
    host.set(INCREMENT, True)
    host.wait(3000)
    assert host.look()[0] == 1


def test_lines_that_show_the_channel_are_counted_like_an_encoder(host: CartHost) -> None:
    host.write(reg.axis_register(1, reg.ENCODER_PRELOAD), 0x1234)
    seen = []
    for _ in range(8):
        host.look()
        host.set(INCREMENT, True)
        host.wait(1)
        seen.append(host.read(reg.axis_register(1, reg.ENCODER)))
    assert [word >> 28 & 3 for word in seen] == [0, 1, 1, 0, 0, 1, 1, 0]
    moves = np.abs(np.diff([0x1234, *[word & 0xFF_FFFF for word in seen]]))
    assert moves.tolist() == [0, 1, 0, 1, 0, 1, 0, 1]


def test_the_channel_outlives_the_controller_alone(host: CartHost) -> None:
    for _ in range(5):
        host.set(INCREMENT, True)
        host.wait(1)
        host.look()
    bus = host.world.buses[0]
    bus.take_away(0, True)
    host.wait(10)
    bus.take_away(0, False)
    host.wait(10)
    response = board_side.decode_response(host.world.answer(0, wire.quadlet_read(0, reg.DIGITAL_INPUT, 1, 3), host.now)
                                    or b"")
    assert isinstance(response, board_side.WireResponse)
    assert response.value >> reg.INPUT_ENCODER_A_SHIFT & 0xF == 6, "its output went high as at power-up: one more"


def test_plugs_pull_their_inputs_low(plain: SystemConfig, host: CartHost) -> None:
    assert host.read(reg.DIGITAL_INPUT) >> reg.INPUT_NEGATIVE_LIMIT_SHIFT & 0xF == 0
    two = CartHost(with_arms(plain, *described(plain).arms[:2]))
    assert two.read(reg.DIGITAL_INPUT) >> reg.INPUT_NEGATIVE_LIMIT_SHIFT & 0xF == 0b1100


PINS = Described("SUJ", "IO1", 12, (0, 1, 2, 3), RESET, INCREMENT, PWM, DISABLE, ())
COUNTS = st.just(0) | st.integers(30, 90)
DEEDS = st.one_of(
    st.tuples(st.just("write"), st.integers(1, 15), st.integers(0, 15)),
    st.tuples(st.just("configure"), st.integers(0, 3), COUNTS, COUNTS),
    st.tuples(st.just("play"), st.integers(1, 15), st.lists(st.integers(0, 0x1FFF), max_size=6)))


@examples(80)
@given(st.lists(st.tuples(st.integers(0, 900), DEEDS), max_size=10), st.integers(1, 200))
def test_nothing_depends_on_how_often_it_is_looked_at(deeds: list[tuple[int, tuple[object, ...]]], every: int) -> None:
    rigs = [(EmulatedInterfaceBoard(PINS, outputs), outputs) for outputs in (BoardOutputs(), BoardOutputs())]
    now = 0
    for span, deed in [*deeds, (500, ("write", 1, 1))]:
        for tick in range(now, now + span, every):
            rigs[0][0].until(tick)
        now += span
        for board, outputs in rigs:
            board.before_write(now)
            match deed:
                case ("write", int(mask), int(levels)):
                    outputs.write(mask << 8 | levels, now)
                case ("configure", int(output), int(high), int(low)):
                    outputs.configure(output, high << 16 | low, now)
                case ("play", int(mask), list(entries)):
                    outputs.write_table(0, [VALID | int(entry) for entry in entries] + [0], now)
                    outputs.write(PLAY | mask << 8, now)
    for board, _ in rigs:
        board.until(now)
    (often, _), (rare, _) = rigs
    words = [np.zeros((5, PLUGS), dtype=np.uint32) for _ in rigs]
    shown = [board.fill(now, 0, word[0], word[1:]) for (board, _), word in zip(rigs, words, strict=True)]
    assert often.channel == rare.channel and shown[0] == shown[1] and (words[0] == words[1]).all()
    assert often.driven == pytest.approx(rare.driven)


@cases(("high", "low", "level", "power"), [
    (614, 614, 0, 0.0), (98, 298, 0, -0.5), (298, 98, 1, 0.5),
    (0, 0, 0, 1.0), (0, 0, 1, -1.0), (0, 50, 1, 1.0), (50, 0, 0, -1.0)])
def test_the_lift_has_the_mean_of_its_output(high: int, low: int, level: int, power: float) -> None:
    outputs = BoardOutputs()
    board = EmulatedInterfaceBoard(PINS, outputs)
    board.before_write(100)
    outputs.configure(PWM, low << 16 | high, 100)
    outputs.write(0xC00 | level << PWM, 100)
    board.until(1100)
    assert board.driven == 0.0, "it is disabled"
    board.before_write(1100)
    outputs.write(0xC00 | 1 << DISABLE | level << PWM, 1100)
    board.until(2100)
    assert board.driven == pytest.approx(1000 * power)
    board.power_up(BoardOutputs(), 3100)
    board.until(9000)
    assert board.driven == pytest.approx(2000 * power)


def test_lines_show_the_channel_and_no_fault_after_power_up() -> None:
    outputs = BoardOutputs()
    board = EmulatedInterfaceBoard(PINS, outputs)
    for k in range(10):
        board.before_write(100 * k)
        outputs.write(0x200 | (k + 1) % 2 << INCREMENT, 100 * k)
    board.power_up(BoardOutputs(), 2000)
    words = np.zeros((5, PLUGS), dtype=np.uint32)
    assert board.fill(2100, 0xFFFF_FFFF, words[0], words[1:]) == 0xF50F_FFFF
    assert [int(word) >> 28 & 3 for word in words[0]] == [1, 0, 1, 0]


class WatchedPots(BoardOutputs):
    """Notes how many changes were looked at."""

    followed = 0

    def changes(self, after: int, until: int, limit: int = MAX_CHANGES, of: int = EVERY_OUTPUT) -> Changes:
        made = super().changes(after, until, limit, of)
        self.followed += len(made.items)
        return made


def test_outputs_that_switch_for_ever_are_not_followed_for_ever() -> None:
    outputs = WatchedPots()
    board = EmulatedInterfaceBoard(PINS, outputs)
    for output in (RESET, INCREMENT, DISABLE):
        outputs.configure(output, 1 << 16 | 1, 0)
    board.before_write(10)
    outputs.write(0xF0B, 10)
    board.until(49152)
    assert 0 < outputs.followed <= FEW_CHANGES
    outputs.configure(PWM, 600 << 16 | 600, 49152)  # PWM of the lift is not looked at
    for output in (RESET, INCREMENT, DISABLE):
        outputs.configure(output, 0, 49152)
    board.until(2 * 49152)
    outputs.followed = 0
    board.until(60 * 49152)
    assert outputs.followed == 0


def slow_counter(pins: list[tuple[int, int]]) -> int:
    """The counter by the pins of reset and increment, change after change."""
    count, before = 0, 1
    for reset, increment in pins:
        if not reset:
            count = 0
        elif increment and not before:
            count += 1
        before = increment
    return count % CHANNELS


@examples(40)
@given(st.lists(st.tuples(st.sampled_from((0, 1, 1, 1, 1, 1)), st.integers(0, 1)), max_size=60))
def test_the_counter_is_that_of_its_pins(pins: list[tuple[int, int]]) -> None:
    outputs = BoardOutputs()
    board = EmulatedInterfaceBoard(PINS, outputs)
    for k, (reset, increment) in enumerate(pins, 1):
        board.before_write(10 * k)
        outputs.write(0x300 | (not increment) << INCREMENT | (not reset) << RESET, 10 * k)
    board.until(10_000)
    assert board.channel == slow_counter(pins)


# -- the other voltages ------------------------------------------------------------------------------------------------


def extra_of(volts: np.ndarray) -> list[float]:
    """Brake voltage by plug, from where the original software takes it."""
    return [float(volts[at]) for at in ((3, 15), (2, 14), (1, 14), (0, 14))]


def test_voltages_of_the_brakes_are_where_the_original_looks(host: CartHost) -> None:
    host.sweep()
    assert extra_of(host.volts) == [0.0] * 4
    assert host.volts[3, 12:15] == pytest.approx([2.5] * 3, abs=1e-4)
    assert (host.volts[:3, 12:14] == 0.0).all() and (host.volts[:3, 15] == 0.0).all()
    host.power_on()
    for plug, amps in enumerate((0.5, 1.0, 1.5, 2.0), 1):
        host.current(plug, amps)
    host.sweep()
    expected = [(48.0 + 16.0 * amps) / 22.0 for amps in (0.5, 1.0, 1.5, 2.0)]
    assert extra_of(host.volts) == pytest.approx(expected, abs=2e-3)


# -- where there are none ----------------------------------------------------------------------------------------------


def test_systems_without_setup_joints_have_none() -> None:
    assert Emulation(two_buses(), Rails(7), START).setup_joints == {}


def test_the_test_board_takes_their_place(plain: SystemConfig) -> None:
    assert plain.emulation is not None
    bus = dataclasses.replace(plain.emulation.buses[0], testboard=True)
    emulation = dataclasses.replace(plain.emulation, buses=(bus,))
    assert Emulation(dataclasses.replace(plain, emulation=emulation), Rails(4), START).setup_joints == {}


def test_joints_without_potentiometers_show_nothing() -> None:
    arm = EmulatedSetupArm("X", 2, ((0.0, 0.0),) * 6, ((0.0, 0.0),) * 6)
    board = EmulatedInterfaceBoard(PINS, BoardOutputs())
    joints = SetupJointsPlant(dataclasses.replace(PINS, arms=(arm,)), board, np.arange(4), np.zeros(1, dtype=np.uint32))
    joints.settle("X", (1.0,) * 6)
    assert joints.step(np.zeros(4), np.zeros(4, dtype=np.bool_)).tolist() == [0.0] * 4
