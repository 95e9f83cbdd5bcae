"""docs/errors.md is the table of faults."""

from __future__ import annotations

from procs.lib.faults import FAULTS
from tools import errors_page


def test_the_page_is_as_the_table_says() -> None:
    assert errors_page.PAGE.read_text(encoding="utf-8") == errors_page.page(), "stale: run python -m tools.errors_page"


def test_every_fault_has_its_cause_and_remedy() -> None:
    text = errors_page.page()
    for fault in FAULTS:
        assert f"| {fault.number} | [`{fault.code}`]" in text
        assert f"- Cause: {fault.text}\n- Remedy: {fault.hint}\n" in text


def test_the_check_tells_a_stale_page(tmp_path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(errors_page, "PAGE", tmp_path / "errors.md")
    assert errors_page.main(["--check"]) == 1 and "stale" in capsys.readouterr().out
    assert errors_page.main([]) == 0 and errors_page.main(["--check"]) == 0
