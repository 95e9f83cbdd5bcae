"""Imports of many modules at the start of a process."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def many_imports() -> Iterator[None]:
    """No garbage collection meanwhile: imports make little garbage. Later collections skip the imported modules.

    So a forked process shares their memory for longer: a collection would touch, and so copy, it.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
