"""What the loops of teleoperations, consoles and setup joints do with their node: take, drain, publish, follow."""

from __future__ import annotations

import dataclasses
from functools import cache
from types import SimpleNamespace
from typing import Any

import pytest

from tests import stock
from tests.arm.fake_requests import FakeRequest
from tests.suj.fake_cart import cart_of
from tests.whole.stub_node import StubNode
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.console import loop as console_loop
from trocar.procs.document.consoles import HidSensor, WiredInput
from trocar.procs.document.system import SystemConfig
from trocar.procs.node import runtime
from trocar.procs.node.inputs import SETUP_LATE_S
from trocar.procs.suj import loop as suj_loop
from trocar.procs.suj.bluetooth import BluetoothBoards
from trocar.procs.suj.classic import Classic
from trocar.procs.suj.si import EmulatedBoards, Si
from trocar.procs.tables.manifest import LATE_S
from trocar.procs.teleop import loop as teleop_loop
from trocar.procs.teleop.ecm import TeleopEcm
from trocar.procs.teleop.psm import TeleopPsm
from trocar.procs.teleop.third_party import ThirdPartyArm
from trocar.shm.mailbox.origins import Origin
from trocar.shm.system.subscriptions import EVERY

MS = 1_000_000


@cache
def system(name: str = "kinematic-full") -> SystemConfig:
    loaded = load_system(PROJECT_CONFIGS / "systems" / f"{name}.yaml")
    assert loaded.system is not None, loaded.errors
    return loaded.system


def update(loop: Any, now_ns: int) -> None:
    loop.node.now_ns = now_ns
    loop.update()


@pytest.mark.parametrize(("module", "kind", "made"), [
    (teleop_loop, "teleop", teleop_loop.TeleopLoop), (console_loop, "console", console_loop.ConsoleLoop),
    (suj_loop, "suj", suj_loop.SetupLoop)])
def test_a_door_runs_the_loop_of_its_kind(module: Any, kind: str, made: type, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[object] = []
    monkeypatch.setattr(runtime, "run", lambda *what: ran.append(what))
    module.main()
    assert ran == [(kind, made)]


# -- teleoperations ----------------------------------------------------------------------------------------------------


def teleoperation(name: str, document: SystemConfig | None = None) -> tuple[teleop_loop.TeleopLoop, StubNode]:
    node = StubNode(document or system(), name)
    loop = teleop_loop.TeleopLoop(node)  # type: ignore[arg-type]
    loop.setup()
    node.log.clear()
    return loop, node


def test_teleoperations_are_made_of_the_arms_of_their_file() -> None:
    psm, _ = teleoperation("MTML_PSM2")
    assert isinstance(psm.teleop, TeleopPsm) and [arm.name for arm in psm.teleop.arms] == ["MTML", "PSM2"]
    assert psm.teleop.settings.psm == "PSM2" and psm.teleop.base is None
    ecm, node = teleoperation("MTML_MTMR_ECM")
    assert isinstance(ecm.teleop, TeleopEcm) and [arm.name for arm in ecm.teleop.arms] == ["MTML", "MTMR", "ECM"]
    assert node.ring("MTML_MTMR_ECM", "state").field("masters").tolist() == [b"MTML", b"MTMR"]
    assert psm.teleop.operator.record is not None and not any(
        isinstance(arm, ThirdPartyArm) for arm in (*psm.teleop.arms, *ecm.teleop.arms))
    lower, upper = psm.teleop._jaw_range("LARGE_NEEDLE_DRIVER:400006") or (0.0, 0.0)
    assert (lower, upper) == pytest.approx((-0.698132, 1.39626)) and psm.teleop._jaw_range("nothing") is None


def test_only_arms_of_third_parties_are_looked_at_twice() -> None:
    document = system("third-party-master")
    (row,) = document.teleop_psms
    loop, _ = teleoperation(row.name, document)
    kinds = {arm.name: isinstance(arm, ThirdPartyArm) for arm in loop.teleop.arms}
    assert kinds == {row.mtm: True, row.psm: False}


def test_what_carries_the_slave_is_an_arm_or_a_setup_arm() -> None:
    document = system()
    row = document.teleop_psms[0]

    def made(**changes: str) -> Any:
        changed = dataclasses.replace(document, teleop_psms=(dataclasses.replace(row, **changes),))
        loop, _ = teleoperation(row.name, changed)
        assert isinstance(loop.teleop, TeleopPsm)
        return loop.teleop.base

    arm, setup = made(base_frame_from="ECM"), made(base_frame_from="SUJ", base_frame_interface="PSM2")
    assert (arm.name, setup.name) == ("ECM", "SUJ/PSM2") and arm.measured.shape == setup.measured.shape == (7,)
    setup.record.ring.field("measured_cp")[2, 0], setup.record.ring.field("base_valid")[2] = 0.5, True
    assert setup.measured[0] == 0.5 and setup.known.tolist() == [True]


def test_a_teleoperation_without_its_console_has_its_operator_there() -> None:
    document = system()
    alone = dataclasses.replace(document, processes=tuple(r for r in document.processes if r.kind != "console"))
    loop, _ = teleoperation("MTMR_PSM1", alone)
    assert loop.teleop.operator.record is None and not loop.teleop.operator.is_silent


def test_a_teleoperation_follows_its_master_in_time_and_tells_how_late_it_is() -> None:
    loop, node = teleoperation("MTMR_PSM1")
    master = node.ring("MTMR", "state")
    node.requests = [FakeRequest("state_command", (), "enable", origin=Origin(1, 1, "test"))]
    request = node.requests[0]
    update(loop, 7 * MS)
    assert request.outcomes == ["done"] and "publish MTMR_PSM1 state 7000000" in node.log
    assert not any(line.startswith(("follow", "latency")) for line in node.log), "there is no record yet"
    master.stamp_ns, node.now_ns = 8 * MS, 8_400_000
    node.log.clear()
    update(loop, node.now_ns)
    assert [line for line in node.log if line.startswith(("follow", "latency"))] == ["follow 8000000 190000"]
    assert node.paced_by == ["MTMR"]
    loop.teleop.following = True
    node.log.clear()
    update(loop, node.now_ns)
    assert "follow 8000000 190000" in node.log and "latency 450000" in node.log
    assert node.voids.valid_from == 9


def test_a_program_sets_no_pace() -> None:
    document = system("third-party-master")
    (row,) = document.teleop_psms
    loop, node = teleoperation(row.name, document)
    node.ring(row.mtm, "state").stamp_ns = 8 * MS
    update(loop, 9 * MS)
    assert not any(line.startswith(("follow", "latency")) for line in node.log) and not node.paced_by


@pytest.mark.parametrize("idle", [True, False])
def test_a_teleoperation_at_rest_looks_around_less_often(idle: bool) -> None:
    loop, node = teleoperation("MTMR_PSM1")
    if not idle:
        loop.teleop.step(1, [FakeRequest("state_command", (), "enable")])
    node.log.clear()
    assert loop.tick() and node.log == (["tick 100 False"] if idle else ["tick 1 -"])


def test_a_teleoperation_that_ends_lets_go_as_if_it_were_disabled() -> None:
    loop, node = teleoperation("MTMR_PSM1")
    loop.teleop.step(1, [FakeRequest("state_command", (), "enable")])
    node.now_ns = 5 * MS
    loop.quit()
    assert loop.teleop.is_idle and loop.teleop.now_ns == 5 * MS


# -- consoles ----------------------------------------------------------------------------------------------------------


def consoles(**changes: Any) -> SystemConfig:
    document = system()
    return dataclasses.replace(document, consoles=(dataclasses.replace(document.consoles[0], **changes),))


def test_a_console_takes_its_scale_from_its_first_instrument() -> None:
    document = system()
    scaled = dataclasses.replace(document, teleop_psms=tuple(
        dataclasses.replace(row, scale=0.3 + place / 10) for place, row in enumerate(document.teleop_psms)),
        teleop_ecms=tuple(dataclasses.replace(row, scale=0.7) for row in document.teleop_ecms))
    assert console_loop.first_scale(scaled, "console") == 0.3
    only_ecm = dataclasses.replace(scaled, consoles=(dataclasses.replace(
        document.consoles[0], teleops=("MTML_MTMR_ECM",)),))
    assert console_loop.first_scale(only_ecm, "console") == 0.7
    nothing = dataclasses.replace(scaled, consoles=(dataclasses.replace(document.consoles[0], teleops=()),))
    assert console_loop.first_scale(nothing, "console") == 0.2


def test_a_console_obeys_listens_and_publishes_in_each_cycle() -> None:
    node = StubNode(consoles(), "console")
    loop = console_loop.ConsoleLoop(node)  # type: ignore[arg-type]
    loop.setup()
    record = node.ring("console", "state")
    assert record.field("input_type").item() == b"SIMULATED" and record.field("kind")[0] == b"ECM"
    node.log.clear()
    node.requests = [FakeRequest("emulate_operator_present", (1.0,)), FakeRequest("teleop_enable", (1.0,),
                                                                                 origin=Origin(1, 10, "test"))]
    requests = list(node.requests)
    update(loop, 7 * MS)
    assert [request.outcomes for request in requests] == [["done"]] * 2
    assert node.log[-1] == "publish console state 7000000"
    assert record.field("operator_present").item() and record.field("teleop_enabled").item()
    assert any(line == "MTMR_PSM1 < state_command enable ()" for line in node.log)
    node.ring("MTMR_PSM1", "state").epoch += 1
    node.log.clear()
    update(loop, 8 * MS)
    assert any("was restarted" in line for line in node.log)


def test_a_fault_since_takes_the_desired_state_of_a_console_away() -> None:
    node = StubNode(consoles(), "console")
    loop = console_loop.ConsoleLoop(node)  # type: ignore[arg-type]
    loop.setup()
    node.requests = [FakeRequest("teleop_enable", (1.0,), origin=Origin(1, 3, "test"))]
    update(loop, 7 * MS)
    assert node.ring("console", "state").field("teleop_enabled").item()
    update(loop, 8 * MS)
    assert not node.ring("console", "state").field("teleop_enabled").item()
    assert any(line.startswith("teleop-disabled") for line in node.log)


def test_a_console_rests_while_its_teleoperations_are_disabled() -> None:
    node = StubNode(consoles(), "console")
    loop = console_loop.ConsoleLoop(node)  # type: ignore[arg-type]
    loop.setup()
    states = [node.ring(name, "state").field("desired_state") for name in node.document.consoles[0].teleops]
    for desired in states:
        desired[...] = b"DISABLED"
    node.log.clear()
    loop.tick()
    states[0][...] = b"ENABLED"  # by a command that did not come from us
    loop.tick()
    states[0][...] = b"DISABLED"
    loop._logic.wanted = True
    loop.tick()
    assert node.log == ["tick 2 False", "tick 1 False", "tick 1 False"]


def test_a_console_with_pedals_turns_its_head_sensor_on_and_hears_them() -> None:
    document = dataclasses.replace(system("demo-teleop"))
    io = document.ios[0]
    name = io.digital_inputs[0].name
    row = dataclasses.replace(document.consoles[0], input_type="PEDALS_ISI_HEAD_SENSOR",
                              clutch=WiredInput(io.name, name), turn_off=WiredInput(io.name, "head_off"))
    node = StubNode(dataclasses.replace(document, consoles=(row,)), "console")
    loop = console_loop.ConsoleLoop(node)  # type: ignore[arg-type]
    loop.setup()
    assert f"{io.name} < set_output head_off (0.0,)" in node.log
    events, state = node.ring(io.name, "events"), node.ring(io.name, "state")
    node.log.clear()
    loop.tick()
    events.head = 1
    loop.tick()
    assert node.log == ["tick 1 False", "tick 1 True"]
    state.stamp_ns, state.field("input")[0] = 7 * MS, True
    update(loop, 7 * MS)
    assert node.ring("console", "state").field("clutch").item()
    update(loop, 7 * MS + round(LATE_S * 1e9) + 1)
    assert not node.ring("console", "state").field("valid").item()


def test_a_console_gives_its_head_sensor_back() -> None:
    node = StubNode(consoles(head=HidSensor(1, 2, 3)), "console")
    loop = console_loop.ConsoleLoop(node)  # type: ignore[arg-type]
    loop.setup()
    update(loop, 7 * MS)
    assert any(line.startswith("head-sensor console: no head sensor (USB 0001:0002)") for line in node.log), node.log
    assert loop._head in node.held


# -- setup joints ------------------------------------------------------------------------------------------------------


def test_a_classic_cart_publishes_setpoints_and_follows_io() -> None:
    document = load_system(stock.find("dvrk-site/jhu-daVinci/system-SUJ.json"), search=[stock.find("dvrk-share")],
                           boards="emulated").system
    assert document is not None
    node = StubNode(document, "SUJ")
    loop = suj_loop.SetupLoop(node)  # type: ignore[arg-type]
    loop.setup()
    assert isinstance(loop._joints._source, Classic) and not loop._joints._source.has_io
    node.ring("IO1", "state").field("write_ns")[...] = 5 * MS
    node.log.clear()
    node.requests = [FakeRequest("state_command", (), "enable", origin=Origin(4, 1, "test"))]
    update(loop, 7 * MS)
    order = [line for line in node.log if line.startswith(("publish", "follow", "IO1 for", "IO1 < power_on"))]
    assert order == ["IO1 for 4", "IO1 < power_on SUJ ()", "publish SUJ state 7000000", "publish SUJ setpoint 7000000",
                     "follow 5000000 120000"] and node.paced_by == ["IO1"]
    for text in ("busy", "busy", "why"):
        node.clients["IO1"].answers += [SimpleNamespace(outcome="refused", text=text),
                                        SimpleNamespace(outcome="done", text="it is")]
        update(loop, 8 * MS)
    said = [line for line in node.log if line.startswith("io-refused")]
    assert said == ["io-refused SUJ: SUJ: io refuses: busy", "io-refused SUJ: SUJ: io refuses: why"]


def test_a_cart_without_boards_publishes_its_state_alone() -> None:
    node = StubNode(system(), "SUJ")
    loop = suj_loop.SetupLoop(node)  # type: ignore[arg-type]
    loop.setup()
    assert loop._joints._source is None
    update(loop, 7 * MS)
    assert [line for line in node.log if line.startswith(("publish", "follow"))] == ["publish SUJ state 7000000"]
    assert node.late_s == dict.fromkeys(("ECM", "PSM1", "PSM2", "PSM3"), SETUP_LATE_S)


def test_setup_joints_without_boards_rest_until_the_arm_with_the_reference_frame_moves() -> None:
    node = StubNode(system(), "SUJ")
    loop = suj_loop.SetupLoop(node)  # type: ignore[arg-type]
    loop.setup()
    ecm = node.ring("ECM", "state")
    ecm.field("cartesian_valid")[...] = True
    ecm.field("local_measured_cp")[3] = 1.0
    rests = []
    for cycle in range(3, 140):
        ecm.stamp_ns = cycle * MS
        if cycle >= 100:
            ecm.field("local_measured_cp")[0] = 1e-6 * min(cycle, 103)
        update(loop, cycle * MS)
        rests.append(loop.may_rest)
    assert rests == [31 <= k < 97 or k >= 131 for k in range(137)]
    node.log.clear()
    loop.tick()
    node.subscriptions.wanted = EVERY
    loop.tick()
    assert node.log == ["tick 8 False", "tick 1 -"]


def test_only_arms_that_run_have_tips() -> None:
    document = system()
    few = dataclasses.replace(document, processes=tuple(row for row in document.processes if row.name != "PSM2"))
    found = suj_loop.tips(StubNode(few, "SUJ"), few.cart("SUJ"))  # type: ignore[arg-type]
    assert [tip.name if tip else "" for tip in found] == ["ECM", "PSM1", "", "PSM3"]


def test_boards_of_an_si_cart_are_emulated_or_asked_over_bluetooth(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(BluetoothBoards, "__init__", lambda self, addresses: asked.append(tuple(addresses)))
    cart = cart_of("Si")
    assert isinstance(suj_loop.link_of(cart), BluetoothBoards)
    assert asked == [("ff:ff", "aa:00", "aa:01", "aa:02", "aa:03")]
    assert isinstance(suj_loop.link_of(dataclasses.replace(cart, emulated=True)), EmulatedBoards)


@pytest.mark.parametrize(("simulation", "measured"), [("NONE", True), ("KINEMATIC", False)])
def test_an_si_cart_reads_its_boards_unless_it_is_kinematic(simulation: str, measured: bool) -> None:
    cart = dataclasses.replace(cart_of("Si"), simulation=simulation, emulated=True)
    document = dataclasses.replace(system(), carts=(cart,))
    node = StubNode(document, "SUJ")
    loop = suj_loop.SetupLoop(node)  # type: ignore[arg-type]
    loop.setup()
    assert isinstance(loop._joints._source, Si) is measured
    assert [type(part) for part in node.held] == [EmulatedBoards] * measured, "they are closed with the node"
