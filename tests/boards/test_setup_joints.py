"""Classic set-up joints as a host sees them: sixteen voltages through one input each, brakes and the lift."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procs.boards.emulation import Emulation
from procs.boards.interface_board import InterfaceBoard
from procs.boards.outputs import PLAY, Outputs
from procs.boards.setup_joints import LIFT_M_S, SetupJoints
from procs.boards.waveform import VALID
from procs.lib import registers as reg
from procs.lib import wire
from procs.lib.config import load_system
from procs.lib.document import Controller, System
from procs.lib.emulated import SetupArm
from procs.lib.emulated import SetupJoints as Described
from tests import stock
from tests.boards.rails import MS, START, Rails, two_buses

RESET, INCREMENT, PWM, DISABLE = range(4)  # bits of the digital outputs
ONE_SHOT_S = 1e-4
V_PER_BIT = 6.8664600000000007e-05
JOINTS, CHANNELS, PLUGS = 6, 16, 4
CURRENT_SCALE = 5242.88
BOARD = Controller(12)
PLACES = {
    "ECM": (0.41, -0.3, 0.2, 3.3, 0.0, 0.0),
    "PSM1": (0.52, 0.4, -1.1, 0.3, 0.2, -0.7),
    "PSM2": (0.33, -0.5, 0.9, -0.2, -0.4, 0.6),
    "PSM3": (0.21, 0.1, 0.15, 0.25, -0.35, 0.45),
}


def cart(board: Controller = BOARD, noise: float = 0.0) -> System:
    """The set-up joints of the site's files on a controller."""
    loaded = load_system(stock.find("dvrk-site/jhu-daVinci/system-SUJ.json"), search=[stock.find("dvrk-share")],
                         boards="emulated")
    assert loaded.system is not None and loaded.system.emulation is not None
    emulation = loaded.system.emulation
    bus = dataclasses.replace(emulation.buses[0], controllers=(board,))
    emulation = dataclasses.replace(emulation, buses=(bus,), pot_noise_v=noise)
    return dataclasses.replace(loaded.system, emulation=emulation).emulated()


class Host:
    """Steps the multiplexer as the original software does: looks every millisecond, and never knows more."""

    def __init__(self, system: System, settle_ms: int = 30, samples: int = 3) -> None:
        self.world = Emulation(system, Rails(4), START)
        self.now = START
        self._settle_ms, self._samples = settle_ms, samples
        self.outputs = 0  # as last read, 1: high
        self.volts = np.zeros((PLUGS, CHANNELS))
        self.write(reg.WATCHDOG, 0)
        self.one_shot(RESET, low_s=ONE_SHOT_S)
        self.one_shot(INCREMENT, high_s=ONE_SHOT_S)
        self.wait(1)

    @property
    def joints(self) -> SetupJoints:
        return self.world.setup_joints["SUJ"]

    def wait(self, ms: float) -> None:
        self.now += round(ms * MS)
        self.world.advance(self.now)

    def write(self, address: int, value: int) -> None:
        assert self.world.answer(0, wire.quadlet_write(0, address, value, 1, 1), self.now) is None

    def read(self, address: int) -> int:
        response = wire.decode_response(self.world.answer(0, wire.quadlet_read(0, address, 1, 1), self.now) or b"")
        assert isinstance(response, wire.Response)
        return response.value

    # -- outputs, as the original library writes them ------------------------------------------------------------------

    def one_shot(self, output: int, high_s: float = 0.0, low_s: float = 0.0) -> None:
        high, low = (round(span * reg.CLOCK_HZ) for span in (high_s, low_s))
        self.write(reg.axis_register(output, reg.PWM), low << 16 | high)

    def pwm(self, duty: float) -> None:
        self.one_shot(PWM, duty / 40_000, (1.0 - duty) / 40_000)

    def set(self, output: int, high: bool) -> None:
        """All four outputs are written at once, as they were last read but for this one."""
        levels = self.outputs & ~(1 << output) | high << output
        self.write(reg.DIGITAL_OUTPUT, 0xF00 | ~levels & 0xF)

    # -- inputs --------------------------------------------------------------------------------------------------------

    def look(self) -> tuple[int, list[float]]:
        """The channel the lines show, and the volts of the four analog inputs."""
        inputs = self.read(reg.DIGITAL_INPUT)
        self.outputs = ~inputs >> reg.INPUT_DOUT_SHIFT & 0xF
        volts = [(self.read(reg.axis_register(axis, reg.ADC)) >> 16) * V_PER_BIT for axis in range(PLUGS)]
        return inputs >> reg.INPUT_ENCODER_A_SHIFT & 0xF, volts

    def reset(self) -> None:
        self.look()
        self.set(INCREMENT, False)
        self.set(RESET, False)
        self.wait(self._settle_ms)

    def sweep(self) -> None:
        """Read all channels; the counter is at 0 before and after."""
        for channel in range(CHANNELS):
            seen = []
            for _ in range(self._samples):
                self.wait(1)
                shown, volts = self.look()
                assert shown == channel
                seen.append(volts)
            self.volts[:, channel] = np.mean(seen, axis=0)
            if channel < CHANNELS - 1:
                self.set(INCREMENT, True)
            else:
                self.set(RESET, False)
            self.wait(self._settle_ms)

    def joints_of(self, described: Described, secondary: bool) -> dict[str, list[float]]:
        """What the file's conversions make of the voltages."""
        first = JOINTS if secondary else 0
        return {arm.name: [scale * volts + offset for volts, (scale, offset) in zip(
            self.volts[arm.plug - 1, first : first + JOINTS], arm.secondary if secondary else arm.primary, strict=True)]
            for arm in described.arms}

    # -- brakes --------------------------------------------------------------------------------------------------------

    def power_on(self) -> None:
        self.write(reg.STATUS, reg.CONTROL_POWER_ON | reg.CONTROL_AMPS_ON)
        self.wait(100)
        self.write(reg.STATUS, reg.CONTROL_POWER_ON | reg.CONTROL_AMPS_ON)
        self.wait(1)

    def current(self, plug: int, amps: float) -> None:
        offsets = (32649.999274371472, 33286.737543953452, 33251.849428783353, 33084.239057369567)
        word = reg.DAC_VALID | round(CURRENT_SCALE * amps + offsets[plug - 1])
        self.write(reg.axis_register(plug - 1, reg.DAC), word)
        self.wait(3)


def described(system: System) -> Described:
    assert system.emulation is not None
    return system.emulation.setup_joints[0]


@pytest.fixture(scope="module")
def plain() -> System:
    return cart()


@pytest.fixture
def host(plain: System) -> Host:
    made = Host(plain)
    made.reset()
    return made


# -- the multiplexer ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("firmware", "fpga"), [(7, "V2"), (8, "V2"), (9, "V3")])
def test_a_host_that_steps_through_all_channels_finds_the_joints(firmware: int, fpga: str) -> None:
    host = Host(system := cart(Controller(12, firmware=firmware, fpga=fpga)))
    host.reset()
    for arm, place in PLACES.items():
        host.joints.place(arm, place, by_force=True)
    host.sweep()
    for secondary in (False, True):
        for arm, found in host.joints_of(described(system), secondary).items():
            assert found == pytest.approx(PLACES[arm], abs=0.6 * 1.42 * V_PER_BIT), arm
    for arm, place in PLACES.items():  # and they are looked at again the next time round
        host.joints.place(arm, [0.9 * value for value in place], by_force=True)
    host.sweep()
    assert host.joints_of(described(system), True)["PSM2"][4] == pytest.approx(0.9 * -0.4, abs=1e-4)


def test_noise_of_the_potentiometers_averages_out() -> None:
    host = Host(system := cart(noise=0.002), settle_ms=2, samples=60)
    host.reset()
    host.joints.place("PSM1", PLACES["PSM1"], by_force=True)
    host.sweep()
    found = np.array(host.joints_of(described(system), False)["PSM1"]) - PLACES["PSM1"]
    assert 1e-4 < np.abs(found).max() < 5 * 0.002 * 1.4 / np.sqrt(60)


def test_the_channel_is_in_the_position_words_of_a_dqla() -> None:
    host = Host(cart(Controller(12, hardware="DQLA", fpga="V3")))
    for step in range(1, 19):
        host.outputs = ~host.read(reg.DIGITAL_OUTPUT) & 0xF
        host.set(INCREMENT, True)
        host.wait(1)
        words = [host.read(reg.axis_register(axis, reg.ENCODER)) for axis in range(PLUGS)]
        assert sum((word >> 28 & 1) << k for k, word in enumerate(words)) == step % CHANNELS


def test_arms_start_where_all_potentiometers_see_them(plain: System, host: Host) -> None:
    host.sweep()
    both = [host.joints_of(described(plain), secondary) for secondary in (False, True)]
    for arm in host.joints.arms:
        assert both[0][arm] == pytest.approx(both[1][arm], abs=2e-4)
        assert list(host.joints.positions(arm)) == pytest.approx(both[0][arm], abs=2e-4)
    assert (host.volts[1:, : 2 * JOINTS] > 0.5).all() and (host.volts[1:, : 2 * JOINTS] < 4.0).all()


def test_a_start_position_of_the_file_is_taken(plain: System) -> None:
    joints = described(plain)
    arms = (dataclasses.replace(joints.arms[0], position=PLACES["ECM"]), *joints.arms[1:])
    assert plain.emulation is not None
    emulation = dataclasses.replace(plain.emulation, setup_joints=(dataclasses.replace(joints, arms=arms),))
    world = Emulation(dataclasses.replace(plain, emulation=emulation), Rails(4), START)
    assert world.setup_joints["SUJ"].positions("ECM") == PLACES["ECM"]


def test_pulses_turn_back_by_themselves_and_count_once(host: Host) -> None:
    assert host.look()[0] == 0 and host.outputs >> INCREMENT & 1 == 0 and host.outputs >> RESET & 1
    host.set(INCREMENT, True)
    host.wait(0.05)
    assert host.look()[0] == 1 and host.outputs >> INCREMENT & 1, "the pulse is 0.1 ms long"
    host.wait(0.1)
    assert host.look()[0] == 1 and not host.outputs >> INCREMENT & 1
    host.set(INCREMENT, False)
    host.wait(1)
    assert host.look()[0] == 1, "only rising counts"


def test_the_counter_goes_round_and_is_cleared_at_any_channel(host: Host) -> None:
    for step in range(1, 22):
        host.set(INCREMENT, True)
        host.wait(1)
        assert host.look()[0] == step % CHANNELS
    host.set(RESET, False)
    host.wait(0.05)
    assert host.look()[0] == 0


def test_a_reset_that_is_held_keeps_the_counter_at_0(host: Host) -> None:
    host.one_shot(RESET)
    host.set(RESET, False)
    host.wait(1)
    for _ in range(3):
        host.look()
        host.set(INCREMENT, True)
        host.wait(1)
    assert host.look()[0] == 0


def test_fast_pwm_and_long_silence_lose_no_pulse(host: Host) -> None:
    host.pwm(0.6)
    host.set(INCREMENT, True)
    host.wait(3000)
    assert host.look()[0] == 1


def test_lines_that_show_the_channel_are_counted_like_an_encoder(host: Host) -> None:
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


def test_the_channel_outlives_the_controller_alone(host: Host) -> None:
    for _ in range(5):
        host.set(INCREMENT, True)
        host.wait(1)
        host.look()
    bus = host.world.buses[0]
    bus.take_away(0, True)
    host.wait(10)
    bus.take_away(0, False)
    host.wait(10)
    response = wire.decode_response(host.world.answer(0, wire.quadlet_read(0, reg.DIGITAL_INPUT, 1, 3), host.now)
                                    or b"")
    assert isinstance(response, wire.Response)
    assert response.value >> reg.INPUT_ENCODER_A_SHIFT & 0xF == 6, "its output went high as at power-up: one more"


def test_plugs_pull_their_inputs_low(plain: System, host: Host) -> None:
    assert host.read(reg.DIGITAL_INPUT) >> reg.INPUT_NEGATIVE_LIMIT_SHIFT & 0xF == 0
    joints = described(plain)
    assert plain.emulation is not None
    emulation = dataclasses.replace(plain.emulation, setup_joints=(dataclasses.replace(joints, arms=joints.arms[:2]),))
    two = Host(dataclasses.replace(plain, emulation=emulation))
    assert two.read(reg.DIGITAL_INPUT) >> reg.INPUT_NEGATIVE_LIMIT_SHIFT & 0xF == 0b1100


PINS = Described("SUJ", "IO1", 12, (0, 1, 2, 3), RESET, INCREMENT, PWM, DISABLE, ())
DEEDS = st.one_of(
    st.tuples(st.just("write"), st.integers(1, 15), st.integers(0, 15)),
    st.tuples(st.just("configure"), st.integers(0, 3), st.integers(0, 60), st.integers(0, 60)),
    st.tuples(st.just("play"), st.integers(1, 15), st.lists(st.integers(0, 0x1FFF), max_size=6)))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 900), DEEDS), max_size=10), st.integers(1, 200))
def test_nothing_depends_on_how_often_it_is_looked_at(deeds: list[tuple[int, tuple[object, ...]]], every: int) -> None:
    rigs = [(InterfaceBoard(PINS, outputs), outputs) for outputs in (Outputs(), Outputs())]
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
            board.until(now)
    (often, _), (rare, _) = rigs
    words = [np.zeros((5, PLUGS), dtype=np.uint32) for _ in rigs]
    shown = [board.fill(now, 0, word[0], word[1:]) for (board, _), word in zip(rigs, words, strict=True)]
    assert often.channel == rare.channel and shown[0] == shown[1] and (words[0] == words[1]).all()


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


@given(st.lists(st.tuples(st.sampled_from((0, 1, 1, 1, 1, 1)), st.integers(0, 1)), max_size=60))
def test_the_counter_is_that_of_its_pins(pins: list[tuple[int, int]]) -> None:
    outputs = Outputs()
    board = InterfaceBoard(PINS, outputs)
    for k, (reset, increment) in enumerate(pins, 1):
        board.before_write(10 * k)
        outputs.write(0x300 | (not increment) << INCREMENT | (not reset) << RESET, 10 * k)
    board.until(10_000)
    assert board.channel == slow_counter(pins)


# -- the other voltages ------------------------------------------------------------------------------------------------


def extra_of(volts: np.ndarray) -> list[float]:
    """Brake voltage by plug, from where the original software takes it."""
    return [float(volts[at]) for at in ((3, 15), (2, 14), (1, 14), (0, 14))]


def test_voltages_of_the_brakes_are_where_the_original_looks(host: Host) -> None:
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


# -- brakes ------------------------------------------------------------------------------------------------------------


def test_brakes_hold_an_arm_until_their_current_lets_it_go(host: Host) -> None:
    host.power_on()
    before = host.joints.positions("ECM")
    with pytest.raises(ValueError, match="ECM: its brakes hold"):
        host.joints.place("ECM", PLACES["ECM"])
    assert host.joints.positions("ECM") == before
    host.current(1, 1.1)
    assert not host.joints.is_released("ECM"), "not enough"
    host.current(1, 1.5)
    host.joints.place("ECM", PLACES["ECM"])
    assert host.joints.positions("ECM") == PLACES["ECM"]
    assert [host.joints.is_released(arm) for arm in host.joints.arms] == [True, False, False, False]
    host.current(1, 0.9)
    assert host.joints.is_released("ECM"), "less keeps it released"
    host.current(1, 0.0)
    with pytest.raises(ValueError, match="brakes hold"):
        host.joints.place("ECM", PLACES["ECM"])


def test_brakes_hold_when_power_goes(host: Host) -> None:
    host.power_on()
    host.current(3, 2.2)
    assert host.joints.is_released("PSM2")
    host.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    host.wait(3)
    assert not host.joints.is_released("PSM2")


def test_the_ramp_of_the_original_releases_and_holds(host: Host) -> None:
    host.power_on()
    amps, when = 0.0, []
    for target in (2.2, 0.0):
        while amps != target:
            amps = min(amps + 0.04, target) if target else max(amps - 0.04, target)  # 8 A/s, every 5 ms
            host.current(2, amps)
            host.wait(2)
            when.append((amps, host.joints.is_released("PSM1")))
    released = [amps for amps, free in when if free]
    assert released[0] == pytest.approx(0.8 * 2.2, abs=0.05) and released[-1] == pytest.approx(0.5 * 2.2, abs=0.05)


def test_brakes_without_a_release_current_always_hold(plain: System) -> None:
    joints = described(plain)
    arms = tuple(dataclasses.replace(arm, release_current=0.0) for arm in joints.arms)
    assert plain.emulation is not None
    emulation = dataclasses.replace(plain.emulation, setup_joints=(dataclasses.replace(joints, arms=arms),))
    host = Host(dataclasses.replace(plain, emulation=emulation))
    host.power_on()
    for amps in (0.0, 2.2):
        host.current(2, amps)
        assert not host.joints.is_released("PSM1")


@pytest.mark.parametrize(("arm", "positions", "error", "says"), [
    ("PSM4", (0.0,) * 6, KeyError, "ECM, PSM1, PSM2, PSM3"),
    ("", (0.0,) * 6, KeyError, "no name: no such set-up arm"),
    ("PSM1", (0.0,) * 4, ValueError, "4 positions; allowed: 6 finite numbers"),
    ("PSM1", (0.0, np.nan, 0.0, 0.0, 0.0, 0.0), ValueError, "finite"),
])
def test_wrong_places_are_refused(host: Host, arm: str, positions: tuple[float, ...], error: type[Exception],
                                  says: str) -> None:
    with pytest.raises(error, match=says):
        host.joints.place(arm, positions, by_force=True)


def test_positions_beyond_a_potentiometer_end_at_its_rails(host: Host) -> None:
    host.joints.place("PSM1", (5.0, -9.0, 0.0, 0.0, 0.0, 0.0), by_force=True)
    host.sweep()
    assert host.volts[1, 0] == pytest.approx(4.5, abs=1e-3) and host.volts[1, 1] == 0.0


# -- the lift ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def lift(host: Host) -> Callable[[], float]:
    """Height of the arm with a lift; its amplifier is powered."""
    host.power_on()
    host.pwm(0.5)
    host.look()
    host.set(DISABLE, False)
    host.wait(2)
    return lambda: host.joints.positions("PSM3")[0]


@pytest.mark.parametrize(("velocity", "sign"), [(1.0, 1), (-1.0, -1), (0.3, 0.3), (0.0, 0)])
def test_the_lift_follows_the_duty_of_its_pwm(
        host: Host, lift: Callable[[], float], velocity: float, sign: float) -> None:
    others = {arm: host.joints.positions(arm) for arm in ("ECM", "PSM1", "PSM2")}
    before, rest = lift(), host.joints.positions("PSM3")[1:]
    host.pwm(0.5 + 0.1 * velocity)
    host.wait(2000)
    assert lift() - before == pytest.approx(sign * 2.0 * 0.2 * LIFT_M_S, rel=0.02, abs=1e-9)
    assert host.joints.positions("PSM3")[1:] == rest
    assert others == {arm: host.joints.positions(arm) for arm in others}


def test_the_lift_rests_when_disabled_or_without_supply(host: Host, lift: Callable[[], float]) -> None:
    host.pwm(0.6)
    host.wait(10)
    host.look()
    host.set(DISABLE, True)
    host.wait(2)
    before = lift()
    host.wait(500)
    assert lift() == before
    host.look()
    host.set(DISABLE, False)
    host.wait(10)
    assert lift() > before
    host.write(reg.STATUS, reg.CONTROL_POWER_OFF)
    host.wait(2)
    before = lift()
    host.wait(500)
    assert lift() == before


def test_outputs_as_after_power_up_leave_the_lift_alone(host: Host) -> None:
    host.power_on()
    before = host.joints.positions("PSM3")
    host.pwm(0.6)
    host.wait(500)
    assert host.joints.positions("PSM3") == before


@pytest.mark.parametrize(("duty", "volts"), [(0.95, 4.5), (0.05, 0.0)])
def test_the_lift_stops_where_a_potentiometer_ends(
        host: Host, lift: Callable[[], float], duty: float, volts: float) -> None:
    host.pwm(duty)
    host.wait(20_000)
    end = lift()
    host.wait(500)
    assert lift() == end
    host.reset()
    host.sweep()
    ends = host.volts[3, [0, JOINTS]]
    assert np.abs(ends - volts).min() < 1e-3 and ((ends > 0.0) | (ends == volts)).all()


def test_an_output_that_is_held_drives_the_lift_fully(host: Host, lift: Callable[[], float]) -> None:
    before = lift()
    host.one_shot(PWM)
    host.look()
    host.set(PWM, True)
    host.wait(1000)
    up = lift() - before
    host.look()
    host.set(PWM, False)
    host.wait(2000)
    assert up == pytest.approx(LIFT_M_S, rel=0.01) and lift() - before == pytest.approx(-LIFT_M_S, rel=0.02)


# -- where there are none ----------------------------------------------------------------------------------------------


def test_systems_without_setup_joints_have_none() -> None:
    assert Emulation(two_buses(), Rails(7), START).setup_joints == {}


def test_the_test_board_takes_their_place(plain: System) -> None:
    assert plain.emulation is not None
    bus = dataclasses.replace(plain.emulation.buses[0], testboard=True)
    emulation = dataclasses.replace(plain.emulation, buses=(bus,))
    assert Emulation(dataclasses.replace(plain, emulation=emulation), Rails(4), START).setup_joints == {}


def test_joints_without_potentiometers_show_nothing() -> None:
    arm = SetupArm("X", 2, ((0.0, 0.0),) * 6, ((0.0, 0.0),) * 6)
    board = InterfaceBoard(PINS, Outputs())
    joints = SetupJoints(dataclasses.replace(PINS, arms=(arm,)), board, np.arange(4), np.zeros(1, dtype=np.uint32))
    joints.place("X", (1.0,) * 6, by_force=True)
    assert joints.step(np.zeros(4), np.zeros(4, dtype=np.bool_)).tolist() == [0.0] * 4
