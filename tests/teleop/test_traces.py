"""Long plays of masters, slaves, consoles and people: what teleoperations do in each step of them; see tests.traces."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest

from tests.arm.fake_requests import FakeRequest
from tests.teleop.harness import EcmHarness, FakeTeleopArm, TeleopHarness
from tests.traces import Mishaps, Trace, shown
from trocar.procs.teleop.teleop import Teleop
from trocar.shm.mailbox.origins import Origin
from trocar.shm.operator_topics import TELEOP_STATE

FOLDER = Path(__file__).parent / "traces"
STEPS = 700
MS = 1_000_000
HANDS = {"MTML": (0.15, -0.05, 0.40), "MTMR": (-0.15, -0.05, 0.40)}
STEPS_MS = (10, 10, 10, 10, 10, 10, 10, 5, 5, 1, 20, 30, 35, 50, 100, 400)  # edges of all timeouts are multiples of 5
FIELDS = [field.name for field in TELEOP_STATE.fields]
PERSONS = (("state_command", (), "enable"),) * 6 + (
    ("state_command", (), "disable"), ("state_command", (), "align_MTM"), ("state_command", (), "fly"),
    ("state_command", (1.0,), "enable"), ("clutch", (1.0,), ""), ("clutch", (0.0,), ""), ("clutch", (2.0,), ""),
    ("clutch", (3.0,), ""), ("clutch", (0.0,), ""), ("clutch", (1.0,), ""), ("clutch", (0.0,), ""),
    ("set_scale", (0.5,), ""), ("set_scale", (0.0,), ""), ("set_scale", (math.nan,), ""), ("set_scale", (), ""),
    ("lock_rotation", (1.0,), ""), ("lock_rotation", (0.0,), ""), ("lock_rotation", (0.5,), ""),
    ("lock_translation", (1.0,), ""), ("lock_translation", (0.0,), ""), ("set_align_MTM", (1.0,), ""),
    ("set_align_MTM", (0.0,), ""), ("following/mtm/body/servo_cf", (0.1, -0.2, 0.3, 0.01, 0.02, 0.03), ""),
    ("following/mtm/body/servo_cf", (0.0,) * 6, ""), ("following/mtm/body/servo_cf", (0.5,) * 6, ""), ("dance", (), ""),
)
KINDS: dict[str, Callable[[], TeleopHarness]] = {
    "psm": lambda: TeleopHarness(start_gripper_threshold=0.3),
    "psm-carried": lambda: TeleopHarness(base=True, use_mtm_angular_velocity=True, jaw_rate=3.0, scale=0.4,
                                         jaw_rate_after_clutch=1.0, gripper_zero=0.1, wrench_timeout_s=0.0),
    "psm-on-setup-arm": lambda: TeleopHarness(setup=1, console=False, ignore_jaw=True, rotation_locked=True,
                                              use_mtm_linear_velocity=False),
    "psm-of-a-plain-master": lambda: TeleopHarness(mtm_is_haptic=False, align_mtm=False, translation_locked=True),
    "ecm": lambda: EcmHarness(),
    "ecm-turned": lambda: EcmHarness(scale=0.6, camera_roll_offset=0.5),
}


class TeleopPlay:
    """One teleoperation, and what happens around it."""

    def __init__(self, harness: TeleopHarness, seed: str) -> None:
        self.harness, self.chance, self.trace = harness, Random(seed), Trace()
        self.faults = SimpleNamespace(valid_from=0, exempt_origin=0)
        harness.faults = self.faults  # type: ignore[assignment]
        harness.start()
        for name, arm in harness.arms.items():
            arm.ring.set(measured_cv=(0.01, 0.02, 0.03, 0.1, 0.2, 0.3), gripper_position=0.2 + len(name) / 20)
        if harness.base is not None:
            harness.base.field("measured_cp")[..., 6] = 1.0
            self.base_known(True)
        self.mishaps = Mishaps(self.chance, [pair for arm in harness.arms.values() for pair in self.of_arm(arm)]
                               + self.of_others() * 2, often=0.04, longest=12)

    def base_known(self, on: bool) -> None:
        base = self.harness.base
        if base is not None:
            base.field("reference_valid" if self.harness.setup is None else "base_valid")[...] = on

    def of_arm(self, arm: FakeTeleopArm) -> list[tuple[Callable[[], object], Callable[[], object]]]:
        ring = arm.ring

        def changed(**values: Any) -> tuple[Callable[[], object], Callable[[], object]]:
            before = {name: ring.field(name).copy() for name in values}
            return lambda: ring.set(**values), lambda: ring.set(**before)

        def nothing() -> None:
            """It is over by itself."""

        x = self.chance.choice
        return [
            changed(state=b"FAULT", sub_state=b"FAULT"), changed(is_homed=False, sub_state=b"ENABLED"),
            changed(state=b"DISABLED", sub_state=b"DISABLED", is_homed=False), changed(reference_valid=False),
            changed(sub_state=b"MANUAL"), changed(is_busy=True), changed(tool=b"SMALL"), changed(has_jaw=False),
            changed(gripper_valid=False), changed(simulated=True), changed(measured_cp=math.nan),
            changed(base_frame=(0.005, 0, 0, 0, 0, 0, 1)), changed(base_frame=(0, 0.006, 0, 0, 0, 0, 1)),
            changed(base_frame=(0, 0, 0, 0, 0, math.sin(0.06), math.cos(0.06))), changed(control_mode=1),
            (lambda: setattr(arm, "alive", False), lambda: setattr(arm, "alive", True)),
            (lambda: setattr(arm, "obeys", False), lambda: setattr(arm, "obeys", True)),
            (lambda: setattr(ring, "torn", True), lambda: setattr(ring, "torn", False)),
            (lambda: setattr(ring, "epoch", ring.epoch + 1), nothing),
            (lambda: arm.stop("play"), nothing),
            (lambda: arm.fail(f"{arm.name} broke"), nothing), (lambda: arm.fail("far", "inverse-kinematics"), nothing),
            (lambda: arm.refuses.update({name: f"no {name} now" for name in x((("servo_cp", "servo_jp"), ("move_cp",),
             ("body/servo_cf", "use_gravity_compensation")))}), arm.refuses.clear),
            (lambda: arm.says.update({"servo_cp": x(("at its limit: yaw", "clipped: yaw", "clipped: jaw", "hm: yaw")),
                                      "servo_jp": "clipped: roll"}), arm.says.clear),
            (lambda: arm.says.update({"jaw/servo_jp": "clipped: jaw", "body/servo_cf": "clipped: roll"}),
             arm.says.clear),
        ]

    def of_others(self) -> list[tuple[Callable[[], object], Callable[[], object]]]:
        def fault() -> None:
            self.faults.valid_from += 1
            for arm in self.harness.arms.values():
                arm.valid_from = self.faults.valid_from

        pairs: list[tuple[Callable[[], object], Callable[[], object]]] = [(fault, lambda: None)]
        harness, console, base = self.harness, self.harness.console, self.harness.base
        if console is not None:
            pairs += [
                (lambda: console.set(operator_present=False), lambda: console.set(operator_present=True)),
                (lambda: console.set(valid=False), lambda: console.set(valid=True)),
                (lambda: setattr(harness, "console_alive", False), lambda: setattr(harness, "console_alive", True)),
                (lambda: setattr(console, "epoch", console.epoch + 1), lambda: console.set(clutch=False)),
                (lambda: console.set(clutch=True), lambda: setattr(console, "epoch", console.epoch + 1))]
        if base is not None:
            pairs += [(lambda: self.base_known(False), lambda: self.base_known(True)),
                      (lambda: base.set(measured_cp=(0.02, 0.01, 0, 0, 0, 0.1, math.sqrt(0.99))), lambda: None)]
        return pairs

    def move(self) -> None:
        """Hands, rarely the slave."""
        harness, chance = self.harness, self.chance
        for name in harness.names[:-1]:
            arm = harness.arms[name]
            if chance.random() < (0.05 if harness.names[0] == "MTMR" else 0.2):
                middle = (0.0, 0.0, 0.0) if harness.names[0] == "MTMR" else HANDS[name]
                arm.shift(*(chance.choice((-0.01, 0.0, 0.01)) + 0.05 * (there - here)
                            for here, there in zip(arm.pose[:3], middle, strict=True)))
                arm.turn(chance.randrange(3), chance.choice((-0.02, 0.05, 0.1)))
            if chance.random() < 0.1:
                arm.ring.set(gripper_position=chance.choice((-0.3, 0.0, 0.2, 0.8, 1.2)))
        if chance.random() < 0.01:
            harness.slave.turn(chance.randrange(3), 0.12)

    def ask(self) -> list[FakeRequest]:
        if self.chance.random() > 0.12:
            return []
        name, values, text = self.chance.choice(PERSONS)
        origin = Origin(1 + len(self.trace.lines), self.faults.valid_from, "play")
        return [FakeRequest(name, values, text, kind="teleop", origin=origin)]

    def step(self) -> None:
        harness = self.harness
        self.mishaps.step()
        self.move()
        requests = self.ask()
        for arm in harness.arms.values():
            arm.advance()
        harness.now_ns += self.chance.choice(STEPS_MS) * MS
        alive = [arm.ring for arm in harness.arms.values() if arm.alive]
        rings = [*alive, *(ring for ring in (harness.base,) if ring is not None)]
        if harness.console is not None and harness.console_alive:
            rings.append(harness.console)
        for ring in rings:
            ring.stamp_ns = harness.now_ns
        harness.teleop.step(harness.now_ns, requests)
        self.look(requests)

    def look(self, requests: list[FakeRequest]) -> None:
        harness = self.harness
        did = [f"{r.name} {r.text}{shown(r.values)}: {', '.join(map(' '.join, r.replies))}" for r in requests]
        did += harness.reports.log
        for arm in harness.arms.values():
            did += [f"{arm.name} < {name} {text}{shown(values)}" for name, values, text in arm.sent]
            did += [f"{arm.name} for {origin.id}" for origin in arm.origins]
            arm.origins.clear()
        harness.forget()
        self.trace.look(did, ((name, self.value(name)) for name in FIELDS))

    def value(self, name: str) -> Any:
        value = self.harness.record.field(name)
        return (self.harness.now_ns - value) * (value != 0) / MS if name.endswith("_ns") else value


@pytest.mark.parametrize("kind", KINDS)
def test_teleoperations_do_in_a_long_play_what_they_did(kind: str) -> None:
    play = TeleopPlay(KINDS[kind](), kind)
    for _ in range(STEPS):
        play.step()
    states = " ".join(play.trace.lines)
    assert all(f"current_state {state}" in states for state in ("DISABLED", "SETTING_ARMS_STATE", "ENABLED"))
    teleop: Teleop = play.harness.teleop
    teleop.leave(play.harness.now_ns)
    play.look([])
    play.trace.compare(FOLDER / f"{kind}.txt")
