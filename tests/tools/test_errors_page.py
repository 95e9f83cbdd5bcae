"""docs/errors.md is the table of codes, and the table has what processes tell: no more, no less."""

from __future__ import annotations

import ast
import re
from typing import get_args

import pytest

from tests.test_pages import wrong_in
from trocar.procs.config.models.trocar_section import ProcessKeys, TrocarSection
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import Code
from trocar.procs.tables.codes import CODES, FAULTS
from trocar.procs.tables.manifest import PROCS
from trocar.tools.pages import errors as errors_page
from trocar.tools.pages.generated import keep

ROOT = errors_page.PAGE.parent.parent
NAMES = {name: row for name, row in vars(codes).items() if isinstance(row, Code)}
# Who tells what is not named in the folder of a kind.
ELSEWHERE = {"fault_report.py": "arm, suj", "io_faults.py": "arm, suj", "filters.py": "filters", "node": "any",
             "client": "third_party", "from_ros": "third_party"}


def used() -> dict[str, set[str]]:
    """Names of rows in the code, and the kinds whose code names them."""
    found: dict[str, set[str]] = {}
    for path in (*ROOT.glob("procs/**/*.py"), *ROOT.glob("tools/client/*.py"), *ROOT.glob("tools/from_ros/*.py")):
        if path.name == "codes.py":
            continue
        room = path.relative_to(ROOT).parts[1]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
            if name in NAMES:
                kinds = ELSEWHERE.get(path.name, ELSEWHERE.get(room, room))
                found.setdefault(name, set()).update(kinds.split(", "))
    return found


def test_the_page_is_as_the_table_says() -> None:
    assert errors_page.PAGE.read_text(encoding="utf-8") == errors_page.page()


def test_every_code_has_its_cause_and_remedy() -> None:
    text = errors_page.page()
    for row in CODES:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", row.code) and len(row.code) <= 32
        assert row.cause and row.remedy and len(f"{row.cause}; {row.remedy}") <= 200
        assert f"| {row.owner} | {row.cause} | {row.remedy} |" in text
    assert all(f"| {row.number} | `{row.code}` |" in text for row in FAULTS)


def test_no_remedy_is_the_command_that_shows_it() -> None:
    """Logs of a process show what it reports, `trocar status` what arms and teleoperations do."""
    for row in CODES:
        owners = set(row.owner.split(", "))
        if not owners <= {"supervisor", "teleop"}:  # NAME is another one there
            assert "trocar logs NAME" not in row.remedy, row.code
        if owners & {"io", "arm", "suj", "teleop"}:
            assert "trocar status" not in row.remedy, row.code


def test_verbs_settings_and_pages_that_a_remedy_names_are_there() -> None:
    for row in CODES:
        typed = re.findall(r"trocar [a-z][^;,)]*", row.remedy)
        assert not [wrong for line in typed if (wrong := wrong_in(line))], row.code
        assert not [page for page in re.findall(r"docs/[\w-]+\.md", row.remedy) if not (ROOT / page).exists()], row.code
        for section, key in re.findall(r"\b([a-z]+)\.(?:NAME\.)?([a-z_]+)\b", re.sub(r"docs/\S+", "", row.remedy)):
            kind = TrocarSection.model_fields[section].annotation
            model = next(iter(get_args(kind)), kind)  # of `ros`: RosOptions or None
            keys = ProcessKeys if section == "processes" else model
            assert isinstance(keys, type) and key in keys.model_fields, f"{row.code}: {section}.{key}"  # type: ignore[attr-defined]


def test_codes_are_unique_and_their_owners_are_kinds() -> None:
    assert len({row.code for row in CODES}) == len(CODES) == len(NAMES)
    kinds = {row.kind for row in PROCS} | {"any"}
    assert all(set(row.owner.split(", ")) <= kinds for row in CODES)


@pytest.mark.slow
def test_every_code_is_told_by_those_who_own_it() -> None:
    """That no other code is told is a matter of types: processes give rows to what tells, not names."""
    found = used()
    assert not set(NAMES) - set(found), "nobody tells these"
    for name, row in NAMES.items():
        assert found[name] >= set(row.owner.split(", ")), name


def test_codes_go_through_rows_only() -> None:
    """`emit` takes any name: with a severity it is called where rows are taken apart, or a message is repeated."""
    files = [path for folder in ("procs", "shm", "tools") for path in ROOT.glob(f"{folder}/**/*.py")]
    places = {str(path.relative_to(ROOT)) for path in files
              if re.search(r"emit\([^)]*severity=", path.read_text(encoding="utf-8"))}
    assert places == {"shm/system/events.py", "procs/io/loop.py", "procs/system/message_hub.py"}


def test_the_check_tells_a_stale_page(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    page, text = tmp_path / "errors.md", errors_page.page()
    assert keep(page, text, ["--check"]) == 1 and "stale" in capsys.readouterr().out
    assert keep(page, text, []) == 0 and keep(page, text, ["--check"]) == 0
