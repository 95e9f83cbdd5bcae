"""The state of all arms in a word each, for the strip of every page."""

from __future__ import annotations

from contextlib import closing

import pytest

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.arm.states import PUBLISHED
from trocar.procs.document.system import from_json
from trocar.procs.gui.pages.assets import STATIC
from trocar.procs.gui.strip_source import LATE_NS, StripSource, word_of
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns


@pytest.mark.parametrize(("state", "is_homed", "is_busy", "word"), [
    ("DISABLED", False, False, "off"), ("DISABLED", False, True, "powering"), ("ENABLED", False, False, "powered"),
    ("ENABLED", False, True, "homing"), ("ENABLED", True, False, "ready"), ("ENABLED", True, True, "moving"),
    ("PAUSED", True, False, "paused"), ("FAULT", True, True, "fault"), ("", False, False, "no data")])
def test_each_state_has_a_word(state: str, is_homed: bool, is_busy: bool, word: str) -> None:
    assert word_of(state, is_homed=is_homed, is_busy=is_busy) == word


def test_each_word_has_an_icon() -> None:
    script = (STATIC / "strip.js").read_text(encoding="utf-8")
    for state in PUBLISHED.values():
        for is_homed in (False, True):
            for is_busy in (False, True):
                word = word_of(state, is_homed=is_homed, is_busy=is_busy)
                assert f' {word}: "' in script, word


def test_an_arm_is_without_data_once_its_record_is_old(world: World) -> None:
    with robot(world.name) as scripted:
        document = from_json(directory.document(world.name))
        with closing(StripSource(document)) as source:
            now = monotonic_ns()
            assert source.read(now)["arms"]["PSM1"] == {"word": "no data", "late": 0, "reason": ""}
            scripted.show_arm(0.1, "ENABLED")
            found = source.read(now)
            assert found["arms"]["PSM1"]["word"] in ("powered", "ready") and found["clock"] == "wall"
            assert found == source.read(now + LATE_NS // 2), "it changes with the states, not with time"
            late = source.read(now + 3 * LATE_NS)["arms"]["PSM1"]
            assert late["word"] == "no data" and late["late"] == 3
