"""Model searches that have passed on these very sources do not run again at a desk; in a fresh clone all of them run.

`-m searches` runs them in any case.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

import pytest

MARK = "searches"
KEY = "trocar/searches"  # of pytest's cache: by test, the digest on which it passed last
ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("shm/**/*.py", "tests/shm/**/*.py", "tests/shm/models/*")


def digest() -> str:
    """Of all that a search depends on."""
    found = hashlib.sha256()
    for path in sorted(path for pattern in SOURCES for path in ROOT.glob(pattern)):
        found.update(path.name.encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def done(config: pytest.Config, items: Iterable[pytest.Item]) -> list[pytest.Item]:
    """Those of the items that need not run."""
    if MARK in config.option.markexpr or not hasattr(config, "cache"):
        return []
    passed, now = config.cache.get(KEY, {}), digest()
    return [item for item in items if item.get_closest_marker(MARK) and passed.get(item.nodeid) == now]


def remember(config: pytest.Config, passed: Iterable[str]) -> None:
    """These have passed."""
    if hasattr(config, "cache") and not hasattr(config, "workerinput"):
        config.cache.set(KEY, config.cache.get(KEY, {}) | dict.fromkeys(passed, digest()))
