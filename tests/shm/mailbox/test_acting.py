"""For whom a process acts: the origin of its commands, by the system that they are for."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest

from trocar.shm.mailbox.origins import ACTING, CONFINED, NO_ORIGIN
from trocar.shm.memory import private


@pytest.fixture(autouse=True)
def _as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name, value in (("origin", None), ("system", ""), ("process", "")):
        monkeypatch.setattr(ACTING, name, value, raising=False)
    monkeypatch.setenv(CONFINED, "")  # is removed at the end
    monkeypatch.delenv(CONFINED)
    yield


def test_programs_that_a_process_starts_have_no_more_authority_than_it_has() -> None:
    ACTING.confine("robot")
    asks = "from trocar.shm.mailbox.origins import ACTING; print([ACTING.in_system(s) for s in ('robot', 'other')])"
    done = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str([NO_ORIGIN, NO_ORIGIN])


def test_systems_in_its_own_memory_are_its_own_to_command(monkeypatch: pytest.MonkeyPatch) -> None:
    ACTING.confine("robot")
    monkeypatch.setattr(private, "is_kept", "rehearsal".__eq__)
    assert ACTING.in_system("robot") == ACTING.in_system("other") == NO_ORIGIN
    assert ACTING.in_system("rehearsal") is None


def test_a_system_that_a_process_starts_passes_on_commands_of_its_own_operators() -> None:
    ACTING.confine("robot")
    ACTING.begin("PSM1")
    assert ACTING.in_system("other") is None
