"""Files that are new, or partly: what is new stays as it is, and no file is worse afterwards than it was."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest

from tests import stock
from tests.old import config, three
from trocar.procs.config import check_file
from trocar.procs.config.read.jsontext import parse_json
from trocar.procs.config.read.problem import count
from trocar.tools.converters import convert_file, to_json
from trocar.tools.converters.recognise import OTHER, TODAY, UNKNOWN
from trocar.tools.converters.report import DROPPED

ARM = {"name": "PSM1", "type": "PSM", "simulation": "KINEMATIC", "arm_file": "arm/PSM.json", "base_frame": {
    "reference_frame": "x", "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}
TELEOP = {"MTM": "MTMR", "PSM": "PSM1", "configure_parameter": {"scale": 0.3, "align_MTM": False}}


def converted(name: str, data: dict[str, Any]) -> dict[str, Any]:
    """The first new file of a JSON one."""
    result = convert_file(name, json.dumps(data).encode())
    assert result.problems == ()
    return dict(result.outputs[0].data)


def new_files() -> list[Path]:
    folders = (stock.find("dvrk-share"), stock.find("dvrk-site"))
    return sorted(path for folder in folders for path in folder.rglob("*.json") if path.parent.name != "tool")


def test_a_new_file_stays_as_it_is() -> None:
    for path in new_files():
        result = convert_file(str(path), path.read_bytes())
        if not path.name.startswith("console-"):
            assert (result.kind, result.outputs, result.changes) == (TODAY, (), ()), path


def test_new_keys_of_a_half_new_console_file_stay() -> None:
    extras = {"settings": {"audio_volume": 0.2}, "trocar": {"boards": "emulated"},
              "component_manager": {"components": []}, "ISI_focus_controller": {"IO": "IO1", "IO_file": "focus.json"}}
    made = converted("console-a.json", {"arms": [ARM], "teleop_PSMs": [TELEOP], "input_type": "SIMULATED",
                                        "chatty": True, **extras})
    assert made["arms"] == [ARM]
    assert made["consoles"] == [{"name": "console", "input_type": "SIMULATED", "teleop_PSMs": [TELEOP]}]
    assert made["settings"] == {"chatty": True, "audio_volume": 0.2}
    assert all(made[key] == extras[key] for key in extras if key != "settings")


@pytest.mark.parametrize(("endoscope", "new"), [
    *((name, name) for name in ("Custom_STRAIGHT", "Custom_UP", "NONE", "Si_HD_UP")),
    ("HD_UP", "Si_HD_UP"), ("HD_SIDEWAYS", "HD_SIDEWAYS")])
def test_an_endoscope_gets_its_present_name(endoscope: str, new: str) -> None:
    made = converted("ECM-1.json", {"kinematic": "kinematic/ecm-si.json", "endoscope": endoscope})
    assert made["endoscope"] == new


def test_of_a_key_in_both_spellings_the_new_one_counts_and_the_other_is_reported() -> None:
    for keys in (["tool_detection", "tool-detection"], ["tool-detection", "tool_detection"]):
        data = {"kinematic": "kinematic/PSM.json", **{key: "FIXED" if "_" in key else "MANUAL" for key in keys}}
        result = convert_file("PSM1-1.json", json.dumps(data).encode())
        assert result.outputs[0].data["tool_detection"] == "FIXED"
        assert [change.key for change in result.changes if change.outcome == DROPPED] == ["tool-detection"]
    setup = {"arms": [{"name": "ECM", "measured-cp": 1, "measured_cp": 2}]}
    result = convert_file("suj.json", json.dumps(setup).encode())
    assert result.outputs[0].data == {"arms": [{"name": "ECM", "measured_cp": 2}]}
    assert [change.key for change in result.changes if change.outcome == DROPPED] == ["arms[0].measured-cp"]


def test_one_bad_matrix_does_not_lose_a_file(tmp_path: Path) -> None:
    rows = "".join(f'<Row Val="{text}"/>' for text in ("1 0 x", "0 1 0", "0 0 1"))
    inside = (f'<Potentiometers Position="Joints"/><Coupling Value="1"><ActuatorToJointPosition>{rows}'
              "</ActuatorToJointPosition></Coupling>")
    result = convert_file("io.xml", config(three(inside=inside)))
    assert result.problems == () and len(result.lost) == 1 and len(result.outputs[0].data["robots"]) == 1  # type: ignore[arg-type]
    file = tmp_path / "io.json"
    file.write_text(to_json(result.outputs[0].data))
    keys = [problem.key for problem in check_file(file).problems if problem.severity == "error"]
    assert "robots[0].potentiometers.coupling.JointToActuatorPosition" in keys, "the coupling must not be left out"


def half_new(data: Any, chance: random.Random) -> Any:
    """Some keys in their old spelling, the head sometimes away."""
    if isinstance(data, list):
        return [half_new(item, chance) for item in data]
    if not isinstance(data, dict):
        return data
    return {key.replace("_", "-") if chance.random() < 0.3 else key: half_new(item, chance)
            for key, item in data.items() if not key.startswith("$") or chance.random() < 0.5}


@pytest.mark.slow
def test_no_file_is_worse_after_the_conversion(tmp_path: Path) -> None:
    chance, share = random.Random(1), stock.find("dvrk-share")
    for path in new_files():
        data = parse_json(path.read_text()).data
        if not isinstance(data, dict) or set(data).isdisjoint(("arms", "kinematic")):
            continue
        half, head = half_new(data, chance), {key: data[key] for key in data if key.startswith("$")}
        old = tmp_path / path.name
        result = convert_file(str(old), json.dumps(half).encode())
        old.write_text(json.dumps({**head, **half}))  # without its format, one error would hide all others
        if result.kind in (TODAY, OTHER, UNKNOWN) or result.problems:
            continue
        before = count(check_file(old, search=[share, path.parent]).problems)
        new = tmp_path / "new.json"
        new.write_text(to_json(result.outputs[0].data))
        found = check_file(new, search=[share, path.parent]).problems
        assert count(found) <= before, (path, [str(problem) for problem in found])
