"""A sterile adapter and an instrument are put on a PSM, found out about, engaged, and taken off again."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from procs.lib.document import ArmInputs
from tests.arm.fake_io import PERIOD_NS, TOOL, Rig, bare_arm, fixed_arm

INPUTS = {"PSM1_arm_clutch": 0, "PSM1_adapter": 1, "PSM1_tool": 2}
NAMES = ArmInputs(clutch="PSM1_arm_clutch", adapter="PSM1_adapter", tool="PSM1_tool")
DRIVER = "LARGE_NEEDLE_DRIVER:400006"
OTHER = dataclasses.replace(TOOL, name="MEGA_NEEDLE_DRIVER_400194", names=("MEGA_NEEDLE_DRIVER",), model="400194")
FASTEST = np.array((1.58, 1.58, 0.2, 18.9, 18.9, 18.9, 18.9)) * PERIOD_NS * 1e-9 * 1.01


class Cart(Rig):
    """A PSM with switches for adapter and instrument; every cycle's step of every actuator is looked at."""

    def __init__(self, **changes: Any) -> None:
        detection = {"tool_detection": "MANUAL", "tools": (TOOL, OTHER), **changes}
        super().__init__(bare_arm(inputs=NAMES, instrument_reader="PSM1_dallas", **detection), inputs=INPUTS)
        self.largest = np.zeros(7)

    def step(self, *requests: Any) -> None:
        before = self.io.setpoint.copy()
        super().step(*requests)
        self.largest = np.maximum(self.largest, np.abs(self.io.setpoint - before))

    def homed(self) -> Cart:
        self.run(0.6)
        super().homed()
        self.largest[...] = 0.0
        return self

    def retracted(self) -> Cart:
        """So far out that an instrument is not beyond the cannula."""
        move = self.send("move_jp", (0.1, -0.1, 0.01, *self.state["setpoint_position"][3:7]))
        self.until(lambda: "done" in move.outcomes)
        return self

    def put_on(self, *names: str) -> None:
        for name in names:
            self.press(f"PSM1_{name}")
        self.run(0.01)

    def take_off(self, *names: str) -> None:
        for name in names:
            self.press(f"PSM1_{name}", False)
        self.run(0.01)

    @property
    def told(self) -> list[str]:
        return [e[1].removeprefix("PSM1: ") for e in self.reports.of("status") if "engaging" in e[1]]

    @property
    def types(self) -> list[tuple[str, str]]:
        return [e[:2] for e in self.reports.of("tool_type", "tool_type_request")]

    @property
    def homed_flag(self) -> bool:
        return bool(self.state["is_homed"])

    def nothing_jumped(self) -> bool:
        return bool((self.largest <= FASTEST).all())


def test_a_bare_arm_is_homed_in_seven_joints() -> None:
    cart = Cart().homed()
    assert cart.state["count"] == 7 and cart.homed_flag
    assert not cart.state["cartesian_valid"] and not cart.state["has_jaw"]
    assert cart.state["adapter"] == cart.state["instrument"] == 1


def test_adapter_put_on_is_engaged_by_four_swings() -> None:
    cart = Cart().homed()
    yaw, pitch = cart.io.setpoint[:2].copy()
    cart.put_on("adapter")
    assert cart.arm.state == "ENGAGING_ADAPTER" and cart.state["is_busy"] and not cart.homed_flag
    assert not cart.io.flag("limits_enforced") and cart.io.flag("tracking_check")
    extremes = []
    while cart.arm.state == "ENGAGING_ADAPTER":
        cart.step()
        extremes.append(cart.io.setpoint[2:].copy())
    discs = np.array(extremes)[:, 1:]
    assert np.degrees(discs.min(axis=0)) == pytest.approx([-171] * 4, abs=1e-6)
    assert np.degrees(discs.max(axis=0)) == pytest.approx([171] * 4, abs=1e-6)
    assert np.allclose(cart.io.setpoint, (yaw, pitch, 0, 0, 0, 0, 0), atol=1e-6)
    assert cart.told == [f"engaging adapter {k} of 4" for k in (1, 2, 3, 4)]
    cart.run(0.1)
    assert cart.arm.state == "HOMED" and cart.homed_flag and not cart.state["is_busy"]
    assert cart.io.flag("limits_enforced") and cart.nothing_jumped()
    assert not cart.reports.of("goal_reached", "error", "warning")
    busy = [e[4] for e in cart.reports.of("operating_state")]
    assert busy == [True, False]


def test_a_full_adapter_swing_takes_as_long_as_in_the_reference() -> None:
    cart = Cart().homed()
    cart.put_on("adapter")
    cart.until(lambda: len(cart.told) == 1)
    assert cart.until(lambda: len(cart.told) == 2) == pytest.approx(1.378, abs=0.005)


def test_adapter_taken_off_while_engaging_leaves_the_arm_homed() -> None:
    cart = Cart().homed()
    cart.put_on("adapter")
    cart.run(1.0)
    assert cart.send("move_jp", (0.0,) * 7).outcomes == ["refused"]
    cart.take_off("adapter")
    here = cart.io.setpoint.copy()
    cart.run(0.2)
    assert cart.arm.state == "HOMED" and cart.homed_flag and cart.state["adapter"] == 1
    assert np.allclose(cart.io.setpoint, here, atol=0.05)


def test_an_instrument_put_on_ends_the_turning_of_the_adapter() -> None:
    cart = Cart().homed()
    cart.put_on("adapter")
    cart.run(1.0)
    cart.put_on("tool")
    cart.run(0.1)
    assert cart.arm.state == "HOMED" and cart.state["adapter"] == 4


def test_adapter_and_instrument_found_at_start_are_not_turned() -> None:
    cart = Cart(tool_detection="FIXED", tool=TOOL)
    cart.put_on("adapter", "tool")
    cart.reach("HOMED")
    cart.run(0.6)
    assert cart.state["count"] == 6 and cart.state["has_jaw"] and cart.homed_flag and not cart.told
    assert cart.state["adapter"] == cart.state["instrument"] == 4


def test_nobody_sees_an_arm_homed_without_the_joints_of_what_it_carries() -> None:
    cart = Cart(tool_detection="FIXED", tool=TOOL)
    cart.put_on("adapter", "tool")
    cart.run(0.6)
    cart.state_command("enable")
    cart.until(lambda: cart.arm.state == "ENABLED")
    cart.state_command("home")
    cart.until(lambda: cart.homed_flag)
    assert cart.state["count"] == 6 and cart.state["cartesian_valid"]
    states = [e[2:] for e in cart.reports.of("operating_state")]
    assert ("HOMED", False, False) not in states, "homed is told once, and at once altogether"


def with_adapter(**changes: Any) -> Cart:
    cart = Cart(**changes)
    cart.put_on("adapter")
    return cart.homed()


def test_manual_detection_asks_once_and_takes_the_answer() -> None:
    cart = with_adapter()
    assert "nobody asks" in cart.send("set_tool_type", (), DRIVER).replies[0][1]
    cart.reports.events.clear()
    cart.retracted().put_on("tool")
    cart.run(0.5)
    assert cart.types == [("tool_type_request", "")] and len(cart.reports.of("warning")) == 1
    assert cart.arm.state == "HOMED" and not cart.homed_flag and cart.state["count"] == 7
    assert "there are" in cart.send("set_tool_type", (), "SPOON:1").replies[0][1]
    assert cart.send("set_tool_type", (), DRIVER).outcomes == ["done"]
    assert cart.types[-1] == ("tool_type", DRIVER)
    assert cart.arm.state == "ENGAGING_TOOL" and cart.state.text("tool") == TOOL.name
    assert "nobody asks" in cart.send("set_tool_type", (), DRIVER).replies[0][1]


def test_instrument_is_engaged_from_its_lower_to_its_upper_ends() -> None:
    cart = with_adapter().retracted()
    cart.put_on("tool")
    cart.reports.events.clear()
    before = cart.io.setpoint[:3].copy()
    cart.send("set_tool_type", (), DRIVER)
    to_joint = np.array(TOOL.actuator_to_joint)
    seen = []
    while cart.arm.state == "ENGAGING_TOOL":
        cart.step()
        if cart.told:  # not on the way to where it begins
            seen.append(to_joint @ cart.io.setpoint[3:])
    assert np.array(seen).min(axis=0) == pytest.approx(TOOL.engage_lower, abs=1e-6)
    assert np.array(seen).max(axis=0) == pytest.approx(TOOL.engage_upper, abs=1e-6)
    assert np.allclose(cart.io.setpoint, (*before, 0, 0, 0, 0), atol=1e-5)
    assert cart.told == [f"engaging tool {k} of 3" for k in (1, 2, 3)]
    cart.run(0.1)
    assert cart.state["count"] == 6 and cart.state["cartesian_valid"] and cart.homed_flag
    assert cart.state["jaw_position"] == pytest.approx(0.0, abs=1e-6)
    assert cart.nothing_jumped() and not cart.reports.of("goal_reached", "error")
    assert [e[4] for e in cart.reports.of("operating_state")] == [True, False]


def test_instrument_put_on_beyond_the_cannula_is_not_turned_there() -> None:
    cart = with_adapter()
    before = cart.io.setpoint.copy()
    assert before[2] > 0.04
    cart.put_on("tool")
    cart.send("set_tool_type", (), DRIVER)
    cart.run(0.1)
    assert cart.arm.state == "HOMED" and cart.homed_flag and cart.state["count"] == 6
    assert any("outside the cannula" in e[1] for e in cart.reports.of("status"))
    assert np.allclose(cart.io.setpoint, before, atol=1e-12) and not cart.told


@pytest.mark.parametrize(("depth", "insertion", "turned"),
                         ((0.0, 0.0305, True), (0.0, 0.0325, False), (0.05, 0.05, True), (0.01, 0.0305, False)))
def test_the_depth_of_the_cannula_decides(depth: float, insertion: float, turned: bool) -> None:
    cart = with_adapter(cannula_depth=depth)
    move = cart.send("move_jp", (0.0, 0.0, insertion, 0.0, 0.0, 0.0, 0.0))
    cart.until(lambda: "done" in move.outcomes)
    cart.put_on("tool")
    cart.send("set_tool_type", (), DRIVER)
    assert (cart.arm.state == "ENGAGING_TOOL") is turned


@pytest.mark.parametrize("when", ("asked", "engaging", "engaged", "moving", "effort"))
def test_instrument_taken_off_leaves_bare_discs_where_they_are(when: str) -> None:
    cart = with_adapter()
    if when == "engaging":
        cart.retracted()
    cart.put_on("tool")
    move = None
    if when != "asked":
        cart.send("set_tool_type", (), DRIVER)
        cart.run(0.5)
    if when == "moving":
        move = cart.send("move_jp", (0.5, 0.3, 0.2, 0.5, 0.5, 0.5))
        cart.run(0.3)
    if when == "effort":
        cart.send("free")
        cart.run(0.1)
    cart.reports.events.clear()
    before = cart.io.setpoint.copy()
    cart.take_off("tool")
    cart.run(0.2)
    assert cart.arm.state == "HOMED" and cart.homed_flag and cart.state["count"] == 7
    assert not cart.state["cartesian_valid"] and not cart.state["has_jaw"] and cart.state.text("tool") == ""
    assert cart.types == [("tool_type", "")] and cart.nothing_jumped()
    assert np.allclose(cart.io.setpoint, before, atol=0.03 if when == "engaging" else 0.002)
    assert move is None or move.outcomes == ["accepted", "failed"]
    assert cart.setpoint["mode"] == 1 and not cart.setpoint["in_effort"].any()


def test_the_memory_of_an_instrument_says_which_it_is() -> None:
    cart = with_adapter(tool_detection="AUTOMATIC")
    cart.io.memory = f"{DRIVER}[3]"
    cart.put_on("tool")
    assert ("trigger_read", ()) in cart.io.sent and cart.state["count"] == 7
    cart.run(0.2)
    assert cart.types == [("tool_type", DRIVER)] and cart.state["count"] == 6 and cart.homed_flag
    cart.take_off("tool")
    cart.io.memory = "MEGA_NEEDLE_DRIVER:400194[1]"
    cart.put_on("tool")
    cart.run(0.2)
    assert [t for _, t in cart.types] == [DRIVER, "", "MEGA_NEEDLE_DRIVER:400194"]
    assert cart.state.text("tool") == OTHER.name


@pytest.mark.parametrize("memory", ("", "SPOON:1[1]", "not a name"))
def test_what_the_memory_does_not_tell_a_person_is_asked_for(memory: str) -> None:
    cart = with_adapter(tool_detection="AUTOMATIC")
    cart.io.memory = memory
    cart.put_on("tool")
    cart.run(0.3)
    assert cart.types == [("tool_type", "ERROR"), ("tool_type_request", "")]
    assert len(cart.reports.of("error")) == 1 and cart.arm.state == "HOMED"
    assert cart.send("set_tool_type", (), DRIVER).outcomes == ["done"]
    cart.run(0.1)
    assert cart.state["count"] == 6


def test_a_reading_that_somebody_else_asked_for_counts_as_well() -> None:
    cart = with_adapter(tool_detection="AUTOMATIC")
    cart.put_on("tool")
    cart.run(0.3)
    cart.io.memory = f"{DRIVER}[3]"
    cart.io._do("trigger_read", ())
    cart.run(0.3)
    assert cart.state["count"] == 6


def test_a_reader_that_is_busy_is_asked_again() -> None:
    cart = with_adapter(tool_detection="AUTOMATIC")
    cart.io.memory, cart.io.refuses["trigger_read"] = f"{DRIVER}[3]", "its board is reading for another"
    cart.put_on("tool")
    cart.run(1.0)
    assert cart.state["count"] == 7 and not cart.reports.of("error")
    cart.io.refuses.clear()
    cart.run(1.0)
    assert cart.state["count"] == 6


def test_an_io_that_never_reads_is_told() -> None:
    cart = with_adapter(tool_detection="AUTOMATIC")
    cart.io.loses["trigger_read"] = 9
    cart.put_on("tool")
    cart.run(6.2)
    assert cart.types == [("tool_type", "ERROR"), ("tool_type_request", "")]


def test_a_version_has_to_be_said_where_there_are_several() -> None:
    old = dataclasses.replace(TOOL, name="LARGE_NEEDLE_DRIVER_420006", model="420006", version_max=11)
    new = dataclasses.replace(old, name="LARGE_NEEDLE_DRIVER_GEARED_420006", version_min=12, version_max=None)
    cart = with_adapter(tools=(old, new))
    cart.put_on("tool")
    assert "say which" in cart.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:420006").replies[0][1]
    cart.send("set_tool_type", (), "LARGE_NEEDLE_DRIVER:420006[14]")
    cart.run(0.1)
    assert cart.state.text("tool") == new.name


def test_emulated_parts_act_as_their_switches() -> None:
    cart = Cart().homed()
    cart.send("emulate_adapter_present", (1.0,))
    cart.run(0.02)
    assert cart.arm.state == "ENGAGING_ADAPTER"
    cart.send("emulate_tool_present", (1.0,))
    cart.run(0.1)
    assert cart.arm.state == "HOMED" and cart.types == [("tool_type_request", "")]
    cart.send("emulate_tool_present", (0.0,))
    cart.run(0.1)
    assert cart.types[-1] == ("tool_type", "") and cart.state["instrument"] == 1
    assert cart.send("emulate_tool_present", (2.0,)).outcomes == ["refused"]


def test_unhome_and_disable_leave_what_is_engaged_engaged() -> None:
    cart = with_adapter().retracted()
    cart.put_on("tool")
    cart.send("set_tool_type", (), DRIVER)
    cart.until(lambda: cart.homed_flag)
    for word in ("unhome", "disable"):
        cart.state_command(word)
        cart.run(0.1)
        assert not cart.homed_flag
        cart.reports.events.clear()
        cart.reach("HOMED") if word == "disable" else cart.state_command("home")
        cart.until(lambda: cart.homed_flag)
        assert cart.state["count"] == 6 and not cart.told


def test_an_instrument_beyond_its_limits_does_not_jump_at_the_next_command() -> None:
    cart = with_adapter()
    jaw_open = np.linalg.inv(np.array(TOOL.actuator_to_joint)) @ (0.0, 0.0, 0.0, -0.9)
    move = cart.send("move_jp", (0.0, 0.0, 0.12, *jaw_open))
    cart.until(lambda: "done" in move.outcomes)
    cart.put_on("tool")
    cart.send("set_tool_type", (), DRIVER)
    cart.run(0.1)
    assert cart.state["jaw_position"] == pytest.approx(-0.9)
    cart.largest[...] = 0.0
    assert cart.send("servo_jp", cart.state["setpoint_position"][:6].copy()).replies == [("done", "")]
    cart.run(0.1)
    assert cart.largest.max() < 1e-9
    assert cart.send("jaw/servo_jp", (-1.5,)).replies == [("done", "clipped: jaw")]
    cart.run(0.1)
    assert cart.largest.max() < 1e-9
    jaw = cart.send("jaw/move_jp", (0.0,))
    cart.until(lambda: "done" in jaw.outcomes)


def test_fixed_instrument_without_a_switch_is_always_on() -> None:
    rig = Rig(fixed_arm()).homed()
    assert rig.state["instrument"] == 4 and rig.state["adapter"] == 1 and rig.state["is_homed"]
    assert "FIXED" in rig.send("set_tool_type", (), DRIVER).replies[0][1]


def test_a_hand_moves_the_arm_and_not_the_instrument() -> None:
    cart = with_adapter()
    cart.put_on("tool")
    cart.send("set_tool_type", (), DRIVER)
    cart.run(0.1)
    cart.press("PSM1_arm_clutch")
    cart.run(0.1)
    assert cart.arm.state == "MANUAL" and cart.setpoint["in_effort"][:7].tolist() == [True] * 3 + [False] * 4
    cart.io.position[:3] += (0.1, 0.0, 0.02)
    cart.run(0.1)
    cart.press("PSM1_tool", False)
    cart.run(0.1)
    assert cart.arm.state == "MANUAL" and cart.setpoint["in_effort"][:3].all() and cart.state["count"] == 7
    here = cart.io.position.copy()
    cart.press("PSM1_arm_clutch", False)
    cart.run(0.1)
    assert cart.arm.state == "HOMED" and np.allclose(cart.io.setpoint, here, atol=1e-9)
    assert [e[1] for e in cart.reports.of("arm_clutch")] == ["pressed", "released"]


def restart(cart: Cart, away_s: float = 0.3) -> None:
    """kill -9; io holds for a while; a new process begins on the records as they are."""
    for _ in range(round(away_s * 1e9 / PERIOD_NS)):
        cart.now_ns += PERIOD_NS
        cart.setpoint.set("mode", 0)
        cart.setpoint["in_effort"][...] = False
        cart.io.cycle(cart.now_ns, cart.setpoint)
    cart.start_arm()
    cart.largest[...] = 0.0


@pytest.mark.parametrize("what", ("adapter", "tool"))
def test_successor_begins_the_engaging_anew_without_a_jump(what: str) -> None:
    cart = Cart().homed() if what == "adapter" else with_adapter().retracted()
    cart.put_on(what)
    if what == "tool":
        cart.send("set_tool_type", (), DRIVER)
    cart.run(2.5)
    state = cart.arm.state
    assert state == f"ENGAGING_{what.upper()}"
    restart(cart)
    cart.until(lambda: cart.arm.state == state, 0.1)
    cart.until(lambda: cart.homed_flag)
    assert cart.told[-1].startswith(f"engaging {what}") and cart.nothing_jumped()
    assert cart.state["count"] == (7 if what == "adapter" else 6) and not cart.reports.of("error")
    assert not cart.reports.of("tool_type_request"), "the type is known already"


@pytest.mark.parametrize("doing", ("nothing", "effort", "clutched"))
def test_successor_keeps_what_is_engaged(doing: str) -> None:
    cart = with_adapter().retracted()
    cart.put_on("tool")
    cart.send("set_tool_type", (), DRIVER)
    cart.until(lambda: cart.homed_flag)
    if doing == "effort":
        cart.send("servo_jf", (0.0, 0.0, 0.1, 0.0, 0.0, 0.0))
    if doing == "clutched":
        cart.press("PSM1_arm_clutch")
    cart.run(0.1)
    held = cart.io.position.copy()
    restart(cart)
    cart.run(0.2)
    assert cart.arm.state == ("MANUAL" if doing == "clutched" else "HOMED")
    assert cart.state["count"] == 6 and cart.state["instrument"] == 4 and not cart.told
    assert np.allclose(cart.io.position, held, atol=1e-12) and cart.largest.max() < 1e-12
    assert cart.types == [] and cart.state.text("tool") == TOOL.name
    if doing == "clutched":
        cart.press("PSM1_arm_clutch", False)
        cart.run(0.1)
    assert cart.homed_flag


def test_what_was_taken_off_or_put_on_meanwhile_is_noticed() -> None:
    cart = with_adapter().retracted()
    cart.put_on("tool")
    cart.send("set_tool_type", (), DRIVER)
    cart.until(lambda: cart.homed_flag)
    cart.press("PSM1_tool", False)
    restart(cart)
    cart.run(0.1)
    assert cart.state["count"] == 7 and cart.types == [("tool_type", "")] and cart.homed_flag
    cart.press("PSM1_tool")
    restart(cart)
    cart.run(0.1)
    assert cart.types == [("tool_type_request", "")]
    cart.send("set_tool_type", (), DRIVER)
    assert cart.arm.state == "ENGAGING_TOOL", "it was put on while the arm was homed"
    assert cart.largest.max() < 1e-9


def test_emulated_parts_survive_as_well() -> None:
    cart = Cart().homed()
    cart.send("emulate_adapter_present", (1.0,))
    cart.until(lambda: cart.state["adapter"] == 4)
    restart(cart)
    cart.run(0.1)
    assert cart.arm.state == "HOMED" and cart.state["adapter"] == 4
    cart.send("emulate_adapter_present", (0.0,))
    cart.run(0.1)
    assert cart.state["adapter"] == 1


def test_an_arm_that_waits_for_a_type_stays_homed_in_its_successor() -> None:
    cart = with_adapter()
    cart.put_on("tool")
    cart.run(0.1)
    restart(cart)
    cart.run(0.1)
    assert cart.arm.state == "HOMED" and cart.types == [("tool_type_request", "")]


def test_a_move_ends_when_something_is_to_be_engaged() -> None:
    cart = Cart().homed()
    move = cart.send("move_jp", (1.0, 0.5, 0.2, 0.0, 0.0, 0.0, 0.0))
    cart.run(0.3)
    cart.put_on("adapter")
    assert move.outcomes == ["accepted", "failed"] and "being engaged" in move.replies[-1][1]
    cart.until(lambda: cart.homed_flag)
    assert cart.io.setpoint[2:] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("word", ("pause", "disable"))
def test_engaging_is_begun_again_after_an_interruption(word: str) -> None:
    cart = Cart().homed()
    cart.put_on("adapter")
    cart.run(2.0)
    cart.state_command(word)
    held = cart.io.setpoint.copy()
    cart.run(0.3)
    assert cart.arm.state == ("PAUSED" if word == "pause" else "DISABLED")
    assert word == "disable" or np.allclose(cart.io.setpoint, held, atol=0.04)
    if word == "pause":
        cart.state_command("resume")
    else:
        cart.reach("ENGAGING_ADAPTER")
    cart.until(lambda: cart.state["adapter"] == 4)
    cart.run(0.1)
    assert cart.homed_flag and not cart.reports.of("error")


def test_an_instrument_without_an_adapter_is_told_and_not_turned() -> None:
    cart = Cart(tool_detection="FIXED", tool=TOOL).homed()
    cart.put_on("tool")
    cart.run(1.0)
    assert cart.arm.state == "HOMED" and cart.state["count"] == 7 and not cart.homed_flag
    assert [e[1] for e in cart.reports.of("warning")] == ["adapter"]
