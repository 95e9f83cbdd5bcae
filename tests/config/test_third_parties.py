"""Generic arms and components: places for third-party program."""

from __future__ import annotations

import pytest

from tests import stock
from tests.config.conftest import Home
from tests.config.test_consoles import ARMS
from trocar.procs.document import system as document
from trocar.procs.document.system import ThirdParty, WiredInput

CLOCK = "clock: wall, because third-party programs do not wait for simulated time: MTMR"
FALCON = {"name": "MTMR", "type": "MTM_GENERIC", "component": "Falcon", "interface": "Arm"}
PSM = next(arm for arm in ARMS if arm["name"] == "PSM1")


def console(teleop: bool = True, **keys: object) -> dict[str, object]:
    given = {"MTM_is_haptic": False, "align_MTM": False}
    teleops = [{"MTM": "MTMR", "PSM": "PSM1", "configure_parameter": given}]
    return {"name": "c", "input_type": "SIMULATED", "teleop_PSMs": teleops if teleop else [], **keys}


def components(**keys: tuple[str, str]) -> dict[str, object]:
    return {"input_type": "COMPONENTS",
            **{button: {"component": component, "interface": name} for button, (component, name) in keys.items()}}


def made(home: Home, *arms: dict[str, object], console: dict[str, object], **keys: object) -> document.SystemConfig:
    loaded = home.load_made({"arms": list(arms), "consoles": [console], **keys})
    assert loaded.system is not None, loaded.errors
    return loaded.system


def test_a_generic_master_has_a_place_and_its_teleop_starts(home: Home) -> None:
    system = made(home, FALCON, PSM, console=console())
    assert system.third_parties == (ThirdParty("MTMR", "MTM_GENERIC"),)
    assert [row.name for row in system.arms] == ["PSM1"]
    assert system.process("MTMR").kind == "third_party" and system.process("MTMR_PSM1").kind == "teleop"
    assert [note for note in system.notes if "MTMR" in note] == [CLOCK]
    assert document.from_json(document.to_json(system)) == system


def test_a_generic_arm_needs_to_name_no_component(home: Home) -> None:
    assert made(home, {"name": "MTMR", "type": "MTM_GENERIC"}, PSM, console=console()).third_party("MTMR").inputs == ()


def test_a_haptic_generic_master_is_noted(home: Home) -> None:
    teleops = [{"MTM": "MTMR", "PSM": "PSM1"}]
    notes = " ".join(made(home, FALCON, PSM, console=console(teleop_PSMs=teleops)).notes)
    assert "unless that carries out move_cp and body/servo_cf, say MTM_is_haptic: false" in notes


def test_buttons_come_from_an_arm_or_from_a_program_of_its_own(home: Home) -> None:
    row = console() | components(clutch=("Falcon", "Button1"), camera=("Falcon", "Button2"),
                                 operator_present=("chair", "seat"))
    system = made(home, FALCON, PSM, console=row)
    assert system.third_parties == (ThirdParty("MTMR", "MTM_GENERIC", ("Button1", "Button2")),
                                    ThirdParty("chair", "", ("seat",)))
    (made_of,) = system.consoles
    assert made_of.clutch == WiredInput("MTMR", "Button1")
    assert made_of.operator_present == (WiredInput("chair", "seat"),)
    assert system.inputs("MTMR") == ("Button1", "Button2") and "chair" in system.process("c").after


def test_buttons_of_an_io_are_its_digital_inputs(home: Home) -> None:
    file = str(stock.find("dvrk-share/io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json"))
    ios = [{"name": "IO1", "port": "udp", "configuration_files": [file]}]
    row = console(teleop=False) | components(clutch=("IO1", "clutch"), camera=("IO1", "camera"),
                                             operator_present=("IO1", "coag"))
    loaded = home.load_made({"IOs": ios, "consoles": [row]}, boards="emulated")
    assert loaded.system is not None, loaded.errors
    assert loaded.system.consoles[0].clutch == WiredInput("IO1", "clutch") and not loaded.system.third_parties
    row["clutch"] = {"component": "IO1", "interface": "kick"}
    (error,) = home.load_made({"IOs": ios, "consoles": [row]}, boards="emulated").errors
    assert error.key == "consoles[0].clutch.interface" and "coag" in error.allowed


def test_a_base_frame_of_a_generic_arm_goes_along(home: Home) -> None:
    transform = [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    arm = FALCON | {"base_frame": {"reference_frame": "HRSV", "transform": transform}}
    third_party = made(home, arm, PSM, console=console()).third_party("MTMR")
    assert third_party.reference_frame == "HRSV" and third_party.base_frame is not None
    assert third_party.base_frame[0][3] == 0.1


@pytest.mark.parametrize(("given", "key", "says"), [
    (("PSM1", "x"), "consoles[0].clutch.component", "used by a component without buttons"),
    (("system", "x"), "consoles[0].clutch.component", "used by a component without buttons"),
    (("MTMR_PSM1", "x"), "consoles[0].clutch.component", "used by a component without buttons"),
    (("my pedals", "x"), "consoles[0].clutch.component", "not a name for a place"),
    (("pedals", "x" * 25), "consoles[0].clutch.interface", "not a name for a button")])
def test_wrong_components_stop_the_start(home: Home, given: tuple[str, str], key: str, says: str) -> None:
    row = console() | components(clutch=given, camera=("Falcon", "b"), operator_present=("Falcon", "c"))
    (error,) = home.load_made({"arms": [FALCON, PSM], "consoles": [row]}).errors
    assert error.key == key and says in error.text and error.line > 1


@pytest.mark.parametrize("clock", ["paced", "lockstep"])
def test_a_program_of_somebody_else_does_not_wait_for_simulated_time(home: Home, clock: str) -> None:
    (error,) = home.load_made({"arms": [FALCON, PSM], "trocar": {"clock": clock}}).errors
    assert error.key == "trocar.clock" and "MTMR" in error.text


def test_a_declared_one_is_a_process_of_the_system(home: Home) -> None:
    (home.path / "mine.py").write_text("")
    row = {"name": "MTMR", "module": "mine.py", "period_s": 0.002, "start": "on-demand"}
    system = made(home, FALCON, PSM, console=console(), trocar={"processes": [row]})
    process = system.process("MTMR")
    assert (process.kind, process.start, process.period_s) == ("third_party", "on-demand", 0.002)
    assert "MTMR" not in system.process("MTMR_PSM1").after, "nobody waits for who waits to be wanted"
    assert made(home, FALCON, PSM, console=console()).process("MTMR").start == "elsewhere"


@pytest.mark.parametrize(("row", "key", "text"), [
    ({"start": "always"}, "start", "it is started outside this system"),
    ({"module": "mine.py", "host": "lab"}, "host", "it is an arm, or has pedals"),
    ({"module": "mine.py", "topics": [{"name": "state", "fields": [{"name": "x"}]}]}, "topics[0].name",
     "this name is taken")])
def test_mistakes_of_its_row_are_told(home: Home, row: dict[str, object], key: str, text: str) -> None:
    (home.path / "mine.py").write_text("")
    loaded = home.load_made({"arms": [FALCON, PSM], "consoles": [console()],
                             "trocar": {"processes": [{"name": "MTMR", **row}]}})
    assert (f"trocar.processes.MTMR.{key}", text) in [(error.key, error.text) for error in loaded.errors]
