"""Words: those that were replaced, and those that texts for operators avoid. CONTRIBUTING.md has the style."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import typer

from tests.cases import cases
from tests.test_house import ROOT, each_keeps_to, nodes_of, relative, source_of
from trocar.procs.tables.codes import CODES
from trocar.tools import cli

PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "docs/tutorials").glob("*.md"),
         *(ROOT / ".github").rglob("*.yml")]
AVOIDED: Final = {  # THE list: a pattern, and what to write instead
    r"(?:no|some|any)body|whoever": "an agent (the operator, a program), or a passive",
    r"(?:is|are|was|were) told": "is reported",
    r"(?:go|goes|going|went) on": "continue, resume",
    r"anew": "again; for `begin anew`: restart",
    r"any more": "no longer",
    r"held up": "delayed, stalled",
    r"let go": "released",
    r"not beaten": "heartbeat lost",
    r"bears": "tolerates, withstands",
    r"came to nothing": "failed",
    r"asked for": "requested",
    r"mend(?:s|ed|ing)?": "fix, repair",
    r"of ours": "our",
    r"is seen": "is detected",
    r"so many": "the number, or the noun",
    r"for ever": "indefinitely, permanently",
    r"used wrongly": "usage error",
    r"dead (?:ones|systems?|process(?:es)?)|has died": "crashed",
    r"say what|look into": "report, show",
}
INSTEAD_OF_NOUN: Final = re.compile(r"(?:What|Which|Who|Whether|How|So many|Another|None)\b")
LEFT: Final = (
    "set-point", "time-out", "tele-operation", "set-up joint", "set-up arm", "power_wanted", "velocity_used",
    "no_mishaps", "mislabel_replies", "miss_block", "board_gone", "hand_release", "is_played", "rouse", "farewell",
    "MOST_", "LONGEST_", "LEAST_", "SHORTEST_")
"""Beginnings of words."""
LEFT_CLASSES: Final = re.compile(
    r"class (?:Refused|Me|Pulse|Nap|Rig|Stand|Theatre|Seat|Climb|Duties)\b(?!\(Problem)")
SAYS_OLD_WORDS = ("tests/test_plain_english.py", "tools/verbs/send.py", "tests/boards/test_board_commands.py")
_ANY: Final = re.compile("|".join(rf"\b(?:{pattern})\b" for pattern in AVOIDED), re.IGNORECASE)


def unplain(text: str) -> list[str]:
    """The words of a text that are on the list; names of tests are none of its words."""
    return _ANY.findall(re.sub(r"`tests/[^`]*`", "", text))


def help_texts() -> Iterator[tuple[str, str, str]]:
    """Of all verbs: verb, argument or option or "", help."""
    waiting = [("trocar", typer.main.get_command(cli.build()))]
    while waiting:
        name, command = waiting.pop()
        yield name, "", command.help or ""
        yield from ((name, parameter.opts[0], getattr(parameter, "help", None) or "") for parameter in command.params)
        waiting += [(f"{name} {verb}", found) for verb, found in getattr(command, "commands", {}).items()]


def test_words_that_left_do_not_come_back() -> None:
    folders = {"docs": "*.md", "configs": "*.yaml", **dict.fromkeys(("procs", "shm", "tools", "tests"), "*.py")}
    files = [path for folder, kind in folders.items() for path in (ROOT / folder).rglob(kind)]

    def left(text: str) -> list[str]:
        return [word for word in LEFT if word in text and re.search(rf"\b{word}", text)] + LEFT_CLASSES.findall(text)

    found = {relative(path): words for path in (*PAGES, *files)
             if relative(path) not in SAYS_OLD_WORDS and (words := left(path.read_text(encoding="utf-8")))}
    assert not found, "docs/glossary.md says what is said now"


def test_pages_are_plain_english() -> None:
    each_keeps_to(lambda path: unplain(path.read_text(encoding="utf-8")), PAGES)


def test_texts_in_the_code_are_plain_english() -> None:
    seams = re.compile(r"""["']\s*[rf]?["']""")  # a text may be written in parts

    def in_python(path: Path) -> set[str]:
        if not _ANY.search(seams.sub("", source_of(path).replace(r"\n", " "))):
            return set()
        prose = {id(node.value) for node in nodes_of(path) if isinstance(node, ast.Expr)}  # docstrings
        return {node.value for node in nodes_of(path) if isinstance(node, ast.Constant) and isinstance(node.value, str)
                and id(node) not in prose and unplain(node.value)}

    def in_script(path: Path) -> list[str]:
        texts = re.findall(r'"[^"\n]* [^"\n]*"|`[^`]*`', path.read_text(encoding="utf-8"))
        return [text for text in texts if unplain(text)]

    each_keeps_to(in_python)
    each_keeps_to(in_script, (ROOT / "procs/gui/static").glob("*.js"))


def test_help_is_plain_english() -> None:
    texts = list(help_texts())
    assert len(texts) > 250
    assert not [(*where, words) for *where, text in texts if (words := unplain(text))]


def test_help_of_an_option_is_a_phrase_with_a_noun() -> None:
    options = [(verb, option, text) for verb, option, text in help_texts() if option and text]
    assert not [row for row in options if INSTEAD_OF_NOUN.match(row[2])]
    assert not [row for row in options if not row[2].endswith((".", "…")) or "\n" in row[2]]


@cases("code", CODES)
def test_a_code_is_plain_english(code) -> None:  # type: ignore[no-untyped-def]
    assert not unplain(f"{code.cause}; {code.remedy}")
    assert not code.cause.endswith(".") and not code.remedy.endswith(".")
