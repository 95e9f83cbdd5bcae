"""Which searches run again."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import searches
from tests.cases import cases

pytest_plugins = ["pytester"]
SEARCH = """
import pytest
import tests.searched

@pytest.mark.searches
def test_search(): assert tests.searched.RIGHT
"""
CONFTEST = """
import sys
from pathlib import Path
sys.path[:0] = [{root!r}]
from tests.conftest import (pytest_collection_modifyitems, pytest_runtest_logreport, pytest_sessionfinish,
                            pytest_terminal_summary)
from tests import searches
import tests
tests.__path__.append(str(Path(__file__).parent / "tests"))
searches.ROOT = Path(__file__).parent
searches.STAMP = searches.ROOT / "searches.stamp"
"""


@pytest.fixture
def desk(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makeini("[pytest]\nmarkers = searches\n slow\n soak\n peers")
    pytester.makeconftest(CONFTEST.format(root=str(searches.ROOT)))
    pytester.makepyfile(test_it=SEARCH)
    (pytester.mkdir("tests") / "searched.py").write_text("RIGHT = True")
    return pytester


def ran(desk: pytest.Pytester, *arguments: str) -> tuple[dict[str, int], str]:
    """The outcomes, and what was said of searches."""
    done = desk.runpytest_subprocess(*arguments)
    return done.parseoutcomes(), " ".join(line for line in done.outlines if line.startswith("searches"))


@pytest.mark.slow
def test_searches_that_passed_run_again_by_name_or_when_what_they_import_has_changed(
    desk: pytest.Pytester, monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(searches.APART, raising=False)
    source = desk.path / "tests" / "searched.py"
    outcomes, said = ran(desk)
    assert outcomes == {"passed": 1} and "test_it.py" in said and "have changed" in said, "only -m searches stamps"
    assert ran(desk, "-m", "searches")[0] == {"passed": 1}
    outcomes, said = ran(desk)
    assert outcomes == {"deselected": 1} and "left out" in said and "test_it.py" in said
    monkeypatch.setenv(searches.APART, "apart")
    source.write_text("RIGHT = False")
    assert ran(desk)[0] == {"deselected": 1}, "CI runs them by themselves"
    assert ran(desk, "-m", "searches")[0] == {"failed": 1}
    monkeypatch.delenv(searches.APART)
    assert ran(desk)[0] == {"failed": 1}, "a search that failed is not stamped"


def test_what_a_search_reads_counts_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searches, "ROOT", tmp_path)
    search, near, far, other = (f"tests/shm/{name}.py" for name in ("test_models", "near", "far", "other"))
    texts = {search: "from tests.shm import near", near: "import tests.shm.far\nfrom trocar.shm.topics import SETPOINT",
             far: "", other: "", "shm/topics.py": "", "tests/shm/models/ring.pml": ""}
    for path, text in texts.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)

    def counts(path: str) -> bool:
        before = searches.digest.__wrapped__(search)
        (tmp_path / path).write_text(texts[path] + "\n")
        return before != searches.digest.__wrapped__(search)

    assert {path for path in texts if counts(path)} == {search, near, far, "tests/shm/models/ring.pml"}


@cases("path", sorted(searches.stamped()))
def test_a_stamp_belongs_to_a_file_of_searches(path: str) -> None:
    assert "pytest.mark.searches" in (searches.ROOT / path).read_text()
