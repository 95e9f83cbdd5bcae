"""Where files are found, how findings are put into words, and the edges of what counts as a matrix."""

from __future__ import annotations

import json
import math
import os
import stat
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.procs.config.loading.chains import check_gravity
from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.kinematic_file import GravityFile
from trocar.procs.config.models.system_file import SystemFile
from trocar.procs.config.read.problem import WARNING, FileProblem, key_text, value_text
from trocar.procs.config.read.quantities import check_invertible, check_rigid, check_size
from trocar.procs.config.read.search import expanded, search_path
from trocar.procs.config.read.source import SourceFile, read_bytes, read_source
from trocar.procs.config.read.validate import validate
from trocar.procs.document.arms import GRAVITY_PARAMETERS, MASTER_JOINTS, MasterGravityParameters
from trocar.procs.document.keys import keys_in


@pytest.fixture
def folders(tmp_path: Path) -> list[Path]:
    """A working folder, one of a person, and the project's; files of the same name in some of them."""
    made = [tmp_path / name for name in ("here", "theirs", "configs")]
    for folder, names in zip(made, (("a.json",), ("b.json", "pid/sawControllersPID-PSM.json"),
                                    ("a.yaml", "b.yaml", "c.yaml", "pid/PSM.yaml", "arm/PSM1.json")), strict=True):
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("{}")
    return made


def test_names_are_looked_for_as_they_are_then_under_our_own_name(folders: list[Path]) -> None:
    here, theirs, configs = folders
    path = search_path((here, theirs, configs, here))
    assert path.folders == (here, theirs, configs) and str(path) == f"{here}, {theirs}, {configs}"
    for names, found in ((("a.json",), here / "a.json"), (("b.json",), theirs / "b.json"),
                         (("c.json",), configs / "c.yaml"), (("c.json", "b.json"), theirs / "b.json"),
                         (("d.json", "c.json"), configs / "c.yaml"), (("c.yaml",), configs / "c.yaml"),
                         (("pid/sawControllersPID-PSM.json",), theirs / "pid/sawControllersPID-PSM.json"),
                         (("x.json",), None), (("c.txt",), None), (("", "x.json"), None),
                         ((str(configs / "b.yaml"),), configs / "b.yaml"), ((str(here / "b.yaml"),), None),
                         (("pid",), theirs / "pid"), (("x" * 300,), None)):
        assert path.find(*names) == found, names
    (theirs / "pid/sawControllersPID-PSM.json").unlink()
    assert path.find("pid/sawControllersPID-PSM.json") == configs / "pid/PSM.yaml"


def test_other_folders_come_directly_after_the_working_one(folders: list[Path]) -> None:
    here, theirs, configs = folders
    path = search_path((here, configs)).first(theirs, configs)
    assert path.folders == (here, theirs, configs)
    assert path.find("b.json") == theirs / "b.json"
    assert path.find_all("b.json") == (theirs / "b.json", configs / "b.yaml") and path.find_all("x.json") == ()
    assert path.find_all("a.json") == (here / "a.json", configs / "a.yaml")
    (theirs / "b.yaml").write_text("{}")
    assert path.find_all("b.json") == (theirs / "b.json", configs / "b.yaml"), "one of each folder"


def test_the_nearest_name_is_told_where_one_is_close(folders: list[Path]) -> None:
    path = search_path((*folders, folders[0] / "nowhere"))
    assert path.nearest("arm/PSM2.json") == "arm/PSM1.json" and path.nearest("arm/MTML-22723.json") == ""
    assert path.nearest("nowhere/PSM1.json") == "" and path.nearest("pid/PSN.yaml") == "pid/PSM.yaml"


def test_a_tilde_is_a_home_or_stays(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert expanded("~/x") == tmp_path / "x" and expanded("~nobody-of-that-name/x") == Path("~nobody-of-that-name/x")


def test_a_finding_is_one_line_of_file_line_key_value_text_and_what_is_allowed() -> None:
    for problem, line in (
            (FileProblem("a.json", 3, "b.c", "7", "out of range", "from 0"),
             "a.json:3: error: b.c = 7: out of range; allowed: from 0"),
            (FileProblem("a.json", 0, "", "", "no", severity=WARNING), "a.json: warning: no"),
            (FileProblem("a.json", 1, "b", "", "is\n missing"), "a.json:1: error: b: is missing"),
            (FileProblem("a.json", 1, "", "[1]", "no"), "a.json:1: error: [1]: no")):
        assert str(problem) == line
    assert key_text(()) == "" and key_text(("robots", 0, "name", 2, 1)) == "robots[0].name[2][1]"


def test_values_of_more_than_60_signs_are_shortened() -> None:
    assert value_text("x" * 58) == f'"{"x" * 58}"' and value_text("x" * 59) == '"' + "x" * 58 + "…"
    assert value_text([1] * 20) == str([1] * 20) and value_text([1] * 21) == "a list of 21"
    assert value_text({"a": 1}) == '{"a": 1}' and value_text({"a": "x" * 60}) == "an object"
    assert (value_text("ü"), value_text(math.nan), value_text({1, 2})) == ('"ü"', "NaN", "{1, 2}")


def test_a_finding_stands_at_the_nearest_line_or_at_set() -> None:
    data: dict[str, object] = {"a": {"b": [1, {"c": 2}]}, "d": 4}
    lines = {(): 1, ("a",): 2, ("a", "b"): 3, ("a", "b", 1): 4, ("d",): 9}
    source = SourceFile(Path("x.json"), data, lines, frozenset({("e", "f"), ("d",)}))
    for key, place in ((("a", "b", 1, "c"), "x.json:4: error: a.b[1].c = 2: no"),
                       (("a", "b", 7), "x.json:3: error: a.b[7]: no"), (("a", "x"), "x.json:2: error: a.x: no"),
                       (("x",), "x.json:1: error: x: no"), ((), "x.json:1: error: no"),
                       (("d",), "--set: error: d = 4: no"), (("e",), "--set: error: e: no"),
                       (("e", "f", "g"), "--set: error: e.f.g: no")):
        assert str(source.problem(key, "no")) == place
    assert source.at(("a", "b", 0)) == 1 and source.at(("a", "b", -1)) is None and source.at(("d", 0)) is None
    assert source.has(("d",)) and not source.has(("a", "b", 2)) and source.at(()) is data
    assert str(SourceFile(Path("x"), {}, {}).problem(("a",), "no")) == "x: error: a: no"


def test_old_names_are_read_where_the_new_ones_are_not_written() -> None:
    source = SourceFile(Path("x"), {"old": {"x": 1}, "both": 1, "new_both": 2}, {(): 1, ("old", "x"): 3, ("both",): 4})
    renamed = source.renamed({"old": "new", "both": "new_both", "none": "other"})
    assert renamed.data == {"new": {"x": 1}, "both": 1, "new_both": 2}
    assert renamed.lines == {(): 1, ("new", "x"): 3, ("both",): 4} and source.renamed({"none": "other"}) is source


def test_files_that_are_none_are_told_before_they_are_opened(tmp_path: Path) -> None:
    large, exact = tmp_path / "large.json", tmp_path / "exact.json"
    large.write_bytes(b" " * 4_000_001)
    exact.write_bytes(b"{}" + b" " * 3_999_998)
    os.mkfifo(tmp_path / "pipe")
    odd: Any = SimpleNamespace(stat=lambda: SimpleNamespace(st_mode=stat.S_IFLNK, st_size=0))
    for path, text, allowed in ((large, "too large: 4000001 bytes", "at most 4000000"),
                                (tmp_path, "not a regular file but a folder", "a file"),
                                (tmp_path / "pipe", "not a regular file but a named pipe", "a file"),
                                (odd, "not a regular file but something else", "a file")):
        assert read_bytes(path) == (b"", FileProblem(str(path), 0, "", "", text, allowed))
    assert read_bytes(exact) == (exact.read_bytes(), None)


def test_an_unknown_key_is_a_slip_before_it_is_the_key_of_a_section(tmp_path: Path) -> None:
    system = SourceFile(tmp_path, {"IO": [], "consoles": []}, {})  # IO is also a key of ISI_focus_controller
    assert any('did you mean "IOs"?' in problem.text for problem in validate(SystemFile, system)[1])


@pytest.mark.parametrize(("name", "text", "said"), [
    ("x.json", b"\xef\xbb\xbf{}", ""), ("x.YML", b"a: 1", ""), ("x.json", b"a: 1", "broken JSON, column 1"),
    ("x.yaml", b"{a", "broken YAML, column 3"), ("x.json", b"\xff", "not UTF-8 text: invalid start byte at byte 0"),
    ("x.json", "{}".encode("utf-16"), "UTF-16"), ("x.json", b"\n", "the file is empty"), ("x.yaml", b"", "is empty"),
    ("x.xml", b" <a/>", "this is XML"), ("x.json", b"[]", "the document must be an object"),
    ("x.json", b'{"a": 1, "a": 2}', "key occurs twice: the last one counts")])
def test_what_cannot_be_read_is_said_with_its_line(tmp_path: Path, name: str, text: bytes, said: str) -> None:
    (tmp_path / name).write_bytes(text)
    source, problems = read_source(tmp_path / name)
    assert [said in problem.text for problem in problems] == [True] * bool(said)
    assert (source is None) == bool(said and "twice" not in said)
    assert all(problem.line in (0, 1) and problem.file == str(tmp_path / name) for problem in problems)
    assert read_source(tmp_path / "nothing")[1][0].text == "cannot be read: No such file or directory"


class Findings:
    """What is wrong, in place of a context."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def error(self, key: object, text: str, allowed: str = "") -> None:
        self.said.append(f"{text}; {allowed}")


def rows(matrix: Any) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(value) for value in row) for row in matrix)


def test_matrices_are_what_they_should_be_to_the_edge() -> None:
    found: Any = Findings()
    edge, beyond, mirrored = np.eye(4), np.eye(4), np.diag((1.0, 1.0, -1.0, 1.0))
    edge[0, 1], beyond[0, 1] = 1e-3, 1.001e-3
    shifted, huge, bent = np.eye(4), np.eye(4), np.eye(4)
    shifted[0, 3], huge[1, 1], bent[3, 0] = 5.0, 1e300, 0.1
    assert check_rigid(found, (), rows(edge)) and check_rigid(found, (), rows(shifted))
    for wrong in (huge, bent):
        assert not check_rigid(found, (), rows(wrong)) and found.said.pop()
    assert not check_rigid(found, (), rows(beyond))
    assert not check_rigid(found, (), rows(mirrored)) and not check_rigid(found, (), rows(np.eye(3)))
    assert check_invertible(found, (), rows(np.diag((1e-6, 1.0))), 2)
    assert check_invertible(found, (), rows(np.diag((-1e-6, 1.0))), 2)
    for matrix in (np.diag((0.99e-6, 1.0)), np.diag((1e200, 1e200)), np.full((2, 2), np.nan)):
        assert not check_invertible(found, (), rows(matrix), 2)
    assert not check_size(found, (), ((1.0,), (1.0, 2.0)), 2) and not check_size(found, (), (), 2)
    assert check_size(found, (), ((1.0, 2.0), (3.0, 4.0)), 2)
    rigid = "orthonormal right-handed axes, to 0.001"
    inverse = "has no inverse; an invertible matrix"
    assert found.said == [f"not a rotation (off by 0.001); {rigid}", f"not a rotation (off by 0); {rigid}",
                          "wrong size: 3 rows of 3 numbers; 4 rows of 4 numbers", *([inverse] * 3),
                          "wrong size: 2 rows of 1/2 numbers; 2 rows of 2 numbers",
                          "wrong size: 0 rows of  numbers; 2 rows of 2 numbers"]


# -- gravity -----------------------------------------------------------------------------------------------------------


def gravity(tmp_path: Path, **changes: Any) -> tuple[Any, list[str]]:
    """The parameters of a file with these changes, and what is wrong with it."""
    lengths = {key.name: key.length or 0 for _, _, key in keys_in(MasterGravityParameters)}
    keys: dict[str, Any] = {name: [0.1] * count for name, count in lengths.items()}
    keys |= {"safe_upper_torque_limit": [0.2] * MASTER_JOINTS, "sat_vec_vec": [0.2] * MASTER_JOINTS}
    for name, value in changes.items():
        keys[name] = [*keys[name][:2], value, *keys[name][3:]] if isinstance(value, float) else value
    (tmp_path / "gc.json").write_text(json.dumps({"version": "2.0", "GC_controller": keys}))
    context = Context(search_path((tmp_path,)))
    opened = context.open(GravityFile, tmp_path / "gc.json")
    found = check_gravity(opened) if opened is not None else None
    return found, [f"{problem.key}: {problem.text}; {problem.allowed}" for problem in context.problems]


@pytest.mark.parametrize(("changes", "said"), [
    ({}, ""), ({"safe_lower_torque_limit": 0.2}, ""), ({"db_vel_vec": 0.0}, ""),
    ({"safe_lower_torque_limit": 0.21}, "safe_lower_torque_limit[2]: is above the upper limit; at most 0.2"),
    ({"db_vel_vec": 0.2}, "db_vel_vec[2]: is no dead band; from 0 to below 0.2"),
    ({"db_vel_vec": -0.01}, "db_vel_vec[2]: is no dead band; from 0 to below 0.2"),
    ({"sat_vec_vec": 0.05}, "db_vel_vec[2]: is no dead band; from 0 to below 0.05"),
    ({"db_vel_vec": [0.1]}, "db_vel_vec: 1 numbers; 7 numbers"),
    ({"gc_dynamic_params_pos": []}, "gc_dynamic_params_pos: this key is required")])
def test_gravity_files_have_their_numbers_in_order(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    found, problems = gravity(tmp_path, **changes)
    assert (found is not None) == (said == "") and len(problems) == bool(said)
    assert all(problem.startswith(f"GC_controller.{said}") for problem in problems), problems
    if found is not None:
        assert len(found.positive) == GRAVITY_PARAMETERS and found.friction == (0.1,) * 7
        assert found.upper == (0.2,) * 7 and found.saturation == (0.2,) * 7 and found.lower[0] == 0.1


def test_every_list_of_a_gravity_file_that_is_out_of_order_is_told_once(tmp_path: Path) -> None:
    found, problems = gravity(tmp_path, safe_lower_torque_limit=[0.3] * 7, db_vel_vec=[0.4] * 7)
    assert found is None and [problem.split(":")[0] for problem in problems] == [
        "GC_controller.safe_lower_torque_limit[0]", "GC_controller.db_vel_vec[0]"]
