"""docs/player.md has a row for each member of Player's drivers, and each row a test, or why there is none."""

from __future__ import annotations

import re

from tests.conftest import ROOT

PAGE, GUIDE = ((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("player.md", "write-a-process.md"))
MEMBERS = (
    "Setup", "Shutdown", "Terminate", "Main", "MainSetup", "MainQuit", "Wait", "Update", "HasSubscriptions",
    "Publish", "GetError", "SetError", "Subscribe", "Unsubscribe", "ProcessMessages", "ProcessMessage",
    "ProcessInternalMessages", "RegisterProperty", "StartThread", "StopThread", "TestCancel", "AddInterface",
    "AddFileWatch", "RemoveFileWatch", "Lock", "Unlock", "SubscriptionLock", "SubscriptionUnlock", "ret_queue",
    "device_addr", "entries", "alwayson", "InQueue", "ThreadState", "SetupSuccessful", "SetupBarrier", "DummyMain",
    "DummyMainQuit", "overwrite_cmds", "queue_maxlen",
)
NEEDS_NO_TEST = {"MainSetup", "DummyMainQuit", "entries", "Lock", "Unlock", "SubscriptionLock", "SubscriptionUnlock"}


def rows() -> list[tuple[str, str, str]]:
    """(Player's member, ours, the test) of the table."""
    table = PAGE[PAGE.index("| Player |") :].splitlines()[2:]
    found = [line.strip("| ").split(" | ") for line in table if line.startswith("|")]
    return [(theirs, ours, shown) for theirs, ours, shown in found]


def test_every_member_has_its_row() -> None:
    members = [theirs.partition(",")[0] for theirs, _, _ in rows()]
    assert set(members) == set(MEMBERS)
    assert {member for member in members if members.count(member) > 1} == {
        "Publish", "Subscribe", "RegisterProperty", "HasSubscriptions"}  # in their forms


def test_every_row_has_a_test_of_its_own_or_says_why_there_is_none() -> None:
    named = []
    for theirs, ours, shown in rows():
        if shown == "–":
            assert theirs in NEEDS_NO_TEST and ours.startswith("none: "), theirs
            continue
        path, test = re.fullmatch(r"`(tests/[\w/]+\.py)::(\w+)`", shown).groups()  # type: ignore[union-attr]
        assert f"def {test}(" in (ROOT / path).read_text(encoding="utf-8"), (theirs, path, test)
        named.append(shown)
    assert len(named) == len(set(named))


def test_the_programs_of_the_page_are_short() -> None:
    programs = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
    assert programs and all(len(program.splitlines()) <= 40 for program in programs)
