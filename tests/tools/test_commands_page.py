"""docs/commands.md is the command table."""

from __future__ import annotations

from trocar.shm.commands import COMMANDS
from trocar.tools.pages import commands as commands_page


def test_the_page_is_as_the_table_says() -> None:
    assert commands_page.PAGE.read_text(encoding="utf-8") == commands_page.page(), \
        f"stale: run python -m {commands_page.__name__}"


def test_every_command_has_a_line() -> None:
    text = commands_page.page()
    assert all(f"| `{row.name}`" in text and row.doc in text for rows in COMMANDS.values() for row in rows)
