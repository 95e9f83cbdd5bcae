"""docs/topics.md is the topic table."""

from __future__ import annotations

from trocar.shm.topics import TOPICS
from trocar.tools.pages import topics as topics_page


def test_the_page_is_as_the_table_says() -> None:
    assert topics_page.PAGE.read_text(encoding="utf-8") == topics_page.page()


def test_every_field_has_a_line() -> None:
    text = topics_page.page()
    assert all(f"| `{f.name}` | `{f.dtype}` |" in text for topic in TOPICS for f in topic.fields)
    assert all(f"| `{v.name}`" in text for topic in TOPICS for v in topic.views)


def test_the_check_tells_a_stale_page(tmp_path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(topics_page, "PAGE", tmp_path / "topics.md")
    assert topics_page.main(["--check"]) == 1 and "stale" in capsys.readouterr().out
    assert topics_page.main([]) == 0 and topics_page.main(["--check"]) == 0
