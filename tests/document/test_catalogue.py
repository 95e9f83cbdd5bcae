"""Instruments by name: what is found, what is refused with which reason, and that nothing else can happen."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import cases
from trocar.procs.document.catalogue import CANDIDATES, find, full_name, taken_apart


@dataclass(frozen=True)
class CatalogueRow:
    names: tuple[str, ...]
    model: str
    version_min: int | None = None
    version_max: int | None = None


DRIVER = CatalogueRow(("LARGE_NEEDLE_DRIVER",), "400006")
PLAIN = CatalogueRow(("LARGE_NEEDLE_DRIVER",), "420006", None, 11)
GEARED = CatalogueRow(("LARGE_NEEDLE_DRIVER",), "420006", 12, None)
SNAKE = CatalogueRow(("NEEDLE_DRIVER", "5MM_NEEDLE_DRIVER"), "400117")
OWN = CatalogueRow(("OWN",), "400117")
ROWS = (DRIVER, PLAIN, GEARED, SNAKE, CatalogueRow(("PROGRASP_FORCEPS",), "400093"),
        CatalogueRow(("POTTS_SCISSORS",), "400001"),
        CatalogueRow(("BOWEL_GRASPER",), "400127"))


@cases(("text", "row"), [
    ("LARGE_NEEDLE_DRIVER:400006", DRIVER), (":400006", DRIVER), (" large_needle_driver:400006 ", DRIVER),
    ("LARGE_NEEDLE_DRIVER:400006[7]", DRIVER), ("LARGE_NEEDLE_DRIVER:420006[11]", PLAIN),
    ("LARGE_NEEDLE_DRIVER:420006[12]", GEARED), ("LARGE_NEEDLE_DRIVER:420006:12", GEARED), (":420006[..11]", PLAIN),
    (":420006:[12..]", GEARED), ("LARGE_NEEDLE_DRIVER:420006[13..20]", GEARED),
    ("LARGE_NEEDLE_DRIVER:400006[..]", DRIVER), ("5MM_NEEDLE_DRIVER:400117", SNAKE)])
def test_an_instrument_is_found_by_name_model_and_version(text: str, row: CatalogueRow) -> None:
    found = find(text, ROWS)
    assert (found.entry, found.reason, found.note) == (row, "", "")


@pytest.mark.parametrize(("text", "row", "note"), [
    ("5MM_NEEDLE_DRIVER_400117", SNAKE, "taken as 5MM_NEEDLE_DRIVER:400117"),
    ("LARGE_NEEDLE_DRIVER_420006[12]", GEARED, "taken as LARGE_NEEDLE_DRIVER:420006[12]"),
    ("LARGE_NEEDLE_DRIVER_420006_3", PLAIN, "taken as LARGE_NEEDLE_DRIVER:420006:3")])
def test_an_underscore_before_the_model_is_accepted_with_a_note(text: str, row: CatalogueRow, note: str) -> None:
    found = find(text, ROWS)
    assert (found.entry, found.note) == (row, note)


@cases(("text", "reason", "candidates"), [
    ("LARGE_NEEDLE_DRIVER:420006", "several versions", ("LARGE_NEEDLE_DRIVER:420006[..11]",
     "LARGE_NEEDLE_DRIVER:420006[12..]")),
    ("LARGE_NEEDLE_DRIVER:420006[10..13]", "no entry covers version [10..13]", ("LARGE_NEEDLE_DRIVER:420006[..11]",
     "LARGE_NEEDLE_DRIVER:420006[12..]")),
    ("SCISSORS:400006", "model 400006 is not called SCISSORS", ("LARGE_NEEDLE_DRIVER:400006",)),
    ("LARGE_NEEDLE_DRIVER:999999", "no instrument of model 999999", ("LARGE_NEEDLE_DRIVER:400006",
     "LARGE_NEEDLE_DRIVER:420006[..11]", "LARGE_NEEDLE_DRIVER:420006[12..]")),
    ("PROGRASP_FORCEPS", "not a name", ("PROGRASP_FORCEPS:400093",)),
    ("LARGE_NEEDLE_DRIVER:420006[x]", "not a name", ("LARGE_NEEDLE_DRIVER:400006",)), ("", "not a name", ())])
def test_what_is_not_clear_is_refused_with_what_may_be_meant(
        text: str, reason: str, candidates: tuple[str, ...]) -> None:
    found = find(text, ROWS)
    assert found.entry is None and found.reason.startswith(reason)
    assert set(found.candidates) >= set(candidates)


def test_two_instruments_of_one_model_need_a_name() -> None:
    found = find(":400117", (*ROWS, OWN))
    assert found.entry is None and "several instruments" in found.reason
    assert find("OWN:400117", (*ROWS, OWN)).entry is OWN


@given(st.one_of(st.text(max_size=40), st.text(alphabet="A_:[].0123456789", max_size=30)))
def test_any_text_is_answered(text: str) -> None:
    found = find(text, ROWS)
    assert (found.entry is None) == bool(found.reason)
    assert len(found.candidates) <= CANDIDATES and len(found.reason) < 160


versions = st.one_of(st.none(), st.integers(0, 255))


@given(st.from_regex(r"[A-Z0-9][A-Z0-9_ -]{0,20}[A-Z]", fullmatch=True), st.integers(0, 999_999), versions, versions)
def test_the_full_name_of_an_entry_finds_it(name: str, number: int, low: int | None, high: int | None) -> None:
    if low is not None and high is not None and high < low:
        low, high = high, low
    row = CatalogueRow((name,), f"{number:06d}", low, high)
    assert find(full_name(row), (row,)).entry is row


@given(st.integers(0, 255))
def test_every_version_of_a_memory_finds_one_entry(version: int) -> None:
    found = find(f"LARGE_NEEDLE_DRIVER:420006[{version}]", ROWS)
    assert found.entry is (PLAIN if version <= 11 else GEARED)


def test_versions_are_told_as_they_are_written() -> None:
    asked = taken_apart("A:1[3..]")
    assert asked is not None and asked.version == "[3..]"
    asked = taken_apart("A:1:3")
    assert asked is not None and asked.version == "[3]"
    asked = taken_apart("A:1")
    assert asked is not None and asked.version == ""
