"""What the pages of a system are made of, without a browser."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.system.robot import ROOT
from tests.system.test_two_consoles import dual
from trocar.procs.config import load_system
from trocar.procs.document.system import DigitalOutput, IoConfig, SystemConfig
from trocar.procs.gui.pages.application import name_of, pages_of_system, texts_of_pages
from trocar.procs.gui.pages.assets import STATIC
from trocar.procs.gui.pages.buttons import _outputs
from trocar.procs.gui.pages.element import VOID, Part
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


def flags(part: Part) -> set[str]:
    """What has to be true for it to be shown: by `data-valid` of the nearest that has one, or hidden without."""
    found, nearest, around = set(), "", part
    while True:
        nearest = nearest or str(around.props.get("data-valid", ""))
        found.add(str(around.props.get("data-show", "")))
        if around.parent is None:
            return found | {nearest}
        around = around.parent


@pytest.mark.parametrize("which", ["two consoles", "kinematic-full.yaml", "demo-ecm-si.yaml"])
@pytest.mark.slow
def test_pages_have_keys_and_unique_names_ask_before_motion_and_show_each_number_while_its_flag_is_true(
        which: str, tmp_path: Path) -> None:
    document = system(which, tmp_path)
    known = {f"{row.name}/state": flags_of(row.kind, "state") for row in document.processes if row.kind != "io"}
    made, seen = pages_of_system(document), 0
    assert {path for _, path in pages_of(document)} <= {path for path, _, _ in made}
    for path, wants, content in made:
        with page(document, path, wants) as whole:
            content()
        parts = list(whole.all())
        flagged = {name: flags(part) for part in parts if (name := number_of(part, known))}
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


def number_of(part: Part, known: dict[str, dict[str, str]]) -> tuple[str, ...]:
    """A number that has a flag: which, and the flag, that of its axis too; else empty."""
    source, *rest = str(part.props.get("data-live", part.props.get("data-now", ""))).split(".")
    flag = known.get(source, {}).get(rest[0] if rest else "")
    if flag is None or part.props.get("data-format") == "text":
        return ()
    axis = rest[1] if len(rest) > 1 else ""
    return f"{id(part)} {source}.{'.'.join(rest)}", f"{source}.{flag}", f"{source}.{flag}.{axis}"


def shown(document: SystemConfig, path: str) -> set[str]:
    """What values a page shows: their paths, and how."""
    wants, content = next((wants, content) for made, wants, content in pages_of_system(document) if made == path)
    with page(document, path, wants) as whole:
        content()
    return {f"{part.props['data-live']} {part.props.get('data-format', '')}" for part in whole.all()
            if "data-live" in part.props}


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
    with page(document, "/") as whole:
        system_page(document)
    marks = {str(part.props["data-on"]) for part in whole.all() if part.tag == "i"}
    names = ("MTML", "MTMR", "PSM1", "PSM2", "PSM3", "ECM", "SUJ")
    assert {f"{name}/state.{what}" for name in names for what in ("state=ENABLED", "is_homed")} <= marks


@pytest.mark.parametrize(("calibrates", "shown"), [(False, {"light"}), (True, {"light", "disable_PWM"})])
def test_outputs_that_io_sets_by_itself_have_no_switch_but_for_calibration(calibrates: bool, shown: set[str]) -> None:
    io = IoConfig("IO1", "", "", 0.001, 0.03, False, (), (), (), calibration_mode=calibrates, digital_outputs=(
        DigitalOutput("light", 0, 1), DigitalOutput("disable_PWM", 0, 2, set_by="lift", robot="SUJ")))
    with Part("main") as whole:
        _outputs(io)
    steps = " ".join(str(part.props.get("data-steps-on", "")) for part in whole.all())
    assert {name for name in ("light", "disable_PWM") if f'"{name}"' in steps} == shown


@pytest.mark.parametrize("calibrates", [False, True])
def test_every_page_says_that_the_system_is_in_calibration_mode(calibrates: bool, tmp_path: Path) -> None:
    document = system("demo.yaml", tmp_path)
    document = replace(document, ios=tuple(replace(io, calibration_mode=calibrates) for io in document.ios))
    for _, path in pages_of(document):
        with page(document, path) as whole:
            pass
        assert ("calibration mode" in {part.text for part in whole.all()}) is calibrates


THREE = {
    "LICENSE": "bfe119ea4fd413f5f7ca3fcd63adb0c4a073ed39daa2fe7d3e6b769e21272601",
    "OrbitControls.js": "6c860c6b342200f8aef65493319c12bfb2d652107355b1d25eb2154371128391",
    "STLLoader.js": "cb8613b5152d3424ff9deb42380ec3b84d76f6380d9f0ce9ade2a63b5b11835d",
    "three.core.min.js": "61ba0df005b05991361d040d8ff670e1aadfd0ce7aeebd1fdb0725957a8957de",
    "three.module.min.js": "e2b5ee6bccd38fd6d8a2428546b83c5f2426d84b152ef82be8055556e3b40eb6",
}
"""Of three.js: its files have these checksums (procs/gui/static/three/README.md)."""


def test_three_js_is_the_pinned_version() -> None:
    found = {name: hashlib.sha256((STATIC / "three" / name).read_bytes()).hexdigest() for name in THREE}
    assert found == THREE


class HeardPage(HTMLParser):
    """What a browser reads in a page: tags that are open, attributes, and texts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None], list[str]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs), []))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.found[-1][2].append(data)


def test_pages_are_whole_escaped_and_the_same_for_one_system(tmp_path: Path) -> None:
    document = system("kinematic-full.yaml", tmp_path)
    texts = texts_of_pages(document)
    for path, text in texts.items():
        heard = HeardPage(text.decode())
        assert not heard.open, path
        forbidden = [tag for tag, props, inside in heard.found if (tag == "script" and (inside or "src" not in props))
                     or "style" in props or any(name.startswith("on") for name in props)]
        assert not forbidden, f"{path}: the content security policy forbids it"
        assert [inside for tag, _, inside in heard.found if tag == "title"] and "power-off" in text.decode(), path
    assert name_of(texts) == name_of(texts_of_pages(document))
    evil = """a<b> "c" & 'd' </script><script>"""
    other = texts_of_pages(replace(document, name=evil))
    assert name_of(other) != name_of(texts)
    (bar,) = (row for row in HeardPage(other["/3d"].decode()).found if row[1].get("class") == "system")
    assert bar[2] == [evil]
    with Part("p", "x", title=evil, hidden=True) as part:
        Part("input", value=evil)
    (_, outer, _), (_, inner, _) = HeardPage(part.html()).found
    assert outer["title"] == inner["value"] == evil and outer["hidden"] == ""


def test_pages_of_what_a_system_lacks_are_not_made(tmp_path: Path) -> None:
    made = {path for path, _, _ in pages_of_system(system("kinematic.yaml", tmp_path))}
    assert {"/", "/arm/PSM1", "/plots"} <= made and not {"/focus", "/suj", "/console", "/teleop"} & made


def test_an_arm_has_one_colour_and_a_disabled_teleoperation_its_last_stop(tmp_path: Path) -> None:
    def parts(path: str) -> list[Part]:
        wants, content = next((wants, content) for made, wants, content in pages_of_system(document) if made == path)
        with page(document, path, wants) as whole:
            content()
        return list(whole.all())

    def colour(path: str) -> int:
        (stage,) = (part for part in parts(path) if "data-drawn" in part.props)
        return int(json.loads(stage.props["data-drawn"])["arms"]["PSM2"]["colour"])

    document = system("kinematic-full.yaml", tmp_path)
    assert colour("/3d") == colour("/arm/PSM2") == 1
    for path in ("/", "/teleop", "/console"):
        stops = [part for part in parts(path) if part.text == "Last stop: " and part.parent and part.parent.parent]
        assert stops and all(part.parent.parent.props["data-show"].endswith("state=DISABLED") for part in stops)
