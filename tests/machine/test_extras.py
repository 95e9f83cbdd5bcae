"""Packages of extras: the sentence for a missing one, the table against pyproject.toml, and a robot without any."""

from __future__ import annotations

import platform
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

from tests.cases import cases
from tests.conftest import ROOT
from trocar.procs.config import load_system
from trocar.procs.machine.extras import PACKAGES, ExtraPackage, missing

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"


def without(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.parametrize("row", PACKAGES.values(), ids=list(PACKAGES))
def test_a_missing_package_is_one_sentence_with_its_extra(row: ExtraPackage, monkeypatch: pytest.MonkeyPatch) -> None:
    without(monkeypatch, row.module)
    monkeypatch.setattr(sys, "version_info", (3, 13, 1))
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    assert missing(row.module, "this") == (
        f"this needs {row.package}: {shlex.quote(sys.executable)} -m pip install 'trocar[{row.extra}]'")
    assert missing("json") == ""


def test_where_there_is_no_package_the_remedy_is_another_python_or_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    without(monkeypatch, "cyclonedds")
    monkeypatch.setattr(sys, "version_info", (3, 14, 0))
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    assert missing("cyclonedds", "the ROS bridge") == (
        "the ROS bridge needs cyclonedds, which has no package for Python 3.14: use python3.13")
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    assert missing("cyclonedds", "the ROS bridge") == (
        "the ROS bridge needs cyclonedds, which has no package for aarch64: use a computer with x86_64")


@cases("row", PACKAGES.values())
def test_the_extra_of_a_package_installs_it_where_there_is_one(row: ExtraPackage) -> None:
    (line,) = [line for line in PROJECT["optional-dependencies"][row.extra]
               if line.partition(";")[0].startswith(f"{row.package}>")]
    assert ("platform_machine" in line) == bool(row.machines) and all(f"'{name}'" in line for name in row.machines)
    limit = "" if row.before is None else f"python_version < '{row.before[0]}.{row.before[1]}'"
    assert limit in line and ("python_version" in line) == bool(limit)


def test_a_jerk_limit_without_ruckig_is_an_error_before_anything_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    without(monkeypatch, "ruckig")
    assert not load_system(KINEMATIC).errors
    (problem,) = load_system(KINEMATIC, sets=["arm.jerk_time_s=0.1"]).errors
    assert "trocar[jerk]" in problem.text
    assert not load_system(KINEMATIC, sets=["arm.jerk_time_s=0"]).errors


@pytest.mark.parametrize(("module", "section", "value"), [
    ("cyclonedds", "ros", "{}"), ("starlette", "gui", "{}"), ("foxglove", "foxglove", "{}")])
def test_a_process_that_cannot_run_is_an_error_before_anything_starts(
        module: str, section: str, value: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(KINEMATIC.read_text().rstrip() + f"\ntrocar:\n  {section}: {value}\n")
    without(monkeypatch, module)
    (problem,) = load_system(file).errors
    assert problem.line == len(file.read_text().splitlines()) and f"trocar[{PACKAGES[module].extra}]" in problem.text
    assert not load_system(file, sets=[f"{section}=null"]).errors  # as the message says
