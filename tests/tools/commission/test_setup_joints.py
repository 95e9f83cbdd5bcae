"""Potentiometers of Classic setup joints, found from measured poses; what is wrong is refused with its reason."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.suj.cart import Cart
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.config.read.source import read_source
from trocar.procs.host.objects import RememberedObjects
from trocar.tools.commission import setup_joints
from trocar.tools.commission.bench import SetupReadings
from trocar.tools.commission.finding import Outcome
from trocar.tools.commission.person import Act, Declined, Settle
from trocar.tools.commission.person_sim import PersonSim
from trocar.tools.commission.setup_judge import (
    MIN_WAY,
    RESIDUAL,
    SHARE,
    MeasuredPose,
    SetupSubject,
    judge_poses,
    judge_pots,
    judge_rest,
    lines,
)
from trocar.tools.commission.subject import Subject
from trocar.tools.output.errors import Problem

pytestmark = pytest.mark.slow

READING = np.array((0.0008, *np.radians([0.4] * 5)))
"""Errors of the person's readings, m and rad."""
WITHIN = np.array((0.002, *np.radians([1.0] * 5)))
"""Recovered positions, anywhere between the measured ones."""
MISTYPED = np.array((0.01, *np.radians([5.0] * 5)))
Fault = Callable[["SetupRig", str, np.random.Generator], str]


class SetupPerson(PersonSim):
    """Measures one setup arm, nearly right; `typing` changes what is typed."""

    def __init__(self, rig: SetupRig) -> None:
        super().__init__(rig.order, lambda subject: np.zeros(0))
        self.arm, self.dice, self.typing = "", np.random.default_rng(0), lambda pose, values: values
        self.confirmed, self.dangers, self.requests = list[str](), list[str](), list[str]()
        self.typed: list[np.ndarray] = []

    def confirm(self, danger: str, word: str) -> None:
        self.confirmed.append(word)
        self.dangers.append(danger)

    def agrees(self, question: str) -> bool:
        return question.startswith(f"SUJ/{self.arm}:")

    def doing(self, act: Act, text: str) -> Iterator[None]:
        self.requests.append(text)
        return super().doing(act, text)

    def report(self, line: str) -> None:
        pass

    def measured(self, question: str, act: Settle) -> tuple[float, ...]:
        count = len(act.position)
        values = np.array(act.position) + self.dice.uniform(-1.0, 1.0, count) * READING[:count]
        self.typed.append(self.typing(len(self.typed), values))
        return tuple(self.typed[-1])


class SetupRig:
    """The bench of a cart on emulated boards, on a stepped clock."""

    def __init__(self) -> None:
        self.cart = Cart()
        self.carts = (self.cart.cart,)
        self.document = self.cart.harness.system
        self.person = SetupPerson(self)
        self.time, self.shown = self, list[str]()

    def now_ns(self) -> int:
        return self.cart.harness.clock.ns

    def wait(self, seconds: float) -> None:
        self.cart.run(min(seconds, 0.04))

    def order(self, command: str, values: Sequence[float], text: str) -> None:
        if command == "press":
            self.cart.press(text, bool(values[0]))
        else:
            assert command == "set_position"
            BoardFaults(self.cart.harness.world, self.cart.harness.plant).place(text, np.array(values))

    def setup_readings(self, cart: object) -> SetupReadings:
        return SetupReadings.of(self.cart.field)

    def enable(self, subject: Subject) -> None:
        assert subject.arm == "SUJ" and subject.is_setup
        self.cart.enable()

    def disable(self, subject: Subject) -> None:
        self.cart.say("state_command", "disable")
        self.cart.run(0.1)

    @contextlib.contextmanager
    def showing(self, name: str, position: Sequence[float]) -> Iterator[None]:
        self.shown.append(name)
        yield

    def hide(self, name: str, dice: np.random.Generator) -> None:
        """Give an arm's potentiometers other scales and offsets than the file's."""
        arm = self.cart.plant.arms[name]
        alike = dice.uniform(0.92, 1.08, 6)
        pots = [[(scale * factor * dice.uniform(0.985, 1.015), offset + dice.uniform(-1.0, 1.0) * most)
                 for (scale, offset), factor, most in zip(row, alike, (0.05, *[0.12] * 5), strict=True)]
                for row in (arm.primary, arm.secondary)]
        self.cart.plant.arms[name] = replace(arm, primary=tuple(pots[0]), secondary=tuple(pots[1]))

    def run(self, name: str, dice: np.random.Generator, folder: Path) -> Outcome:
        self.person.arm, self.person.dice, self.person.typed = name, dice, []
        return setup_joints.run(self, folder)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def started() -> tuple[SetupRig, RememberedObjects]:
    made = SetupRig()
    return made, RememberedObjects({"rig": made})


@pytest.fixture
def rig(started: tuple[SetupRig, RememberedObjects]) -> SetupRig:
    started[1].put_back()
    return started[0]


def _joints(name: str) -> int:
    return 4 if name == "ECM" else 6


def _written(path: Path, name: str) -> dict[str, list[float]]:
    source, _ = read_source(path)
    assert source is not None
    return next(arm for arm in source.data["arms"] if arm["name"] == name)


NAMES = ("ECM", "PSM1", "PSM2", "PSM3")


@pytest.mark.parametrize("seed", range(24))
def test_hidden_scales_and_offsets_are_recovered(rig: SetupRig, seed: int, tmp_path: Path) -> None:
    dice, name = np.random.default_rng(seed), NAMES[seed % 4]
    rig.hide(name, dice)
    outcome = rig.run(name, dice, tmp_path)
    assert [str(problem) for problem in outcome.problems] == []
    (path,) = tmp_path.iterdir()
    assert path.name == "suj-ECM-1-2-3-rehearsed.json" and rig.shown == [f"SUJ/{name}"] * 3
    assert rig.person.confirmed == ["SUJ"] and not rig.cart.harness.record.powered.any()
    new, n, true = _written(path, name), _joints(name), rig.cart.plant.arms[name]
    ends = np.array([setup_joints.about(SetupSubject(rig.cart.cart, NAMES.index(name), n), [None] * k) for k in (0, 1)])
    for pots in ("primary", "secondary"):
        for joint in range(n):
            scale, offset = getattr(true, pots)[joint]
            volts = (ends[:, joint] - offset) / scale
            found = new[f"{pots}_offsets"][joint] + new[f"{pots}_scales"][joint] * volts
            assert np.abs(found - ends[:, joint]).max() <= WITHIN[joint], (pots, joint)
    old = Path(rig.cart.cart.source)
    assert all(_written(path, other) == _written(old, other) for other in NAMES if other != name)
    assert new["primary_offsets"][n:] == _written(old, name)["primary_offsets"][n:]


def _change(rig: SetupRig, name: str, pots: str, **joints: tuple[float, float]) -> None:
    arm = rig.cart.plant.arms[name]
    row = list(getattr(arm, pots))
    for joint, line in joints.items():
        row[int(joint[1:])] = line
    rig.cart.plant.arms[name] = replace(arm, **{pots: tuple(row)})


def _pots(dice: np.random.Generator) -> str:
    return str(dice.choice(["primary", "secondary"]))


def dead(rig: SetupRig, name: str, dice: np.random.Generator) -> str:
    pots, joint = _pots(dice), int(dice.integers(_joints(name)))
    _change(rig, name, pots, **{f"j{joint}": (0.0, 0.0)})
    return f"joint {joint + 1}, {pots} potentiometer"


def reversed_plug(rig: SetupRig, name: str, dice: np.random.Generator) -> str:
    joint, arm = int(dice.integers(_joints(name))), rig.cart.plant.arms[name]
    for pots in ("primary", "secondary"):
        scale, offset = getattr(arm, pots)[joint]
        _change(rig, name, pots, **{f"j{joint}": (-scale, offset + 4.5 * scale)})
    return "it runs the other way"


def swapped(rig: SetupRig, name: str, dice: np.random.Generator) -> str:
    one, other = (int(joint) for joint in dice.choice(range(1, _joints(name)), 2, replace=False))
    pots, settle = {"primary": 0, "secondary": 6}[_pots(dice)], rig.cart.plant.settle

    def settles(arm: str, positions: Sequence[float]) -> None:
        settle(arm, positions)
        if arm == name:
            row = rig.cart.plant._voltages[rig.cart.plant.arms[arm].plug - 1]
            row[[pots + one, pots + other]] = row[[pots + other, pots + one]]

    rig.cart.plant.settle = settles  # type: ignore[method-assign]
    return "are their plugs swapped?"


def slack(rig: SetupRig, name: str, dice: np.random.Generator) -> str:
    """A potentiometer follows its joint only at either end of its play."""
    joint, way, settle = int(dice.integers(_joints(name))), 3.0 * dice.uniform(1.0, 1.5), rig.cart.plant.settle
    which, at = _pots(dice), [0.0]

    def settles(arm: str, positions: Sequence[float]) -> None:
        settle(arm, positions)
        if arm == name:
            half = 0.5 * way * WITHIN[joint]
            at[0] = float(np.clip(at[0], positions[joint] - half, positions[joint] + half))
            scale, offset = getattr(rig.cart.plant.arms[name], which)[joint]
            row = rig.cart.plant._voltages[rig.cart.plant.arms[arm].plug - 1]
            row[joint + 6 * (which == "secondary")] = (at[0] - offset) / scale

    rig.cart.plant.settle = settles  # type: ignore[method-assign]
    return "it has slack, or is worn or loose"


def mistyped(rig: SetupRig, name: str, dice: np.random.Generator) -> str:
    joint, at = int(dice.integers(_joints(name))), int(dice.integers(3))
    error = dice.choice((-1.0, 1.0)) * dice.uniform(1.0, 2.0) * MISTYPED[joint]

    def types(pose: int, values: np.ndarray) -> np.ndarray:
        values[joint] += error * (pose == at)
        return values

    rig.person.typing = types
    return "off, by both potentiometers|in the third pose"


def other_arm(rig: SetupRig, name: str, dice: np.random.Generator) -> str:
    """The plugs of two arms are swapped, that of the clutch and the brakes as well."""
    other = next(each for each in NAMES if each != name and _joints(each) == _joints(name)) if name != "ECM" else "PSM3"
    order, names = rig.order, {f"SUJ/{name}": f"SUJ/{other}"}
    clutches = {f"SUJ_clutch_{NAMES.index(one) + 1}": f"SUJ_clutch_{NAMES.index(two) + 1}"
                for one, two in ((name, other), (other, name))}
    rig.person._order = lambda command, values, text: order(command, values, names.get(text, clutches.get(text, text)))
    return "are the plugs of these two arms swapped"


def other_scale(rig: SetupRig, name: str, dice: np.random.Generator) -> str:
    joint, pots = int(dice.integers(_joints(name))), _pots(dice)
    scale, offset = getattr(rig.cart.plant.arms[name], pots)[joint]
    middle = offset + 2.25 * scale
    _change(rig, name, pots, **{f"j{joint}": (1.25 * scale, middle - 2.25 * 1.25 * scale)})
    return "within 15 %"


@pytest.mark.parametrize("seed", range(24, 52))
def test_what_is_wrong_is_refused_with_its_reason_and_writes_nothing(rig: SetupRig, seed: int, tmp_path: Path) -> None:
    faults: tuple[Fault, ...] = (dead, reversed_plug, swapped, slack, mistyped, other_arm, other_scale)
    dice, name, breaks = np.random.default_rng(1000 + seed), NAMES[seed % 4], faults[seed % len(faults)]
    if breaks not in (other_scale, other_arm):
        rig.hide(name, dice)
    reason = breaks(rig, name, dice)
    outcome = rig.run(name, dice, tmp_path)
    assert outcome.problems, (name, breaks.__name__)
    said = "\n".join(map(str, outcome.problems))
    assert any(each in said for each in reason.split("|")) and f"SUJ/{name}" in str(outcome.problems[0])
    assert list(tmp_path.iterdir()) == [] and not rig.cart.harness.record.powered.any()


def test_an_arm_that_passed_before_another_one_failed_is_written_and_clutches_are_waited_for(
        rig: SetupRig, tmp_path: Path) -> None:
    rig.person.agrees = lambda question: "ECM" in question or "PSM1" in question  # type: ignore[method-assign]
    dice = np.random.default_rng(5)
    rig.hide("ECM", dice)
    dead(rig, "PSM1", dice)
    outcome = rig.run("", dice, tmp_path)
    assert "PSM1 joint" in str(outcome.problems[0]) and "new values of ECM" in outcome.notes[-1]
    (path,) = tmp_path.iterdir()
    old = Path(rig.cart.cart.source)
    assert _written(path, "ECM") != _written(old, "ECM") and _written(path, "PSM1") == _written(old, "PSM1")
    assert json.loads(path.read_text())["arms"]


def test_nothing_has_power_before_the_name_is_typed(
        rig: SetupRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def declines(danger: str, word: str) -> None:
        raise Declined(danger)

    monkeypatch.setattr(rig.person, "confirm", declines)
    with pytest.raises(Declined, match="a setup arm has no brakes"):
        rig.run("ECM", np.random.default_rng(0), tmp_path)
    assert not rig.cart.harness.record.power_requested.any()


@pytest.mark.parametrize("ends", [Problem("PSM1 is gone"), Declined("the input has ended"), TimeoutError("no answer")])
def test_arms_that_passed_are_written_although_the_next_one_ended_the_stage(
        rig: SetupRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ends: Exception) -> None:
    monkeypatch.setattr(rig.person, "agrees", lambda question: "ECM" in question or "PSM1" in question)
    measured = rig.person.measured

    def measures(question: str, act: Settle) -> tuple[float, ...]:
        if act.arm == "PSM1":
            raise ends
        return measured(question, act)

    monkeypatch.setattr(rig.person, "measured", measures)
    dice = np.random.default_rng(5)
    rig.hide("ECM", dice)
    outcome = rig.run("", dice, tmp_path)
    assert str(ends) in str(outcome.problems[0]) and "new values of ECM" in outcome.notes[-1]
    (path,) = tmp_path.iterdir()
    assert outcome.files == [path] and _written(path, "ECM") != _written(Path(rig.cart.cart.source), "ECM")
    assert not rig.cart.harness.record.powered.any()


@pytest.mark.parametrize("write", [True, False])
def test_a_file_that_could_not_be_written_is_refused_before_the_confirmation(
        rig: SetupRig, tmp_path: Path, write: bool) -> None:
    yaml = tmp_path / "suj.yaml"
    rig.carts = (replace(rig.cart.cart, source=str(yaml)),) if write else rig.carts
    with pytest.raises(Problem, match="is no JSON" if write else "no file can be written"):
        setup_joints.run(rig, tmp_path if write else tmp_path / "absent", write=write)  # type: ignore[arg-type]
    assert rig.person.confirmed == []


def test_the_person_is_warned_of_the_column_that_moves_and_of_calibration_mode(
        rig: SetupRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig.person, "agrees", lambda question: "PSM2:" in question or "PSM3:" in question)
    assert rig.run("", np.random.default_rng(0), tmp_path).problems == []
    (danger,) = rig.person.dangers
    for words in ("motor_up and motor_down move the column of PSM3", "PSM3 can sink", "mains switch within reach",
                  "with the emergency stop within reach", "keyboard only while all clutches are released"):
        assert words in danger
    assert "calibration mode" not in danger
    assert ["only with its clutch released" in text for text in rig.person.requests] == [False] * 3 + [True] * 3
    still = replace(rig.cart.cart, arms=tuple(replace(arm, lifts=False) for arm in rig.cart.cart.arms))
    rig.carts = (still,)
    rig.document = replace(rig.document, ios=tuple(replace(io, calibration_mode=True) for io in rig.document.ios))
    monkeypatch.setattr(rig.person, "agrees", lambda question: False)
    assert rig.run("", np.random.default_rng(0), tmp_path).problems == []
    assert "column of" not in rig.person.dangers[1] and "in calibration mode: any program" in rig.person.dangers[1]


def test_typed_values_that_cannot_be_and_voltages_that_change_at_rest_are_refused(rig: SetupRig) -> None:
    arm = SetupSubject(rig.cart.cart, 1, 6)
    first, second = setup_joints.about(arm, []), setup_joints.about(arm, [None])  # type: ignore[list-item]
    poses = [MeasuredPose(position, np.zeros((4, 2, 6))) for position in (first, second)]
    third = setup_joints.about(arm, poses)

    def reason(*changes: tuple[int, int, float]) -> str:
        rows = np.array((first, second, third))
        for pose, joint, value in changes:
            rows[pose, joint] = value
        found = judge_poses([MeasuredPose(row, poses[0].volts) for row in rows], arm)
        return str(found[0]) if found else ""

    assert reason() == ""
    assert "350000.0 mm was typed" in reason((0, 0, 350.0)) and "is it in mm" in reason((0, 0, 350.0))
    assert "apart; allowed: 45.0° at least" in reason((1, 2, first[2] + 0.1))
    assert "in the third pose" in reason((2, 3, first[3]))
    assert "same share of its way as joint 2" in reason((2, 2, first[2] + 0.428 * (second[2] - first[2])))
    spread = np.zeros((4, 2, 6))
    assert judge_rest(spread, arm) == []
    spread[1, 1, 3] = 0.03
    assert "joint 4, secondary potentiometer, plug 2: its voltage changes at rest by 0.030 V" in str(
        judge_rest(spread, arm)[0])
    assert "the arm has moved" in str(judge_rest(spread, arm, moved=True)[0])
    spread[0, 0, 0] = 1.0  # of another arm
    assert "secondary" in str(judge_rest(spread, arm)[0])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("at", range(3))
@pytest.mark.parametrize("joint", range(6))
def test_no_value_mistyped_by_more_than_the_page_says_passes(
        started: tuple[SetupRig, RememberedObjects], joint: int, at: int, sign: float) -> None:
    arm = SetupSubject(started[0].cart.cart, 1, 6)
    pots = (arm.row.primary, arm.row.secondary)
    way = np.where(np.arange(6) == joint, MIN_WAY, 1.5 * np.array(MIN_WAY))  # shorter ways hide more
    for share in np.linspace(0.2, 0.8, 61):
        shares = np.linspace(0.38, 0.62, 6)
        shares[joint] = share
        true = np.array([0.3 * (np.arange(6) == 0), way + 0.3 * (np.arange(6) == 0), shares * way])
        true[2, 0] += 0.3
        middle = np.where(np.arange(6) == 0, 0.0, 0.5 * way)
        volts = np.zeros((3, 4, 2, 6))
        for which, rows in enumerate(pots):
            scales, offsets = np.array(rows).T
            volts[:, 1, which] = (true - middle - offsets) / scales
        typed = true - middle
        typed[at, joint] += sign * 3.5 * RESIDUAL[joint]
        poses = [MeasuredPose(row, row_v) for row, row_v in zip(typed, volts, strict=True)]
        assert judge_poses(poses, arm) or judge_pots(poses, arm), (share, SHARE)


def test_the_line_is_that_of_the_original(started: tuple[SetupRig, RememberedObjects]) -> None:
    cart = started[0].cart.cart
    poses = [MeasuredPose(np.radians(np.full(6, angle)), np.full((4, 2, 6), volts))
             for angle, volts in ((-90.0, 0.75), (90.0, 3.75))]
    assert lines(poses, SetupSubject(cart, 1, 6))[0, 1] == pytest.approx((1.0471975512, -2.3561944902))
