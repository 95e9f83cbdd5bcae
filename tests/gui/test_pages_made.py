"""What the pages of a system are made of, without a browser."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from nicegui.client import Client
from nicegui.element import Element
from nicegui.page import page as nicegui_page

from tests.system.robot import ROOT
from tests.system.test_two_consoles import dual
from trocar.procs.config import load_system
from trocar.procs.document.system import DigitalOutput, IoConfig, SystemConfig
from trocar.procs.gui.pages.application import pages_of_system
from trocar.procs.gui.pages.buttons import _outputs
from trocar.procs.gui.pages.frame import page, pages_of
from trocar.procs.gui.pages.system import system_page
from trocar.procs.gui.validity import flags_of

SYSTEMS = ROOT / "configs" / "systems"
MOVING = ('"home"', '"enable"', '"resume"', '"power_on"',
          '"align_MTM"', '"set_align_MTM", [1]', '"lock_rotation", [0]', '"select_teleop"',
          '"teleop_enable", [1]', '"emulate_operator_present", [1]', '"emulate_camera", [0]', '"emulate_clutch", [0]')
"""In the commands of buttons: power goes on, or something may move, by them."""


def system(which: str, folder: Path) -> SystemConfig:
    loaded = load_system(dual(folder) if which == "two consoles" else SYSTEMS / which, boards="emulated")
    assert loaded.system is not None, loaded.errors
    return loaded.system


def flags(part: Element) -> set[str]:
    """What has to be true for it to be shown: by `data-valid` of the nearest that has one, or hidden without."""
    found, nearest, around = set(), "", part
    while True:
        nearest = nearest or str(around.props.get("data-valid", ""))
        found.add(str(around.props.get("data-show", "")))
        if around.parent_slot is None:
            return found | {nearest}
        around = around.parent_slot.parent


@pytest.mark.parametrize("which", ["two consoles", "kinematic-full.yaml", "demo-ecm-si.yaml"])
@pytest.mark.slow
def test_pages_have_keys_and_unique_names_ask_before_motion_and_show_each_number_while_its_flag_is_true(
        which: str, tmp_path: Path) -> None:
    document = system(which, tmp_path)
    known = {f"{row.name}/state": flags_of(row.kind, "state") for row in document.processes if row.kind != "io"}
    made, seen = pages_of_system(document), 0
    assert {path for _, path in pages_of(document)} <= {path for path, _, _ in made}
    for path, wants, content in made:
        with Client(nicegui_page(path), request=None) as client, page(document, path, wants):
            content()
        parts = list(client.elements.values())
        flagged = {name: flags(part) for part in parts if (name := number_of(part, known))}
        client.delete()
        names = Counter(str(part.props["id"]) for part in parts if "id" in part.props)
        labels = {str(part.props["for"]) for part in parts if "for" in part.props}
        buttons = [part for part in parts if any(word in str(part.props.get("data-steps", "")) for word in MOVING)]
        outputs = [part for part in parts if '"set_output"' in str(part.props.get("data-steps-on", ""))]
        assert all(part.props["data-confirm-on"] and part.props["data-confirm-off"] for part in outputs), path
        asked = [str(part.props.get("data-confirm")) for part in buttons]
        assert all("?" in text for text in asked), f"{path}: what powers or moves something asks first"
        assert {"power-off", "power-on", "home"} <= set(names), f"{path}: keys press buttons"
        assert max(names.values()) == 1, (path, names.most_common(3))
        assert labels <= set(names), path
        assert not [(path, name) for name, found in flagged.items() if not set(name[1:]) & found]
        seen += len(flagged)
    assert seen > 50


def number_of(part: Element, known: dict[str, dict[str, str]]) -> tuple[str, ...]:
    """A number that has a flag: which, and the flag, that of its axis too; else empty."""
    source, *rest = str(part.props.get("data-live", part.props.get("data-now", ""))).split(".")
    flag = known.get(source, {}).get(rest[0] if rest else "")
    if flag is None or part.props.get("data-format") == "text":
        return ()
    axis = rest[1] if len(rest) > 1 else ""
    return f"{part.id} {source}.{'.'.join(rest)}", f"{source}.{flag}", f"{source}.{flag}.{axis}"


def shown(document: SystemConfig, path: str) -> set[str]:
    """What values a page shows: their paths, and how."""
    wants, content = next((wants, content) for made, wants, content in pages_of_system(document) if made == path)
    with Client(nicegui_page(path), request=None) as client, page(document, path, wants):
        content()
    found = {f"{part.props['data-live']} {part.props.get('data-format', '')}" for part in client.elements.values()
             if "data-live" in part.props}
    client.delete()
    return found


def test_poses_are_shown_with_their_orientation_those_of_an_ecm_teleoperation_too(tmp_path: Path) -> None:
    document = system("kinematic-full.yaml", tmp_path)
    on_teleop, on_arm = shown(document, "/teleop"), shown(document, "/arm/PSM1")
    for pose in ("MTMR_PSM1/state.mtm_measured_cp", "MTMR_PSM1/state.psm_setpoint_cp", "MTMR_PSM1/state.goal_cp",
                 "MTML/state.measured_cp", "MTMR/state.measured_cp", "ECM/state.setpoint_cp"):
        assert {f"{pose}.0 mm:1", f"{pose} turn:0", f"{pose} turn:2"} <= on_teleop
    for field in ("measured_cp", "setpoint_cp", "local_measured_cp", "local_setpoint_cp"):
        assert {f"PSM1/state.{field}.2 mm:2", f"PSM1/state.{field} turn:1"} <= on_arm


def test_first_steps_are_done_when_all_arms_are(tmp_path: Path) -> None:
    document = system("kinematic-full.yaml", tmp_path)
    with Client(nicegui_page("/"), request=None) as client, page(document, "/"):
        system_page(document)
    marks = {str(part.props["data-on"]) for part in client.elements.values() if part.tag == "i"}
    client.delete()
    names = ("MTML", "MTMR", "PSM1", "PSM2", "PSM3", "ECM", "SUJ")
    assert {f"{name}/state.{what}" for name in names for what in ("state=ENABLED", "is_homed")} <= marks


@pytest.mark.parametrize(("calibrates", "shown"), [(False, {"light"}), (True, {"light", "disable_PWM"})])
def test_outputs_that_io_sets_by_itself_have_no_switch_but_for_calibration(calibrates: bool, shown: set[str]) -> None:
    io = IoConfig("IO1", "", "", 0.001, 0.03, False, (), (), (), calibration_mode=calibrates, digital_outputs=(
        DigitalOutput("light", 0, 1), DigitalOutput("disable_PWM", 0, 2, set_by="lift", robot="SUJ")))
    with Client(nicegui_page("/"), request=None) as client:
        _outputs(io)
        steps = " ".join(str(part.props.get("data-steps-on", "")) for part in client.elements.values())
    client.delete()
    assert {name for name in ("light", "disable_PWM") if f'"{name}"' in steps} == shown
