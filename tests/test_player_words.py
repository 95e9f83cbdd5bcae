"""docs/write-a-process.md has a row for each member of Player's drivers, and each row a test, or why there is none."""

from __future__ import annotations

import re

from tests.conftest import ROOT

PAGE = (ROOT / "docs/write-a-process.md").read_text(encoding="utf-8")
MEMBERS = (
    "Setup", "Shutdown", "Terminate", "Main", "MainSetup", "MainQuit", "Wait", "Update", "HasSubscriptions",
    "Publish", "GetError", "SetError", "Subscribe", "Unsubscribe", "ProcessMessages", "ProcessMessage",
    "ProcessInternalMessages", "RegisterProperty", "StartThread", "StopThread", "TestCancel", "AddInterface",
    "AddFileWatch", "RemoveFileWatch", "Lock", "Unlock", "SubscriptionLock", "SubscriptionUnlock", "ret_queue",
    "device_addr", "entries", "alwayson", "InQueue", "ThreadState", "SetupSuccessful", "SetupBarrier", "DummyMain",
    "DummyMainQuit", "overwrite_cmds", "queue_maxlen",
)
NEEDS_NO_TEST = {"AddInterface", "ThreadState", "Lock"}  # first words of rows that say why


def rows() -> list[tuple[str, str]]:
    """(Player's words, ours) of the table."""
    table = PAGE[PAGE.index("| Player |") :].splitlines()[2:]
    found = [line.strip("| ").split(" | ", 1) for line in table if line.startswith("|")]
    return [(theirs, ours) for theirs, ours in found]


def test_every_member_has_its_row() -> None:
    words = [word for theirs, _ in rows() for word in re.findall(r"\w+", theirs)]
    assert not set(MEMBERS) - set(words)
    assert [word for word in MEMBERS if words.count(word) > 1] == ["Publish"]  # in its forms


def test_every_row_names_a_test_that_is_there() -> None:
    without = set()
    for theirs, ours in rows():
        named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", ours)
        if not named:
            without.add(re.findall(r"\w+", theirs)[0])
        for path, test in named:
            assert f"def {test}" in (ROOT / path).read_text(encoding="utf-8"), (theirs, path, test)
    assert without <= NEEDS_NO_TEST


def test_the_programs_of_the_page_are_short() -> None:
    programs = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert programs and all(len(program.splitlines()) <= 40 for program in programs)
