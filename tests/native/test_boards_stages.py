"""The boards' stages by native code and by numpy: the same bits from any state and motion, and in every scenario."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.boards.harness import MASK, MS, ON, VALID, Desk, board
from tests.boards.test_brakes import BrakedRails, braked
from tests.examples import examples
from tests.native.shadow import chosen_both
from trocar.procs.boards.controllers.edges import STRIDE
from trocar.procs.boards.controllers.encoder import Encoders, Floats
from trocar.procs.boards.controllers.models import Model
from trocar.procs.boards.emulation import Emulation
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire
from trocar.procs.native import library
from trocar.procs.native.boards_fields import BOARDS, ENCODERS, WORLD
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.library import SWITCH, bind, native

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ("tests/boards/controllers", "tests/boards/test_emulation.py", "tests/boards/test_brakes.py",
             "tests/boards/test_setup_joints.py", "-k", "not (noise_of or steps_through or jammed)",
             "tests/boards/robots/test_plant.py", "tests/boards/robots/test_plant_hands.py",
             "tests/boards/test_wrong_cables.py", "tests/boards/test_board_faults.py")
MIXES = ((("QLA1", 7),) * 3, (("QLA1", 8),) * 3, (("QLA1", 9),) * 3, (("DQLA", 8),) * 2, (("DQLA", 9),) * 2,
         (("dRA1", 8),) * 2, (("dRA1", 9),) * 2, (("QLA1", 7), ("QLA1", 8)), (("QLA1", 9), ("DQLA", 9), ("dRA1", 9)))
SPANS = (1, 7, 4915, 49152, 1_000_000)  # ticks of a step


@pytest.fixture
def both_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is made from now on does all stages by native code and by numpy, and compares."""
    monkeypatch.setattr(library, "chosen", chosen_both)


def curve_from(x0: Floats, span: int, rng: np.random.Generator) -> Floats:
    """Motion of every axis: at rest, slow, fast, many counts at once, turning round within the step or not."""
    n = x0.size
    x0 = np.where(rng.random(n) < 0.3, np.rint(x0) + rng.choice((0.0, 0.0, 1e-13, -1e-10), n), x0)
    v = rng.choice((-1.0, 1.0), n) * 10.0 ** rng.uniform(-14.0, 0.5, n)
    h = -0.5 * v / (span * rng.uniform(0.01, 2.0, n)) * rng.choice((-1.0, 0.0, 1.0), n)
    still = rng.random(n) < 0.2
    return np.array((x0, np.where(still, 0.0, v), np.where(still & (rng.random(n) < 0.8), 0.0, h)))


@pytest.mark.usefixtures("both_ways")
@given(st.integers(0, 2**32 - 1), st.sampled_from((4, 7, 10)))
@pytest.mark.slow
def test_encoders_show_the_same_bits_after_any_motion(seed: int, width: int) -> None:
    rng = np.random.default_rng(seed)
    encoders = Encoders(3, width, (Quirks(), Quirks(direction_lag=False), Quirks(sticky_overflow=False)))
    n, tick = 3 * width, 0
    x = rng.uniform(-1e4, 1e4, n)
    encoders.place(x)
    if rng.random() < 0.5:  # from anything at all, and ends of counters not far
        encoders.state[...] = rng.integers(0, encoders.states // STRIDE, n) * STRIDE
        encoders.queue[...] = rng.integers(-(1 << 41), 1, encoders.queue.shape)
        encoders.load(np.arange(n), rng.choice((0, 3, reg.ENCODER_MASK, reg.ENCODER_MASK - 4), n))
    for _ in range(4):
        span = int(rng.choice(SPANS))
        curve = curve_from(x, span, rng)
        encoders.follow(tick, span, curve)
        for share in np.sort(rng.random(3)):
            encoders.observe(tick + int(share * span))
            encoders.words(tick + int(share * span))
        tick += span + int(rng.choice((0, 0, 100)))
        encoders.observe(tick)
        x = (curve[2] * span + curve[1]) * span + curve[0]


@pytest.mark.usefixtures("both_ways")
@given(st.integers(0, 2**32 - 1), st.sampled_from(MIXES))
@examples(30)
@pytest.mark.slow
def test_a_host_gets_the_same_bits_from_controllers_of_every_kind(seed: int, mix: tuple[tuple[str, int], ...]) -> None:
    rng = np.random.default_rng(seed)
    desk = Desk(*(board(firmware, hardware, number, qla=str(rng.choice(("1.4", "1.5"))))
                  for number, (hardware, firmware) in enumerate(mix)))
    bus, models = desk.bus, desk.bus.firmware.models
    for number in range(len(mix)):
        desk.write(reg.STATUS, reg.CONTROL_POWER_ON | reg.CONTROL_RELAY_ON, number)
    x, top = rng.uniform(-1e3, 1e3, bus.encoders.slots), VALID | ON
    mask, hub_bytes = (1 << len(mix)) - 1, 4 * (sum(model.layout.read_quads + 1 for model in models) + 1)
    for _ in range(12):
        bus.step(desk.tick)
        curve = curve_from(x, 10 * MS, rng)
        bus.encoders.follow(desk.tick, 10 * MS, curve)
        x = (curve[2] * 10 * MS + curve[1]) * 10 * MS + curve[0]
        bus.lines.adc[...] = rng.integers(0, 1 << 32, bus.lines.adc.shape, dtype=np.uint32)
        for _ in range(3):
            desk.tick += MS
            query = int(rng.integers(1 << 16)) << 16 | (mask if rng.random() < 0.9 else int(rng.integers(mask + 1)))
            for _ in range(rng.integers(1, 3)):  # now and then two at one tick
                bus.answer(wire.quadlet_write(wire.BROADCAST, reg.QUERY, query, 1, bus.generation), desk.tick)
            bus.answer(wire.block_read(0, reg.HUB, hub_bytes, 1, bus.generation), desk.tick)
            top = top if rng.random() < 0.8 else int(rng.choice((VALID | ON, VALID, ON, VALID | MASK, 0)))
            control = 0 if rng.random() < 0.9 else reg.CONTROL_POWER_ON | reg.CONTROL_RELAY_ON
            order = models if rng.random() < 0.8 else models[::-1]
            desk.block(*(quad for model in order for quad in group_of(model, top, control, rng)))
        desk.write(reg.DIGITAL_OUTPUT, int(rng.integers(16)) | 0xF00, 0)
        desk.tick += 7 * MS


def group_of(model: Model, top: int, control: int, rng: np.random.Generator) -> list[int]:
    """A board's part of a block: any currents, the same top byte in all words."""
    words = [top | int(value) for value in rng.integers(0, 1 << 16, model.hardware.motors)]
    if model.firmware == 7:
        return [*(word | model.board_id << reg.DAC_BOARD_SHIFT for word in words), control]
    return [model.board_id << 8 | model.layout.write_quads, *words, control]


@pytest.mark.usefixtures("both_ways")
@given(st.integers(0, 2**32 - 1))
@pytest.mark.slow
def test_sensors_and_motion_are_the_same_bits_from_anything(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rails = BrakedRails(7)
    boards = Emulation(braked(), rails, 0)
    bound = bind(WORLD, boards)
    assert isinstance(bound, BoundStruct)
    for which in rng.permutation(16).tolist():
        for name, array in bound.arrays.items():
            if array.dtype.kind == "f" and name not in ("scales", "offsets"):
                array[...] = rng.normal(0.0, 10.0 ** rng.integers(-3, 5), array.shape)
        rails.pot_position[...] = rng.normal(0.0, 2.0, 7)
        boards.dac[...] = rng.integers(0, 1 << 16, boards.slots)
        boards.on[...], boards.let_go[...] = rng.random(boards.slots) < 0.5, rng.random(boards.brakes) < 0.5
        boards._on_bytes = b""
        boards._sense(which)
        boards._move()


def test_arrays_of_encoders_stay_where_they_are() -> None:
    encoders = Encoders(2)
    bound = bind(ENCODERS, encoders)
    assert isinstance(bound, BoundStruct)
    encoders.place(np.full(8, 0.5))
    encoders.follow(0, 49152, np.array((np.full(8, 0.5), np.full(8, 0.01), np.full(8, -1e-6))))
    encoders.observe(30_000)
    encoders.load(np.array([3]), np.array([77]))
    encoders.jump(2, 5)
    encoders.power_up(1)
    encoders.words(40_000)
    assert not bound.moved()


@pytest.mark.slow
def test_every_stage_of_the_scenarios_is_the_same_by_native_and_numpy() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.native.shadow", "-p", "no:cacheprovider", "-m",
               "not slow", *SCENARIOS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
    compared = done.stdout[done.stdout.index("\ncompared ") :].splitlines()[1].split()[3:]
    assert {name for table in BOARDS for name in table.functions} <= set(compared)


def test_without_native_code_numpy_does_the_work() -> None:
    code = ("from trocar.procs.boards.controllers.encoder import Encoders; encoders = Encoders(1); "
            "print(encoders._advance == encoders.advance)")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env={SWITCH: "0"}, capture_output=True, text=True,
                          timeout=60, check=True)
    assert done.stdout == "True\n"
