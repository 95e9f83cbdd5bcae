import re

from trocar.procs.node.fault_report import fault_of, figures
from trocar.procs.tables.code_row import NOTHING, WARNING
from trocar.procs.tables.codes import FAULTS


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


def test_a_value_has_as_many_digits_as_tell_it_from_its_limit_and_no_noise() -> None:
    fault = next(row for row in FAULTS if row.unit)
    for value, shown in ((0.5, "0.5 s,"), (0.50001, "0.50001 s,"), (0.030000015, "just above 0.03 s,"),
                         (0.029999999, "just below 0.03 s,")):
        assert figures(fault, value, round(value, 2), "s").startswith(shown)
