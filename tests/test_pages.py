"""What the documents name is there: files, links, modules, verbs with their options, and the storeys of imports."""

from __future__ import annotations

import functools
import importlib.util
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import typer
import yaml

from tests.cases import cases
from tests.import_contract import PROCESSES, storey
from trocar.procs.tables.manifest import PROCS
from trocar.tools import cli

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")], key=str)
PAGES.remove(ROOT / "CHANGELOG.md")  # says what was
FOLDERS = ("shm", "procs", "tools", "tests", "configs", "docs", ".ci")
NOT_OURS = {"dvrk_calibrate_potentiometers.py", "dvrk_calibrate_suj.py", "wall.py", "box.py", "scanner.py",
            "procs/KIND/loop.py"}
"""Of others."""
CODE = re.compile(r"`([^`\n]+)`")
FORMS = [form for form in sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")) if form.stem != "config"]
each_page = cases("page", PAGES)


@functools.cache
def tree() -> dict[str, list[str]]:
    """Files and folders of the tree: where each name is."""
    found: dict[str, list[str]] = {}
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            if "__pycache__" not in path.parts:
                found.setdefault(path.name, []).append(path.relative_to(ROOT).as_posix())
    return found


def is_there(name: str) -> bool:
    """A path from the root or a file by its name; what does not look like ours counts as there."""
    path, _, test = name.partition("::")
    if path in NOT_OURS:
        return True
    if path.split("/")[0] in FOLDERS and "/" in path:
        file = ROOT / path
        return file.exists() and (not test or f"def {test}(" in file.read_text(encoding="utf-8"))
    if re.fullmatch(r"\w+\.py", path):
        return path in tree() or (ROOT / path).exists()
    return True


def module_is_there(name: str) -> bool:
    """A module, or what one has under its last name."""
    with_module = [".".join(name.split(".")[:n]) for n in range(len(name.split(".")), 0, -1)]
    for module in with_module:
        path = ROOT / module.replace(".", "/")
        if path.is_dir() or path.with_suffix(".py").is_file():
            rest = name.removeprefix(module).strip(".").split(".")[0]
            file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
            return not rest or bool(re.search(rf"\b{rest}\b", file.read_text(encoding="utf-8")))
    return False


def lines_of(text: str) -> Iterator[str]:
    """What a person may type: code spans, and lines of blocks."""
    yield from CODE.findall(text)
    yield from (line.strip() for line in re.findall(r"^    (\S.*)$", text, re.MULTILINE))


@functools.cache
def command_line() -> Any:
    """The verbs as they are parsed."""
    return typer.main.get_command(cli.build())


def wrong_in(line: str) -> str:
    """What is wrong with a line that begins with `trocar`: its verb, or an option."""
    words = re.split(r" [#|>&;]|[.,;:]?$", line.removeprefix("trocar "))[0].split()
    command = command_line()
    while hasattr(command, "commands") and words and re.fullmatch(r"[a-z][a-z-]*", words[0]):
        if words[0] not in command.commands:
            return f"no verb {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    asked = {word.split("=")[0] for word in words if re.match(r"--[a-z]", word)}
    return ", ".join(sorted(asked - known - {"--help", "--version"}))


@each_page
def test_files_that_a_page_names_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not [name for name in re.findall(r"`([\w./-]+(?:::\w+)?)`", text) if not is_there(name)]
    links = [link for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text) if not link.startswith("http")]
    assert not [link for link in links if not (page.parent / link).exists()]
    modules = re.findall(r"`((?:shm|procs|tools|tests)(?:\.\w+)+)`", text)
    assert not [name for name in modules if not is_there(name.split(".")[-1] + ".py") and not module_is_there(name)]


@each_page
def test_verbs_and_options_that_a_page_names_are_there(page: Path) -> None:
    typed = [line for line in lines_of(page.read_text(encoding="utf-8")) if line.startswith("trocar ")]
    wrong = {line: what for line in typed if (what := wrong_in(line))}
    assert not wrong
    run = {name for line in lines_of(page.read_text(encoding="utf-8")) for name in re.findall(r"python -m (\S+)", line)}
    assert not [name for name in run if importlib.util.find_spec(name) is None]


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.name)
def test_an_issue_form_is_complete_and_its_commands_are_there(form: Path) -> None:
    text = form.read_text(encoding="utf-8")
    written = yaml.safe_load(text)
    assert {"name", "description", "body"} <= written.keys()
    asked = [field for field in written["body"] if field["type"] != "markdown"]
    assert len({field["id"] for field in asked}) == len(asked) and all(field["attributes"]["label"] for field in asked)
    typed = [line for line in lines_of(text) if line.startswith("trocar ")]
    assert typed and not {line: what for line in typed if (what := wrong_in(line))}


def test_the_form_for_bugs_asks_for_the_report() -> None:
    text = next(form for form in FORMS if form.stem == "bug").read_text(encoding="utf-8")
    assert {"`trocar report`", "`trocar --version`", "Hardware"} <= set(re.findall(r"`trocar [\w-]+`|Hardware", text))


@each_page
def test_headings_that_a_page_leads_to_are_there(page: Path) -> None:
    for name, heading in re.findall(r"\]\(([^)#\s:]*)#([^)]+)\)", page.read_text(encoding="utf-8")):
        text = (page.parent / name if name else page).read_text(encoding="utf-8")
        lines = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
        there = {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}
        assert heading in there, f"{name}#{heading}"


def test_the_architecture_names_every_table() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    files = [path for folder in ("shm", "procs", "tools") for path in (ROOT / folder).rglob("*.py")]
    tables = [path for path in files if path.read_text(encoding="utf-8").startswith('"""THE TABLE')]
    assert not [path for path in tables if f"`{path.relative_to(ROOT).as_posix()}`" not in text]


def test_the_figure_of_the_architecture_has_every_kind_of_process() -> None:
    text = (ROOT / "docs/figures/architecture.svg").read_text(encoding="utf-8")
    assert not {row.kind for row in PROCS} - set(re.findall(r'class="name"[^>]*>(\w+)\b', text))


@pytest.mark.parametrize("figure", sorted((ROOT / "docs/figures").iterdir()), ids=lambda figure: figure.name)
def test_a_figure_is_small_well_formed_and_shown(figure: Path) -> None:
    assert ElementTree.fromstring(figure.read_bytes()).tag.endswith("}svg") and figure.stat().st_size < 60_000
    assert any(f"figures/{figure.name})" in page.read_text(encoding="utf-8") for page in PAGES)


def parts() -> set[str]:
    """What stands on a storey."""
    files = [path.relative_to(ROOT) for path in (ROOT / "procs").rglob("*.py") if path.stem != "__init__"]
    return {f"procs/{path.parts[1]}" for path in files} | {"shm", "tools"}


def storeys() -> list[set[str]]:
    """What the import contract says, of what there is."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    house = next(row for row in settings["tool"]["importlinter"]["contracts"] if row["containers"] == ["trocar"])
    rows = [{name.replace(".", "/") for name in re.findall(r"[\w.]+", storey(row))} for row in house["layers"]]
    return [row & parts() for row in rows]


def test_every_part_stands_on_a_storey() -> None:
    assert parts() == set().union(*storeys())


def test_the_architecture_shows_the_storeys() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```\n(tools, rl\n[^`]*\nshm\n)```", text)
    shown = [set(re.findall(r"\w+", line.replace("processes", " ".join(PROCESSES)))) for line in block.splitlines()]
    assert [{name if name in ("tools", "shm") else f"procs/{name}" for name in row} for row in shown] == storeys()
