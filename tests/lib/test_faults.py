import re

from procs.codes import FAULTS, NOTHING, WARNING
from procs.faults import fault_of


def test_numbers_and_codes_are_unique() -> None:
    assert len({row.number for row in FAULTS}) == len({row.code for row in FAULTS}) == len(FAULTS)
    assert all(row.number > 0 for row in FAULTS)


def test_texts_fit_their_event() -> None:
    for row in FAULTS:
        assert len(row.code) <= 32 and re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", row.code)
        assert len(f"{row.cause}; {row.remedy}") <= 200


def test_warnings_switch_nothing_off() -> None:
    assert all(row.action == NOTHING for row in FAULTS if row.severity == WARNING)


def test_a_fault_is_found_by_its_number() -> None:
    assert all(fault_of(row.number) is row for row in FAULTS)
    assert fault_of(0) is None
