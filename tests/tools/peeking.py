"""The reader in C under test: compiled, run, and what it prints understood."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.ring import RingWriter
from trocar.shm.system.directory import create_ring
from trocar.shm.topics import Field, Topic

SOURCE = Path(__file__).resolve().parents[2] / "tools" / "peek.c"
STRICT = ("-std=c11", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror")
VALUE = re.compile(r'(\S+?)=(\[(?:"[^"]*"|[^]"])*\]|"[^"]*"|\S+)')
NUMBER = Topic("number", "io", (Field("value", "<i8", "", ""), Field("text", "S8", "", "")), depth=4)
Peek = Callable[..., subprocess.CompletedProcess[str]]


def build(folder: Path, *options: str) -> Path:
    """Peek, compiled; the test is skipped where there is no gcc."""
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("there is no gcc on this machine")
    done = subprocess.run([gcc, *options, "-o", str(folder / "peek"), str(SOURCE)], capture_output=True, text=True,
                          check=False)
    if "cannot find" in done.stderr and "san" in done.stderr:
        pytest.skip("this gcc has no sanitizers")
    assert done.returncode == 0 and not done.stderr, done.stderr
    return folder / "peek"


def running(program: Path) -> Peek:
    """The program as a function of its words."""

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([program, *words], capture_output=True, encoding="utf-8", errors="surrogateescape",
                              timeout=30, check=False)

    return run


def number_ring(system: str) -> str:
    """Name of a new ring of NUMBER that holds the records 4, 5 and 6."""
    create_ring(system, "io", NUMBER, {}, {"kind": "io"})
    name = segment_name(system, "io", "number")
    with Segment(name, write=True) as segment:
        writer = RingWriter(segment, "io")
        for i in range(1, 7):
            writer.field("value")[...] = 100 + i
            writer.field("text")[...] = b'a"\\\n'
            writer.publish(1000 + i)
    return name


def fields_of(line: str) -> tuple[int, int, dict[str, str]]:
    """A line of peek: sequence, stamp, and the texts of the values."""
    sequence, stamp, rest = [*line.split(" ", 2), ""][:3]
    return int(sequence), int(stamp), dict(VALUE.findall(rest))


def read_back(text: str, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Any:
    """What peek printed of a field, as the array it came from."""
    assert text.startswith("[") == bool(shape)
    if dtype.kind == "S":
        raw = [re.sub(rb"\\x(..)", lambda m: bytes([int(m[1], 16)]), word.encode("utf-8", "surrogateescape"))
               for word in re.findall(r'"([^"]*)"', text)]
        return np.array(raw, dtype).reshape(shape)
    words = [word for word in text.strip("[]").split(",") if word]
    if dtype.str == "<f2":
        return np.array([int(word) for word in words], np.uint16).view(dtype).reshape(shape)
    convert: Callable[[str], Any] = float if dtype.kind == "f" else int
    return np.array([convert(word) for word in words], dtype).reshape(shape)


def refused(done: subprocess.CompletedProcess[str], why: str) -> bool:
    """One line that says why, nothing else."""
    assert (done.returncode, done.stdout) == (1, ""), done
    assert re.fullmatch(rf"peek: /trocar~\S+: .*({why}).*\n", done.stderr), done.stderr
    return True
