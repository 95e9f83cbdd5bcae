"""Files that are none, cannot be read or are of another format: one clear error each."""

from __future__ import annotations

import json
import os

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.config import check_file

IO = "io/PSM1-demo.yaml"
PID = "pid/PSM.yaml"
ARM = "arms/PSM1-demo.yaml"
CHAIN = "kinematic/PSM.yaml"
TOOL = "tool/LARGE_NEEDLE_DRIVER_400006.yaml"
INDEX = "tool/index.yaml"


@pytest.mark.parametrize(("text", "line", "what"), [
    ('{"$id": "dvrk-system.schema.json",\n "$version" "1"}', 2, "a colon must follow"),
    ('{\n "$id": "dvrk-system.schema.json"\n "$version": "1"\n}', 3, "a comma or }"),
    ("[1, 2]", 1, "must be an object")])
def test_broken_json_is_one_clear_error(home: Home, text: str, line: int, what: str) -> None:
    (home.path / "broken.json").write_text(text)
    loaded = home.load("broken.json")
    assert loaded.system is None
    (problem,) = loaded.errors
    assert problem.line == line and what in str(problem)


def test_files_that_cannot_be_read(home: Home) -> None:
    (home.path / "bytes.json").write_bytes(b'{"a": "\xff"}')
    (home.path / "large.json").write_bytes(b" " * 4_000_001)
    os.mkfifo(home.path / "pipe.json")
    for name, what in (("nowhere.json", "No such file"), ("bytes.json", "not UTF-8"), ("systems", "but a folder"),
                       ("pipe.json", "not a regular file but a named pipe"), ("/dev/zero", "but a device"),
                       ("large.json", "too large: 4000001 bytes; allowed: at most 4000000")):
        (problem,) = home.load(name).errors
        assert what in str(problem) and str(home.path / name) in str(problem)


@pytest.mark.parametrize("name", ["pipe.json", "io"])
def test_a_named_file_that_is_none_is_named(home: Home, name: str) -> None:
    os.mkfifo(home.path / "pipe.json")
    home.edit(SYSTEM, "io/PSM1-demo.yaml", name)
    assert any(str(home.path / name) in str(problem) and "not a regular file" in problem.text
               for problem in home.load().errors)


def test_a_link_to_nothing_is_told_as_such(home: Home) -> None:
    link = home.path / "io/link.json"
    link.symlink_to("moved.json")
    home.edit(SYSTEM, "io/PSM1-demo.yaml", "io/link.json")
    (named,) = [problem for problem in home.load().errors if problem.file == str(link)]
    (given,) = check_file(link).problems
    assert "a link to moved.json, which does not exist" in named.text == f"cannot be read: {given.text}"


def test_console_file_of_old_days_is_refused_plainly(home: Home) -> None:
    (home.path / "console.json").write_text('{"arms": [{"name": "PSM1", "arm": "x.json"}]}')
    (problem,) = home.load("console.json").errors
    assert "before dVRK 2.4" in problem.text and "dvrk-system.schema.json" in problem.allowed


def test_repeated_key_in_json_warns(home: Home) -> None:
    system = {
        "$id": "dvrk-system.schema.json",
        "$version": "1",
        "IOs": [{"name": "IO1", "port": "udp"}],
        "arms": [{"name": "PSM1", "type": "PSM", "serial": "demo", "IO": "IO1", "arm_file": ARM, "IO_file": IO}],
    }
    text = json.dumps(system, indent=1).replace('"port": "udp"', '"port": "fw",\n "port": "udp"')
    (home.path / "twice.json").write_text(text)
    loaded = home.load("twice.json")
    assert loaded.system is not None and loaded.system.ios[0].port == "udp"
    (warning,) = loaded.warnings
    assert warning.key == "IOs[0].port" and "occurs twice" in warning.text


def test_missing_file_names_the_nearest(home: Home) -> None:
    home.edit(SYSTEM, "io/PSM1-demo.yaml", "io/PSM1-dmo.yaml")
    problem = home.error()
    assert "did you mean io/PSM1-demo.yaml?" in problem.text and str(home.path) in problem.text


def test_absurd_file_names_are_only_not_found(home: Home) -> None:
    for name in ("x" * 300, "~nobody-of-this-name/x", "a\\0b"):
        home.edit(SYSTEM, "PID_file: pid/PSM.yaml", f'PID_file: "{name}"')
        assert "no file" in home.error().text
        home.edit(SYSTEM, f'PID_file: "{name}"', "PID_file: pid/PSM.yaml")


def test_a_version_written_as_a_number_is_read_like_a_text(home: Home) -> None:
    for file, version in ((SYSTEM, "1"), (ARM, "1"), (PID, "1"), (IO, "6")):
        home.edit(file, f'$version: "{version}"', f"$version: {version}")
    assert home.load().errors == ()


def test_a_file_of_another_format_is_told_so_before_anything_else(home: Home) -> None:
    old = {"kinematic": "kinematic/psm.json", "tool-detection": "FIXED", "re-home": 3}
    (home.path / ARM).with_suffix(".json").write_text(json.dumps(old))
    home.edit(SYSTEM, ARM, ARM.replace(".yaml", ".json"))
    first = home.load().errors[0]
    assert first.key == "$id" and "before dVRK 2.4" in first.text and "trocar convert" in first.allowed
    problems = check_file((home.path / ARM).with_suffix(".json"), configs=home.path).problems
    assert problems[0] == first, "neither warnings nor consequences come before it"
    (home.path / "old.xml").write_text('<?xml version="1.0"?>\n<Config/>')
    home.edit(SYSTEM, IO, str(home.path / "old.xml"))
    xml = [problem for problem in home.load().errors if problem.file.endswith("old.xml")]
    assert [problem.allowed for problem in xml] == [
            f"JSON or YAML; trocar convert {home.path / 'old.xml'} makes one of it"]
