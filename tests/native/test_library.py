"""How the native library is compiled, found and believed; and that everything else runs without it, and says why."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from trocar.procs.native import build, library, sources
from trocar.procs.native.bound import BindError, BoundStruct
from trocar.procs.native.fields import CStruct, places, rows
from trocar.procs.native.library import SWITCH

ROOT = Path(__file__).resolve().parents[2]
ASK = "from trocar.procs.native.library import native; print(native().why or 'compiled')"
POINT = CStruct("Point", (*rows("i8", "", n="size"), *rows("f8", "n", x="x"), *rows("u2", "2 n", counts="counts")), {})
PLACED = CStruct("Placed", (*rows("i8", "", n="size"), *places("2", "2 n", at="at")), {})


class Points:
    def __init__(self) -> None:
        self.size, self.x, self.counts = 3, np.zeros(3), np.zeros((2, 3), np.uint16)


def asked(**environment: str) -> str:
    """What a fresh interpreter says of the native library."""
    done = subprocess.run([sys.executable, "-c", ASK], cwd=ROOT, env={**os.environ, **environment}, text=True,
                          capture_output=True, timeout=60, check=True)
    return done.stdout.strip()


def test_a_struct_holds_numbers_and_addresses() -> None:
    source = Points()
    bound = BoundStruct(ctypes.PyDLL(None), POINT, source)
    memory = POINT.ctype.from_address(bound.address)
    assert (memory.n, memory.x, memory.counts) == (3, source.x.ctypes.data, source.counts.ctypes.data)
    assert bound.moved() == []
    source.x[...] = 1.0
    assert bound.moved() == []
    source.x = np.zeros(3)
    source.size = 4
    assert bound.moved() == ["n", "x"]


@pytest.mark.parametrize(("name", "value", "wrong"), [
    ("x", np.zeros(4), "Point.x (x) is float64 (4,), not float64 (3,)"),
    ("x", np.zeros(3, np.float32), "Point.x (x) is float32 (3,), not float64 (3,)"),
    ("x", np.zeros(6)[::2], "Point.x (x) does not lie in one piece"),
    ("counts", np.zeros((3, 2), np.uint16), "Point.counts (counts) is uint16 (3, 2), not uint16 (2, 3)"),
    ("x", np.frombuffer(bytes(25)[1:], np.uint8)[:24].view(np.uint8), "Point.x (x) is uint8 (24,), not float64 (3,)"),
])
def test_an_array_that_is_not_as_its_row_says_is_refused_by_name(name: str, value: np.ndarray, wrong: str) -> None:
    source = Points()
    setattr(source, name, value)
    with pytest.raises(BindError) as error:
        BoundStruct(ctypes.PyDLL(None), POINT, source)
    assert str(error.value) == wrong


@pytest.mark.parametrize(("at", "is_fine"), [((0, 5), True), ((-1, 5), False), ((0, 6), False)])
def test_places_beyond_their_array_are_refused_for_c_looks_at_no_bounds(at: tuple[int, int], is_fine: bool) -> None:
    source = Points()
    source.at = np.array(at)
    if is_fine:
        BoundStruct(ctypes.PyDLL(None), PLACED, source)
        return
    with pytest.raises(BindError, match=r"Placed\.at \(at\) has places beyond 2 x n"):
        BoundStruct(ctypes.PyDLL(None), PLACED, source)


def test_the_header_is_what_c_needs() -> None:
    header = sources.header()
    assert POINT.declarations.splitlines()[:4] == ["typedef struct {", "  int64_t n;", "  double *x;  // (n)",
                                                   "  uint16_t *counts;  // (2, n)"]
    assert "#define NATIVE_SIZES sizeof(Io), " in header
    assert "int64_t Io_control_and_encode(const Io *k, double, int64_t);" in header


def test_the_switch_turns_it_off() -> None:
    assert asked(**{SWITCH: "0"}) == "TROCAR_NATIVE is 0"


@pytest.mark.slow
def test_a_file_that_is_no_library_is_not_believed(tmp_path: Path) -> None:
    file = tmp_path / "native.so"
    file.write_bytes(b"\x7fELF" + bytes(200))
    assert asked(**{SWITCH: str(file)}).startswith("native.so cannot be loaded: ")
    assert asked(**{SWITCH: str(tmp_path / "absent.so")}).startswith("it is not compiled")


@pytest.mark.slow
def test_a_library_of_other_sources_is_not_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if library.native().library is None:
        pytest.skip("no compiler here")
    monkeypatch.setattr(build, "source_hash", lambda: 12345)
    build.build(tmp_path / "other.so")
    assert asked(**{SWITCH: str(tmp_path / "other.so")}) == "other.so was made from other sources"


def test_without_a_compiler_building_ends_in_one_line(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "trocar.procs.native.build"], cwd=ROOT, text=True, capture_output=True,
                          env={**os.environ, "CC": str(tmp_path / "no-compiler")}, timeout=60, check=False)
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "apt-get install gcc" in done.stderr
    assert done.stderr.startswith("trocar: the native library could not be compiled, numpy does its work: ")
