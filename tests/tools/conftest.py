"""What several tests of the tools begin with."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer.testing

from tests.tools.peeking import STRICT, Peek, build, running


@pytest.fixture(scope="session", autouse=True)
def verbs_are_made_once() -> Iterator[None]:
    """Typer's runner makes all commands of a program anew for each that is run, which takes longer than most."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", functools.cache(typer.testing._get_command))
        yield


@pytest.fixture(scope="session")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reader in C, compiled once."""
    return build(tmp_path_factory.mktemp("peek"), *STRICT)


@pytest.fixture
def peek(program: Path) -> Peek:
    """The reader in C as a function of its words."""
    return running(program)
