"""The MATLAB classes have the words of the Python ones, in what both MATLAB and Octave understand (tools/matlab)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trocar.tools.client.arm import Arm
from trocar.tools.client.consoles import ConsoleHandle, TeleopHandle
from trocar.tools.client.kinds import Ecm, Gripper, Jaw, Mtm, Psm, SetupArm, SetupLocal, Suj
from trocar.tools.client.moves import MoveHandle
from trocar.tools.client.parts import Body, Local

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "tools" / "matlab" / "+trocar"
FILES = sorted(PACKAGE.rglob("*.m"))
CLASSES = {"arm": Arm, "psm": Psm, "ecm": Ecm, "mtm": Mtm, "jaw": Jaw, "gripper": Gripper, "frame": Body,
           "local": Local, "suj": Suj, "suj_arm": SetupArm, "suj_arm_local": SetupLocal, "console": ConsoleHandle,
           "teleop": TeleopHandle, "move_handle": MoveHandle}
PYTHON_ALONE = {"close", "period_statistics", "check_connections", "on_event", "process_events"}
OCTAVE_ALONE = re.compile(r'"|^\s*#|\bend(function|if|while|for|switch|classdef|methods)\b|!=|\+=|-=|\+\+|\bprintf\b|'
                          r"\bdo\b|\buntil\b|\bunwind_protect\b")


def words_of(name: str) -> set[str]:
    """Methods of a class and of those that it is made from."""
    text = (PACKAGE / f"{name}.m").read_text(encoding="utf-8")
    head = text.splitlines()[0]
    own = set(re.findall(r"^        function (?:\[?[\w, ]+\]? = )?(\w+)\(", text, re.MULTILINE))
    return own.union(*(words_of(base) for base in re.findall(r"trocar\.(\w+)", head)))


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_has_the_words_of_the_python_one(name: str) -> None:
    wanted = {word for word in dir(CLASSES[name]) if not word.startswith("_")}
    if name != "jaw":
        wanted -= PYTHON_ALONE
    assert not wanted - words_of(name)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_file_keeps_to_what_both_understand(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    code = [re.sub(r"'[^']*'|%.*", "", line) for line in lines]
    assert not [line for line in code if OCTAVE_ALONE.search(line)]
    assert max(map(len, lines)) <= 120 and len(lines) <= 400
    assert re.match(rf"(classdef|function) .*\b{path.stem}\b", lines[0]), "its class or function has its name"
    assert lines[1].strip().startswith("%"), "help for it"


def test_the_page_and_that_of_python_have_every_word() -> None:
    page = "".join((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("matlab.md", "python.md"))
    told = set(re.findall(r"\w+", page)) | {"trajectory_j_get_ratio_v", "trajectory_j_get_ratio_a",
                                            "trajectory_j_set_ratio_v", "trajectory_j_set_ratio_a"}
    assert not {word for name, kind in CLASSES.items() for word in dir(kind)
                if not word.startswith("_") and word not in PYTHON_ALONE
                and not re.fullmatch(r"(measured|setpoint)_j\w", word)} - told
