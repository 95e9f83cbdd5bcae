"""The compiled kernel switched off for a while, to measure what numpy takes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from trocar.procs.native.library import SWITCH, kernel


@contextmanager
def without_kernel() -> Iterator[None]:
    """What is made or started meanwhile has numpy do its work."""
    before = os.environ.get(SWITCH)
    os.environ[SWITCH] = "0"
    kernel.cache_clear()
    try:
        yield
    finally:
        del os.environ[SWITCH]
        if before is not None:
            os.environ[SWITCH] = before
        kernel.cache_clear()
