"""The parts of setup joints by themselves: multiplexer, pairs of potentiometers, brakes, readings of Si boards."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import types
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from tests.io.harness import FakeCommand
from tests.suj.harness import SetupHarness, system_of
from trocar.procs.document.cart import Cart, CartArm
from trocar.procs.suj import bluetooth
from trocar.procs.suj.buttons import CLUTCH_COMMAND_NS
from trocar.procs.suj.classic import Classic, SetupArmBrakes
from trocar.procs.suj.loop import link_of
from trocar.procs.suj.multiplexer import INCREMENT, RESET, SAMPLES, SETTLE_NS, Multiplexer
from trocar.procs.suj.pots import CLASSIC_LIMITS, Potentiometers
from trocar.procs.suj.si import EmulatedBoards, Si, UnreadPots, counts

STEP_NS = 666_667


class ConversionCounter:
    """What the interface board does, and a host that looks every cycle."""

    def __init__(self) -> None:
        self.channel, self.now_ns, self.multiplexer = 5, 0, Multiplexer()
        self.apply(self.multiplexer.begin(0))

    def apply(self, asked: str) -> str:
        self.channel = {INCREMENT: self.channel + 1, RESET: 0}.get(asked, self.channel) % 16
        return asked

    def cycle(self, volts: np.ndarray) -> str:
        self.now_ns += STEP_NS
        return self.apply(self.multiplexer.take(self.now_ns, self.channel, volts))


def test_a_round_averages_every_channel_after_it_has_settled() -> None:
    counter = ConversionCounter()
    cycles = 0
    while counter.multiplexer.rounds < 1:
        settled = counter.now_ns + STEP_NS >= counter.multiplexer._ready_ns
        noise = (-1) ** cycles * 0.1 if settled else 1e3
        counter.cycle(np.arange(4) + 10.0 * counter.channel + noise)
        cycles += 1
    expected = np.arange(4)[:, None] + 10.0 * np.arange(16)
    assert np.allclose(counter.multiplexer.volts, expected, atol=0.1 / SAMPLES + 1e-9)
    assert counter.now_ns == pytest.approx(16 * (SETTLE_NS + SAMPLES * STEP_NS), rel=0.03)


def test_a_counter_that_is_elsewhere_is_reset_and_told() -> None:
    counter = ConversionCounter()
    while counter.channel < 3:
        counter.cycle(np.zeros(4))
    counter.channel = 9
    asked = ""
    while not asked:
        asked = counter.cycle(np.zeros(4))
    assert asked == RESET and counter.multiplexer.wrong == (9, 3)
    while counter.multiplexer.rounds < 1:
        counter.cycle(np.zeros(4))
    assert counter.multiplexer.wrong is None


def test_missed_samples_begin_the_channel_anew() -> None:
    counter = ConversionCounter()
    while counter.multiplexer._count < SAMPLES - 1:
        counter.cycle(np.full(4, 7.0))
    counter.multiplexer.skip()
    cycles = 0
    while not counter.cycle(np.ones(4)):
        cycles += 1
    assert cycles == SAMPLES - 1 and np.array_equal(counter.multiplexer._current[:, 0], np.ones(4))


def arm(**changes) -> CartArm:
    values = {"name": "PSM1", "joints": 3, "primary": ((0.25, -0.1), (1.0, -2.0), (0.0, 0.0)),
              "secondary": ((0.26, -0.12), (-1.1, 2.5), (0.0, 0.0)), "weight": (0.5, 0.5, 0.5)}
    return CartArm(**(values | changes))


@given(st.floats(0, 1), st.floats(-1, 1), st.floats(0, 1))
def test_agreeing_potentiometers_give_their_weighted_mean(first: float, second: float, weight: float) -> None:
    pots = Potentiometers(arm(weight=(weight,) * 3), CLASSIC_LIMITS)
    a, b = pots.volts(np.array((first, second, 0.0)))
    assert pots.update(a, b) and np.allclose(pots.joints, (first, second, 0.0), atol=1e-12)
    assert pots.update(a, b + (0.001 / 0.26, 0, 0))
    assert pots.joints[0] == pytest.approx(first + (1 - weight) * 0.001, abs=1e-12)


@pytest.mark.parametrize(("apart", "joint"), [((0.0021, 0.0), 0), ((-0.0021, 0.0), 0), ((0.0, math.radians(1.01)), 1),
                                              ((0.0, -math.radians(1.01)), 1), ((np.nan, 0.0), 0)])
def test_potentiometers_too_far_apart_are_told_with_their_joint(apart: tuple[float, float], joint: int) -> None:
    pots = Potentiometers(arm(), CLASSIC_LIMITS)
    a, b = pots.volts(np.array((0.3, 0.2, 0.0)))
    assert not pots.update(a + (apart[0] / 0.25, apart[1], 0.0), b)
    assert pots.worst == joint and pots.limit == CLASSIC_LIMITS[joint]


def test_brakes_ramp_with_the_sign_of_the_file_and_hold_with_theirs() -> None:
    brakes = SetupArmBrakes((arm(release_current=-2.0, engaged_current=0.1), arm(release_current=1.0)))
    clutched = np.array([True, False])
    brakes.step(0.05, clutched)
    assert np.allclose(brakes.current, (-0.4, 0.0)) and brakes.engaged.tolist() == [False, True]
    for _ in range(10):
        brakes.step(0.05, clutched)
    assert np.allclose(brakes.current, (-2.0, 0.0))
    brakes.step(0.05, ~clutched)
    assert np.allclose(brakes.current, (-1.6, 0.4)) and not brakes.engaged.any()
    for _ in range(10):
        brakes.step(0.05, np.zeros(2, dtype=bool))
    assert np.allclose(brakes.current, (-0.1, 0.0)) and brakes.engaged.all()
    brakes.cut()
    assert not brakes.current.any() and brakes.engaged.all()


# -- Si ----------------------------------------------------------------------------------------------------------------

SI = '{"name": "SUJ", "type": "SUJ_Si", "arm_file": "suj-si.json"}'


class PotBoards(EmulatedBoards):
    """Played boards of which the test takes some away."""

    silent: tuple[str, ...] = ()

    def poll(self, now_ns: int) -> list[tuple[str, bytes]]:
        return [row for row in super().poll(now_ns) if row[0] not in self.silent]

    def problem(self, address: str) -> str:
        return "out of reach" if address in [name.upper() for name in self.silent] else ""


@pytest.fixture
def si(tmp_path) -> SetupHarness:
    cart: Cart = system_of(tmp_path, SI, boards="emulated", folder="dvrk-site/jhu-daVinci-Si").cart("SUJ")
    link, pressed, powered = PotBoards(cart), np.zeros(4, dtype=bool), np.ones(4, dtype=bool)
    asked: list[tuple[int, bool]] = []
    harness = SetupHarness(cart, lambda cart, setups, reports, field, _: Si(
        cart, setups, link, reports, field, lambda now: (pressed, powered),
        lambda place, on: asked.append((place, on))))
    harness.link, harness.pressed, harness.powered, harness.asked = link, pressed, powered, asked
    return harness


def run(harness: SetupHarness, seconds: float) -> None:
    for _ in range(round(seconds * 100)):
        harness.step(ms=10)


def test_readings_of_base_and_arm_make_an_si_arm_known(si: SetupHarness) -> None:
    goals = {name: np.linspace(0.1, 0.4, arm.joints) * (1, -1, 1, -1, 1)[: arm.joints]
             for name, arm in zip(("ECM", "PSM1", "PSM2", "PSM3"), si.cart.arms, strict=True)}
    for place, goal in enumerate(goals.values()):
        si.link.turn(place, goal)
    run(si, 0.5)
    assert si.field("setup_valid").all() and si.field("simulated").item()
    for place, goal in enumerate(goals.values()):
        assert np.allclose(si.field("position")[place, : len(goal)], goal, atol=1e-9)
    assert si.field("sub_state").item() == b"DISABLED" and si.ask("state_command", "home").outcome == "done"


@pytest.fixture
def by_arm(tmp_path) -> SetupHarness:
    """The same cart of 2026: the controllers of the carried arms read all joints, with 12 bits."""
    cart = system_of(tmp_path, SI, boards="emulated", folder="dvrk-site/jhu-daVinci-Si").cart("SUJ")
    arms = tuple(replace(arm, board=arm.name, primary=tuple((16.0 * scale, offset) for scale, offset in arm.primary),
                         secondary=tuple((16.0 * scale, offset) for scale, offset in arm.secondary))
                 for arm in cart.arms)
    cart = replace(cart, by_arm=True, base_board="", arms=arms)
    link = PotBoards(cart)
    harness = SetupHarness(cart, lambda cart, setups, reports, field, _: Si(
        cart, setups, link, reports, field, lambda now: (np.zeros(4, dtype=bool), np.ones(4, dtype=bool)),
        lambda place, on: None))
    harness.link = link
    return harness


def test_counts_of_the_carried_arms_controllers_make_all_joints_known(by_arm: SetupHarness) -> None:
    goals = [np.linspace(0.1, 0.4, arm.joints) * (1, -1, 1, -1, 1)[: arm.joints] for arm in by_arm.cart.arms]
    for place, goal in enumerate(goals):
        by_arm.link.turn(place, goal)
    run(by_arm, 0.5)
    assert by_arm.field("setup_valid").all()
    for place, goal in enumerate(goals):
        near = 0.6 * np.array([abs(scale) for scale, _ in by_arm.cart.arms[place].primary])  # half a count
        assert (np.abs(by_arm.field("position")[place, : len(goal)] - goal) <= near).all()
    by_arm.link.silent = ("PSM1",)
    run(by_arm, 5.5)
    assert by_arm.field("setup_valid").tolist() == [True, False, True, True]
    assert by_arm.reports.of("warning") == ["PSM1: its pose is not known (PSM1: out of reach)"]


def test_a_cart_of_2026_on_real_boards_names_the_cause_once(
        by_arm: SetupHarness, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("poll", "problem"):
        monkeypatch.setattr(by_arm.link, name, getattr(UnreadPots(), name))
    run(by_arm, 5.5)
    assert by_arm.reports.of("warning")[0] == ("ECM: its pose is not known (ECM: firmware Rev 10 reads its "
                                               "potentiometers, and where it shows them is not known)")


def test_a_joint_without_a_reading_makes_its_arm_unknown(by_arm: SetupHarness, monkeypatch: pytest.MonkeyPatch) -> None:
    run(by_arm, 0.5)
    polled = by_arm.link.poll

    def lacks(now_ns: int) -> list[tuple[str, bytes]]:
        rows = dict(polled(now_ns))
        if "ECM" in rows:
            pots = json.loads(rows["ECM"])["pots"]
            pots[1][2] = -1
            rows["ECM"] = json.dumps({"pots": pots}).encode()
        return list(rows.items())

    monkeypatch.setattr(by_arm.link, "poll", lacks)
    run(by_arm, 0.3)
    assert by_arm.field("setup_valid").tolist() == [False, True, True, True]
    assert by_arm.reports.of("warning") == ["ECM: no reading of joint 3"]
    monkeypatch.undo()
    run(by_arm, 0.3)
    assert by_arm.field("setup_valid").all()


def test_real_controllers_of_a_cart_of_2026_are_not_read_and_say_why(by_arm: SetupHarness) -> None:
    link = link_of(replace(by_arm.cart, emulated=False))
    assert link.poll(0) == [] and "firmware Rev 10" in link.problem("PSM1")
    link.close()


def test_an_si_arm_is_unknown_while_clutched_and_until_it_was_read_again(si: SetupHarness) -> None:
    run(si, 0.5)
    si.pressed[1] = True
    run(si, 0.3)
    assert si.field("setup_valid").tolist() == [True, False, True, True]
    goal = np.array((0.2, 0.3, -0.4, 0.5))
    si.link.turn(1, goal)
    si.pressed[1] = False
    run(si, 0.05)
    assert not si.field("setup_valid")[1]
    run(si, 0.3)
    assert si.field("setup_valid").all() and np.allclose(si.field("position")[1, :4], goal)


def test_a_board_that_is_away_is_told_and_its_arm_unknown(si: SetupHarness) -> None:
    run(si, 0.5)
    si.link.silent = (si.cart.arms[2].board,)
    run(si, 5.5)
    assert si.field("setup_valid").tolist() == [True, True, False, True]
    assert si.reports.of("warning") == ["PSM2: its pose is not known (PSM2: out of reach)"]
    si.link.silent = (si.cart.base_board,)
    run(si, 5.5)
    assert not si.field("setup_valid").any(), "no first joint without the base's board"
    assert "base: out of reach" in si.reports.of("warning")[-1]
    si.link.silent = ()
    run(si, 0.5)
    assert si.field("setup_valid").all() and "PSM2: its potentiometer board answers" in si.reports.of("status")


def test_the_second_reading_after_a_clutch_is_believed(si: SetupHarness) -> None:
    run(si, 0.5)
    si.pressed[1] = True
    run(si, 0.3)
    si.pressed[1] = False
    before = si.field("rounds").item()
    while not si.field("setup_valid")[1]:
        run(si, 0.01)
        assert si.field("rounds").item() - before <= 2 * len(si.cart.arms)
    assert si.field("rounds").item() - before == 2 * len(si.cart.arms)


@cases("reading", [b"", b"{}", b"[]", b'{"pots": 3}', b'{"pots": [[1, 2], [3]]}',
                   b'{"pots": [[], []]}', b'{"pots": [[NaN], [1]]}', b'{"pots": [[1], [2], [3]]}',
                   b"\xff", b'{"pots": [["a"], [1]]}', b"[" * 100000])
def test_what_is_no_reading_is_refused(reading: bytes) -> None:
    with pytest.raises(ValueError, match="not a reading"):
        counts(reading)


def test_readings_are_rows_of_counts() -> None:
    assert np.array_equal(counts(b'{"timestamp": 5, "pots": [[1, 2], [3, 4.5]]}'), [[1, 2], [3, 4.5]])


def test_a_clutch_command_has_io_let_si_brakes_go_again_and_again_for_a_minute(si: SetupHarness) -> None:
    assert si.ask("clutch", "PSM1", 1.0).outcome == "refused"
    assert si.asked == []
    si.ask("state_command", "enable")
    assert si.ask("clutch", "PSM1", 1.0).outcome == "done"
    begun, row = si.now_ns, si.row("PSM1")
    for _ in range(500):
        si.step()
    assert set(si.asked) == {(row, True)} and 95 <= len(si.asked) <= 101, "io has them hold 30 ms after the last time"
    assert si.ask("clutch", "PSM1", 0.0).outcome == "done" and si.asked[-1] == (row, False)
    si.ask("clutch", "PSM1", 1.0)
    si.now_ns += CLUTCH_COMMAND_NS
    si.step()
    si.asked.clear()
    si.step(ms=20.0)
    assert si.asked == [] and not si.field("clutched")[row] and si.now_ns > begun
    si.pressed[row] = True
    si.step(ms=20.0)
    assert si.asked == [], "buttons are io's own"


@pytest.mark.parametrize("loss", ["of the arm", "of the setup joints"])
def test_a_loss_of_power_ends_the_clutch_of_an_si_arm_by_command(si: SetupHarness, loss: str) -> None:
    si.ask("state_command", "enable")
    si.ask("clutch", "PSM1", 1.0)
    run(si, 0.1)
    row = si.row("PSM1")
    assert si.field("clutched")[row] and si.asked
    if loss == "of the arm":
        si.powered[row] = False
        assert si.ask("clutch", "PSM1", 1.0).outcome == "refused", "nor does a new one wait for power"
        si.powered[row] = True
    else:
        si.step(*(FakeCommand("state_command", word) for word in ("disable", "enable")))
        assert si.field("sub_state").item() == b"ENABLED"
    si.asked.clear()
    run(si, 0.1)
    assert not si.asked and not si.field("clutched").any()
    assert si.reports.of("warning") == ["PSM1: clutch command ended: power went off; brakes engaged"]
    assert si.ask("clutch", "PSM1", 1.0).outcome == "done"


def test_si_brakes_are_the_arms_own(si: SetupHarness) -> None:
    assert np.isnan(si.field("brake_current")).all()
    si.step(FakeCommand("set_lift_velocity", "", 1.0))
    assert si.ask("set_lift_velocity", "", 1.0).outcome == "refused"


FAKE_BLEAK = '''
import sys, types
class BleakClient:
    def __init__(self, address, timeout): self.address, self.reads = address, 0
    async def __aenter__(self):
        if self.address.startswith("FF"): raise OSError("no adapter")
        return self
    async def __aexit__(self, *error): return None
    async def read_gatt_char(self, uuid):
        assert uuid == "babb122c-de4c-11ec-9d64-0242ac120101"
        return bytearray(b'{"timestamp": 1, "pots": [[1, 2, 3], [4, 5, 6]]}')
sys.modules["bleak"] = types.SimpleNamespace(BleakClient=BleakClient)
from trocar.procs.suj import bluetooth
sys.argv = ["x", "AA:BB:CC:DD:EE:01", "FF:BB:CC:DD:EE:02"]
bluetooth.main()
'''


def test_the_bluetooth_reader_tells_readings_and_why_there_are_none() -> None:
    child = subprocess.Popen([sys.executable, "-c", FAKE_BLEAK], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    reported = [json.loads(child.stdout.readline()) for _ in range(4)]
    child.stdout.close()
    child.terminate()
    child.wait(20)
    assert {"board": "FF:BB:CC:DD:EE:02", "problem": "OSError: no adapter"} in reported
    readings = [row["reading"] for row in reported if "reading" in row]
    assert readings and np.array_equal(counts(readings[0].encode()), [[1, 2, 3], [4, 5, 6]])


def test_the_reading_end_tells_why_nothing_comes_and_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    reported = [b'{"board": "aa:bb", "problem": "no adapter"}\n', b'nonsense\n{"board": "aa:bb", "reading": "{}"}\n']
    started = []

    def start(self: bluetooth.BluetoothBoards) -> None:
        started.append(self)
        output = reported.pop(0) if reported else b""
        self._child = subprocess.Popen([sys.executable, "-c", f"import os; os.write(1, {output!r})"],
                                       stdout=subprocess.PIPE)
        self._pipe, self._left, self._ended_ns = self._child.stdout.fileno(), b"", 0

    monkeypatch.setattr(bluetooth.BluetoothBoards, "_start", start)
    boards = bluetooth.BluetoothBoards(("AA:BB",))
    assert boards.problem("aa:bb") == "not connected yet"
    assert boards.poll(1) == [] and boards.problem("AA:BB") == "no adapter"
    boards.poll(2)
    assert boards._ended_ns == 2 and boards.problem("AA:BB") == "no adapter", "the reason stays"
    boards.poll(2 + bluetooth.AGAIN_NS)
    assert len(started) == 1
    assert boards.poll(3 + bluetooth.AGAIN_NS) == [("AA:BB", b"{}")] and boards.problem("AA:BB") == ""
    boards.poll(4 + bluetooth.AGAIN_NS)
    assert boards.problem("AA:BB") == "the Bluetooth reader has ended" and len(started) == 2
    boards.close()


def test_a_board_may_have_a_single_joint() -> None:
    assert np.array_equal(counts(b'{"pots": [[1], [2]]}'), [[1], [2]])


def test_a_board_with_too_few_potentiometers_is_told_and_its_arm_unknown(si: SetupHarness) -> None:
    address, all_of = si.cart.arms[1].board, si.link.poll
    si.link.poll = lambda now_ns: [(board, json.dumps({"pots": (counts(reading)[:, :2]).tolist()}).encode())
                                   if board == address else (board, reading) for board, reading in all_of(now_ns)]
    run(si, 0.5)
    assert si.field("setup_valid").tolist() == [True, False, True, True]
    assert si.reports.of("warning") == ["PSM1: its board has 2 potentiometers, 3 are expected"]


def test_the_reader_is_started_with_the_boards_it_is_to_read(monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[list[str]] = []
    start = subprocess.Popen

    def note(command: list[str], **options: object) -> object:
        commands.append(command)
        return start([sys.executable, "-c", ""], **options)

    monkeypatch.setattr(subprocess, "Popen", note)
    boards = bluetooth.BluetoothBoards(("AA:BB", "CC:DD"))
    boards.close()
    assert commands == [[sys.executable, "-m", "trocar.procs.suj.bluetooth", "AA:BB", "CC:DD"]]


@pytest.mark.parametrize("lacks", ["", "powered", "amps_on", "pid_enabled"])
def test_brakes_can_be_driven_with_power_amplifiers_and_leave_of_io(lacks: str) -> None:
    asked: list[tuple[str, float]] = []
    flags = {name: name != lacks for name in ("powered", "amps_on", "pid_enabled")}
    made = object.__new__(Classic)
    made._asked_ns = 1
    made._board = types.SimpleNamespace(**flags, has_fault=False, ask=lambda *what: asked.append(what))
    assert made.is_on() is (lacks == "")
    drive = [("pid_enable", 1.0)]
    assert asked == (drive if lacks == "pid_enabled" else []), "leave is asked for when the rest is there"
