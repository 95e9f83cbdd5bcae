"""Examples of docs/write-a-process.md where what they talk to goes away; whole they run in tests/system."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.user.test_process import Mine
from tests.user.test_process import make as make  # a fixture

PAGE = (Path(__file__).parents[2] / "docs/write-a-process.md").read_text(encoding="utf-8")


def of_the_page(name: str) -> Any:
    """The class of this name on the page."""
    program = next(text for text in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if f"class {name}(" in text)
    module: dict[str, Any] = {"__name__": "a page"}
    exec(program, module)
    return module[name]


def test_the_sensor_ends_with_an_error_when_its_line_hangs_up(
        make: Callable[..., Mine], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_SENSOR", "/dev/null")
    with pytest.raises(OSError, match="/dev/null has hung up"):
        make(type("Sensor", (of_the_page("Sensor"),), {"check_commands": lambda _: None})).run()  # declares nothing
