"""Nothing is collected while many modules are imported, and later collections skip them."""

from __future__ import annotations

import gc

import pytest

from trocar.procs.machine.imports import many_imports


def test_nothing_is_collected_meanwhile_and_what_was_made_is_skipped_later() -> None:
    frozen = gc.get_freeze_count()
    try:
        with many_imports():
            assert not gc.isenabled()
            made: list[list[int]] = [[] for _ in range(1000)]
        assert gc.isenabled()
        assert gc.get_freeze_count() >= frozen + len(made)
    finally:
        gc.unfreeze()


def test_a_module_that_cannot_be_imported_leaves_collections_on() -> None:
    with pytest.raises(ImportError), many_imports():
        raise ImportError
    assert gc.isenabled()
    gc.unfreeze()
