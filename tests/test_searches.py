"""Which searches run again."""

from __future__ import annotations

import pytest

from tests import searches

pytest_plugins = ["pytester"]
SEARCH = """
import pytest
from pathlib import Path

@pytest.mark.searches
def test_search(): Path("ran").write_text(Path("ran").read_text() + "x")
"""
CONFTEST = """
import sys
sys.path.insert(0, {root!r})
from tests.conftest import pytest_collection_modifyitems, pytest_runtest_logreport, pytest_sessionfinish
"""


@pytest.fixture
def desk(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makeini("[pytest]\nmarkers = searches\n slow\n soak\n peers")
    pytester.makeconftest(CONFTEST.format(root=str(searches.ROOT)))
    pytester.makepyfile(test_it=SEARCH)
    (pytester.path / "ran").write_text("")
    return pytester


def ran(desk: pytest.Pytester, *arguments: str) -> str:
    desk.runpytest_subprocess(*arguments)
    return (desk.path / "ran").read_text()


@pytest.mark.slow
def test_a_search_that_passed_runs_again_by_name_or_when_its_sources_have_changed(desk: pytest.Pytester) -> None:
    assert ran(desk) == "x"
    assert ran(desk) == "x", "it has passed"
    assert ran(desk, "-m", "searches") == "xx"
    cache = desk.path / ".pytest_cache" / "v" / searches.KEY
    cache.write_text(cache.read_text().replace(searches.digest(), "another"))
    assert ran(desk) == "xxx"
