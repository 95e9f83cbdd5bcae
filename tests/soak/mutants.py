"""The mutation sampler: which share of small random mistakes in the code does the quick part of the suite see?

    pip install -e .[dev,mutants] -c constraints.txt
    python -m tests.soak.mutants --seed 1 --count 200

draws that many mutants of the modules in MODULES, the longer a module the more, tries each with quick tests in a copy
of the tree, and prints what became of it, the survivors with their change. A mutant is killed
when a test fails or the tests take much longer than without it. `--only procs/teleop` draws in some modules,
`--again FILE` tries the survivors of an earlier output, `--list` draws and tries nothing. Exit code 1: below `--least`.

Which tests a mutant meets: all of TESTS run once, and it is noted which functions each calls (`tests.soak.called`;
`--calls FOLDER` keeps that for the next time). Of those that call the function with the mistake the quickest run, up to
`--budget` seconds together; who survives them meets the next ones, up to six times as long.

Which mistakes are drawn, and which are not: `tests.soak.mistakes`. Tests run without the native library: what is tried
is the code in Python.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from inspect import CO_OPTIMIZED
from itertools import accumulate
from pathlib import Path
from queue import SimpleQueue
from types import CodeType

from tests.soak.mistakes import ROOT, Mutant, sample
from trocar.shm.memory.segment import names_of, segment_name, unlink

LAST = 6.0  # times the budget, for who has survived it
SLOWER = 3.0  # times as long as without a mutant, and
PATIENCE_S = 30.0

TESTS = (
    "tests/arm", "tests/config", "tests/console", "tests/io", "tests/machine/test_given_file.py",
    "tests/fpga/test_velocity.py", "tests/soak/test_judge.py", "tests/suj", "tests/teleop", "tests/whole",
)

AT_IMPORT = (("procs/config/models/", "tests/config/test_keys.py"),)
"""Tests of what stands in no function of these modules: they run first for that, though they call nothing there."""


@dataclass(frozen=True)
class Result:
    """What became of a mutant: killed, survived, timed out or equivalent; the first test that saw it, or why."""

    mutant: Mutant
    fate: str
    test: str = ""


class Copy:
    """A copy of the tree in which tests run; a context manager, it takes everything away again."""

    def __init__(self, folder: Path) -> None:
        self.root = folder
        listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, capture_output=True,
                                text=True, check=True)
        for name in filter(None, listed.stdout.split("\0")):
            if (ROOT / name).is_file() or (ROOT / name).is_symlink():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)

    def run(self, arguments: Sequence[str], longest_s: float) -> tuple[str, str]:
        """What became of the tests, and the first that failed."""
        command = [sys.executable, "-m", "pytest", "-m", "not slow", "-q", "-p", "no:cacheprovider", "-rfE", *arguments]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "TROCAR_NATIVE": "0",
                       "TROCAR_TEST_DATA": os.environ.get("TROCAR_TEST_DATA", str(ROOT.parent / "shared" / "data"))}
        child = subprocess.Popen(command, cwd=self.root, env=environment, text=True, start_new_session=True,
                                 stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        try:
            out, _ = child.communicate(timeout=longest_s)
            fate = "survived" if child.returncode == 0 else "killed"
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            out, _ = child.communicate()
            fate = "timed out"
        for parts in names_of():
            if re.match(rf"t{child.pid}[x-]", parts[0]):
                unlink(segment_name(*parts))
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", out, re.MULTILINE)
        return fate, failed[1] if failed else out.strip()[-300:] if fate == "killed" else ""

    def attempt(self, mutant: Mutant, tests: Sequence[tuple[float, str]]) -> Result:
        """Run the tests, with their times, over a mutant, and put the module back."""
        path, longest_s = self.root / mutant.path, SLOWER * sum(seconds for seconds, _ in tests) + PATIENCE_S
        source = path.read_text(encoding="utf-8")
        try:
            self._write(path, mutant.code)
            if not tests:
                return Result(mutant, "survived", "no test calls it")
            return Result(mutant, *self.run(["-x", *(test for _, test in tests)], longest_s))
        finally:
            self._write(path, source)

    def _write(self, path: Path, code: str) -> None:
        """Python takes compiled code for that of a text of the same size and second."""
        path.write_text(code, encoding="utf-8")
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            compiled.unlink(missing_ok=True)


class Calls:
    """Which tests call what, and how long they take."""

    def __init__(self, found: Mapping[str, tuple[float, Mapping[str, Sequence[int]]]]) -> None:
        """As `tests.soak.called` has it."""
        self._found = found

    @classmethod
    def of(cls, folder: Path, copy: Copy, workers: int) -> Calls:
        """Read from a folder; filled first, by running all tests, when there is nothing in it."""
        if not any(folder.glob("*.json")):
            folder.mkdir(parents=True, exist_ok=True)
            print("looking which test calls what", flush=True)
            look = ["-p", "tests.soak.called", "--called", str(folder), "-n", str(workers)]
            fate, test = copy.run([*look, *TESTS], 3600.0)
            if fate != "survived":
                sys.exit(f"tests fail without a mutant: {test or fate}")
        files = sorted(folder.glob("*.json"))
        return cls({test: row for file in files for test, row in json.loads(file.read_text()).items()})

    def tests(self, mutant: Mutant, source: str, budget_s: float) -> list[tuple[float, str]]:
        """The quickest tests that call the function in which the mistake is, as many as fit, with their times.

        What stands in no function, or in one that is called at import only, is used by all that call any of the
        module's, or where it has none of its folder's; tests of AT_IMPORT come first.
        """
        line = function_at(compile(source, mutant.path, "exec"), mutant.line)
        folder = str(Path(mutant.path).parent.parent)
        users = [(seconds, test) for test, (seconds, called) in self._found.items()
                 if line in called.get(mutant.path, ())]
        if not users:
            line, users = 0, [(seconds, test) for test, (seconds, called) in self._found.items()
                              if mutant.path in called]
        if not line and not users:
            users = [(seconds, test) for test, (seconds, called) in self._found.items()
                     if any(path.startswith(folder) for path in called)]
        first = [file for start, file in AT_IMPORT if not line and mutant.path.startswith(start)]
        chosen, total = [(PATIENCE_S, file) for file in first], 0.0
        for seconds, test in sorted(users):
            total += seconds
            if chosen and total > budget_s:
                break
            chosen.append((seconds, test))
        return chosen


def function_at(code: CodeType, line: int) -> int:
    """First line of the innermost function with a name that a line is in, 0: of none."""
    found = code.co_firstlineno if code.co_flags & CO_OPTIMIZED and code.co_name.isidentifier() and (
        line in {row for _, _, row in code.co_lines()} | {code.co_firstlineno}) else 0
    return max([found, *(function_at(inner, line) for inner in code.co_consts if isinstance(inner, CodeType))])


def tried(mutants: list[Mutant], workers: int, calls: Path | None, budget_s: float) -> Iterator[Result]:
    """Results in the order of the mutants."""
    with tempfile.TemporaryDirectory(prefix="trocar-mutants-") as folder:
        free: SimpleQueue[Copy] = SimpleQueue()
        copies = [Copy(Path(folder) / str(number)) for number in range(workers)]
        for copy in copies:
            free.put(copy)
        known = Calls.of(calls or Path(folder) / "calls", copies[0], workers)

        def attempt(mutant: Mutant) -> Result:
            source = (ROOT / mutant.path).read_text(encoding="utf-8")
            if reason := mutant.equivalent(source):
                return Result(mutant, "equivalent", reason)
            tests = known.tests(mutant, source, LAST * budget_s)
            first = sum(total <= budget_s for total in accumulate(seconds for seconds, _ in tests)) or 1
            copy = free.get()
            try:
                result = copy.attempt(mutant, tests[:first])
                return copy.attempt(mutant, tests[first:]) if result.fate == "survived" and tests[first:] else result
            finally:
                free.put(copy)

        with ThreadPoolExecutor(workers) as pool:
            yield from pool.map(attempt, mutants)


def main() -> int:
    """Draw, try, print."""
    parser = argparse.ArgumentParser(description="which share of random mistakes do the quick tests see?")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--least", type=float, default=0.92, help="share that has to be killed")
    parser.add_argument("--only", default="", help="modules whose path begins so")
    parser.add_argument("--again", type=Path, help="only the survivors of this earlier output")
    parser.add_argument("--calls", type=Path, help="folder that keeps which test calls what")
    parser.add_argument("--budget", type=float, default=20.0, help="s of tests for a mutant")
    parser.add_argument("--list", action="store_true", help="draw, but try nothing")
    options = parser.parse_args()
    os.nice(19)
    mutants = sample(options.seed, options.count, options.only)
    numbered = dict(enumerate(mutants, 1))
    if options.again:
        survived = {int(number) for number in re.findall(r"^ *(\d+) survived", options.again.read_text(), re.MULTILINE)}
        numbered = {number: mutant for number, mutant in numbered.items() if number in survived}
    if options.list:
        for number, mutant in numbered.items():
            print_change(number, mutant)
        return 0
    counts: collections.Counter[str] = collections.Counter()
    results = tried(list(numbered.values()), options.workers, options.calls, options.budget)
    for number, result in zip(numbered, results, strict=True):
        counts[result.fate] += 1
        print(f"{number:4d} {result.fate:10s} {result.mutant.path}:{result.mutant.line} {result.test}", flush=True)
        if result.fate == "survived":
            print_change(number, result.mutant)
    share = 1.0 - counts["survived"] / max(counts.total() - counts["equivalent"], 1)
    print(f"seed {options.seed}: {counts.total()} mutants, " + ", ".join(f"{n} {fate}" for fate, n in counts.items())
          + f": {share:.1%} seen")
    return int(share < options.least)


def print_change(number: int, mutant: Mutant) -> None:
    """For people."""
    source = (ROOT / mutant.path).read_text(encoding="utf-8")
    print("\n".join(f"     {number} | {row}" for row in mutant.change(source)[1:]), flush=True)


if __name__ == "__main__":
    sys.exit(main())
