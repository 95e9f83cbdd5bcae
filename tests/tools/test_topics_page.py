"""docs/topics.md is the topic table."""

from __future__ import annotations

from trocar.shm.topics import TOPICS
from trocar.tools.pages import topics as topics_page
from trocar.tools.pages.generated import keep


def test_the_page_is_as_the_table_says() -> None:
    assert topics_page.PAGE.read_text(encoding="utf-8") == topics_page.page()


def test_every_field_has_a_line() -> None:
    text = topics_page.page()
    assert all(f"| `{f.name}` | `{f.dtype}` |" in text for topic in TOPICS for f in topic.fields)
    assert all(f"| `{v.name}`" in text for topic in TOPICS for v in topic.views)


def test_the_check_tells_a_stale_page(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    page, text = tmp_path / "topics.md", topics_page.page()
    assert keep(page, text, ["--check"]) == 1 and "stale" in capsys.readouterr().out
    assert keep(page, text, []) == 0 and keep(page, text, ["--check"]) == 0
