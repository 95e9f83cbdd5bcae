"""What several tests of the tools begin with."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.tools.peeking import STRICT, Peek, build, running


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reader in C, compiled once."""
    return build(tmp_path_factory.mktemp("peek"), *STRICT)


@pytest.fixture
def peek(program: Path) -> Peek:
    """The reader in C as a function of its words."""
    return running(program)
