"""A page of docs/ that is made from a table: written, or with --check compared."""

from __future__ import annotations

from pathlib import Path


def keep(page: Path, text: str, words: list[str]) -> int:
    """Write `text` as `page`; with --check report whether it is stale, and return 1 if it is."""
    if words == ["--check"]:
        fresh = page.exists() and page.read_text(encoding="utf-8") == text
        print(f"{page.name} is {'up to date' if fresh else f'stale: python -m trocar.tools.pages.{page.stem}'}")
        return 0 if fresh else 1
    page.write_text(text, encoding="utf-8")
    return 0
