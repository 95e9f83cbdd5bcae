"""Skips that CI allows. There any other one fails the run, so that no test is left out unseen."""

from __future__ import annotations

import os
import re
from typing import Final

import pytest

STRICT: Final = "TROCAR_SKIPS"
"""In the environment, `strict`: as in CI."""
ALLOWED: Final = (
    r"runs in the namespace of the conformance test|this is the namespace",  # tests/io/test_port_conformance.py
    r"another kind of potentiometer",
    r"no package of ruckig for this machine",
    r"no native library: .*TROCAR_NATIVE",  # the pass on numpy
    r"needs four cores",
)
found: set[str] = set()
"""Reasons that are not allowed, with their tests."""


def note(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Look at a report."""
    if not report.skipped or hasattr(report, "wasxfail"):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if not any(re.search(each, reason) for each in ALLOWED):
        found.add(f"{report.nodeid}: {reason}")


def are_too_many() -> bool:
    """Whether the run fails for them."""
    return bool(found) and os.environ.get(STRICT) == "strict"
