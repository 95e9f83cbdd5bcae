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

Mistakes are operators of cosmic-ray (one of another sort for an arithmetic operator, another comparison, a condition
turned round, and for or, true for false, break for continue, a number one more or less, a loop or a decorator left
out) and one of our own: a call or an assignment to an attribute or element left out. First a line is drawn, then one
of its mistakes, so that a comparison weighs no more than a call.

Not drawn is what cannot matter or always fails:
- texts (cosmic-ray leaves them alone), what is formatted into them, docstrings, `assert`;
- annotations, but for the ranges in the models of files, which pydantic reads; what only type checkers see;
- numbers of 1000 and more (one more is less than any tolerance), and `*` and `/` between parameters;
- `==` for `is` and the reverse, the same for enumerations; `strict`, `frozen`, `slots`; decorators that save time only;
- what does not compile.
Mutants of EQUIVALENT, each with the reason why nobody can tell the difference, are not tried and not counted.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import difflib
import json
import os
import random
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

import parso
from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider
from parso.tree import BaseNode, NodeOrLeaf

from shm.segment import names_of, segment_name, unlink

ROOT = Path(__file__).resolve().parents[2]
MAX_NUMBER = 1000
LAST = 6.0  # times the budget, for who has survived it
SLOWER = 3.0  # times as long as without a mutant, and
PATIENCE_S = 30.0

MODULES = (
    "procs/io/pid.py", "procs/fpga/velocity.py", "procs/io/safety.py", "procs/io/setpoint_tracker.py",
    "procs/io/power.py", "procs/io/fault_handler.py", "procs/arm/motion.py", "procs/arm/joints.py",
    "procs/arm/effort*.py", "procs/teleop/*.py", "procs/console/*.py", "procs/suj/*.py", "procs/config/read/*.py",
    "procs/config/models/*.py", "procs/config/build/io_checks.py",
)
TESTS = (
    "tests/arm", "tests/config", "tests/console", "tests/io", "tests/lib/test_camera.py",
    "tests/lib/test_given_file.py", "tests/lib/test_pid.py", "tests/lib/test_teleoperation.py",
    "tests/lib/test_velocity.py", "tests/suj", "tests/teleop", "tests/whole",
)

AT_IMPORT = (("procs/config/models/", "tests/config/test_keys.py"),)
"""Tests of what stands in no function of these modules: they run first for that, though they call nothing there."""

EQUIVALENT = {
    ("procs/arm/effort_limits.py", "wider = np.where(self._drives, spread, 0.0).max(axis=1)  # and back to the joints",
     "wider = np.where(self._drives, spread, -1.0).max(axis=1)  # and back to the joints"):
        "every joint has a motor, and nothing is less than 0 there",
    ("procs/arm/efforts.py", "FOR_EVER: Final = 1 << 62  # ns", "FOR_EVER: Final = 1 << 63  # ns"):
        "no clock comes that far",
    ("procs/arm/motion.py", "self.effort[...] = 0.0", "pass"): "read in effort mode only, which sets it each cycle",
    ("procs/console/goovis.py", "if self._file >= 0:", "if self._file >= 1:"): "descriptor 0 is the standard input's",
    ("procs/io/pid.py", "self._dead = bool(np.any(outer > 0.0))", "self._dead = bool(np.any(outer != 0.0))"):
        "no file may have a dead-band below 0",
    ("procs/io/power.py", "NEVER: Final = 1 << 62", "NEVER: Final = 1 >> 62"):
        "unchanged words are looked at each cycle: the same comes out",
    ("procs/suj/joints.py", "self._told = told", "pass"): "what is shown is written again as it is",
    ("procs/teleop/teleoperation.py", "self._first_offset = self.offset", "pass"): "begin sets it before it is read",
    ("procs/suj/setups.py", "self.changes += 1", "self.changes += 2"): "it is only compared with what it was",
}
"""(module, line, line of the mutant) to why nobody can tell the difference. Counted by themselves."""

ARITHMETIC = {"Add": "Sub", "Sub": "Add", "Mul": "Div", "Div": "Mul", "FloorDiv": "Mul", "Mod": "Mul", "Pow": "Mul",
              "RShift": "LShift", "LShift": "RShift", "BitOr": "BitAnd", "BitAnd": "BitOr", "BitXor": "BitOr"}
ORDER = ("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE")
CHOSEN = (
    *(f"ReplaceBinaryOperator_{old}_{new}" for old, new in ARITHMETIC.items()),
    *(f"ReplaceComparisonOperator_{old}_{new}" for old in ORDER for new in ORDER if old != new),
    "ReplaceComparisonOperator_Is_IsNot", "ReplaceComparisonOperator_IsNot_Is",
    *(f"ReplaceUnaryOperator_Delete_{old}" for old in ("Not", "USub", "Invert")),
    "AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "NumberReplacer", "RemoveDecorator", "ZeroIterationForLoop",
)
NO_EFFECT = re.compile(r"@(functools\.)?(lru_)?cache|@(typing\.)?(override|final|overload)|@abstractmethod")
NO_MATTER = re.compile(r"(strict|frozen|slots|kw_only) *= *(True|False)")


class LeaveOut(Operator):
    """A call, or an assignment to an attribute or an element, that is forgotten."""

    def mutation_positions(self, node: NodeOrLeaf) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
        """See cosmic-ray."""
        if node.parent is None or node.parent.type != "simple_stmt":
            return
        called = node.type in ("atom_expr", "power") and node.children[-1].get_code().startswith("(")
        if called or (node.type == "expr_stmt" and node.children[0].type in ("atom_expr", "power")):
            yield node.start_pos, node.end_pos

    def mutate(self, node: NodeOrLeaf, index: int) -> NodeOrLeaf:
        """See cosmic-ray."""
        return parso.parse(node.get_first_leaf().prefix + "pass")


    @classmethod
    def examples(cls) -> tuple[()]:
        """See cosmic-ray."""
        return ()


PROVIDER = OperatorProvider()
OPERATORS: tuple[Operator, ...] = (*(PROVIDER[name]() for name in CHOSEN), LeaveOut())


@dataclass(frozen=True)
class Mutant:
    """One mistake in one module."""

    path: str
    line: int
    code: str  # of the module

    def change(self, source: str) -> list[str]:
        """What differs, for people."""
        rows = difflib.unified_diff(source.splitlines(), self.code.splitlines(), self.path, self.path, "", "", 2, "")
        return list(rows)[1:]

    def equivalent(self, source: str) -> str:
        """Why nobody can tell the difference, "": somebody may."""
        old, new = (text.splitlines()[self.line - 1].strip() for text in (source, self.code))
        return EQUIVALENT.get((self.path, old, new), "")


@dataclass(frozen=True)
class Result:
    """What became of a mutant: killed, survived, timed out or equivalent; the first test that saw it, or why."""

    mutant: Mutant
    fate: str
    test: str = ""


def nodes(tree: NodeOrLeaf) -> Iterator[NodeOrLeaf]:
    """All of a tree, in the order of the text."""
    yield tree
    for child in tree.children if isinstance(tree, BaseNode) else ():
        yield from nodes(child)


def matters(path: str, node: NodeOrLeaf, operator: Operator) -> bool:
    """Whether somebody could notice; the docstring of this module says what is left out."""
    name = type(operator).__name__
    if name == "RemoveDecorator" and NO_EFFECT.match(node.get_code().strip()):
        return False
    if node.type == "number" and (not isinstance(value := eval(node.value), int | float) or abs(value) >= MAX_NUMBER):
        return False
    if node.type == "operator" and node.parent.type in ("parameters", "lambdef"):
        return False
    inner, outer = node, node.parent
    while outer is not None:
        annotated = (outer.type == "tfpdef" or (outer.type == "annassign" and outer.children[1] is inner)
                     or (outer.type == "funcdef" and inner is outer.annotation))
        if annotated and (name.startswith("ReplaceBinary") or not path.startswith("procs/config/models/")):
            return False
        if outer.type in ("fstring", "decorator", "assert_stmt", "raise_stmt"):
            return False
        if outer.type == "argument" and NO_MATTER.fullmatch(outer.get_code().strip()):
            return False
        if outer.type == "if_stmt" and re.match(r"if (TYPE_CHECKING|__name__)", outer.get_code().strip()):
            return False
        inner, outer = outer, outer.parent
    return True


def drawn(path: str, source: str, chance: random.Random) -> Iterator[Mutant]:
    """A module's mutants in random order: each line that has some once, then each a second time, and so on."""
    places: dict[int, list[tuple[int, Operator, int]]] = collections.defaultdict(list)
    for number, node in enumerate(nodes(parso.parse(source))):
        for operator in OPERATORS:
            for index, (begin, _) in enumerate(operator.mutation_positions(node)):
                if matters(path, node, operator):
                    places[begin[0]].append((number, operator, index))
    while places:
        for line in chance.sample(sorted(places), len(places)):
            number, operator, index = places[line].pop(chance.randrange(len(places[line])))
            if not places[line]:
                del places[line]
            mutant = Mutant(path, line, applied(source, number, operator, index))
            with contextlib.suppress(SyntaxError):
                compile(mutant.code, path, "exec")
                yield mutant


def applied(source: str, number: int, operator: Operator, index: int) -> str:
    """The text with one mistake: the operator's `index`-th of node `number`."""
    tree = parso.parse(source)
    node = next(node for at, node in enumerate(nodes(tree)) if at == number)
    siblings, prefix = node.parent.children, node.get_first_leaf().prefix
    place = next(at for at, sibling in enumerate(siblings) if sibling is node)
    new = operator.mutate(node, index)
    if new is None:  # a decorator: its comments and the indentation stay
        siblings[place].get_next_leaf().prefix = prefix
        del siblings[place]
    else:
        siblings[place] = new
    return tree.get_code()


def sample(seed: int, count: int, only: str) -> list[Mutant]:
    """So many mutants; a smaller count is the beginning of a larger one."""
    chance = random.Random(seed)
    sources = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in
               (path for pattern in MODULES for path in sorted(ROOT.glob(pattern)))}
    sources = {path: source for path, source in sources.items() if path.startswith(only) and source}
    waiting = {path: drawn(path, source, random.Random(f"{seed} {path}")) for path, source in sources.items()}
    weights = {path: source.count("\n") for path, source in sources.items()}
    found: list[Mutant] = []
    while waiting and len(found) < count:
        path = chance.choices(list(waiting), [weights[path] for path in waiting])[0]
        mutant = next(waiting[path], None)
        if mutant is None:
            del waiting[path]
        else:
            found.append(mutant)
    return found


class Copy:
    """A copy of the tree in which tests run; a context manager, it takes everything away again."""

    def __init__(self, folder: Path) -> None:
        self.root = folder
        listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, capture_output=True,
                                text=True, check=True)
        for name in filter(None, listed.stdout.split("\0")):
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)

    def run(self, arguments: Sequence[str], longest_s: float) -> tuple[str, str]:
        """What became of the tests, and the first that failed."""
        command = [sys.executable, "-m", "pytest", "-m", "not slow", "-q", "-p", "no:cacheprovider", "-rfE", *arguments]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1",
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

        What stands in no function is used by all that call any of the module's, or where it has none of its folder's;
        tests of AT_IMPORT come first.
        """
        line = function_at(compile(source, mutant.path, "exec"), mutant.line)
        folder = str(Path(mutant.path).parent.parent)
        users = [(seconds, test) for test, (seconds, called) in self._found.items()
                 if (line in called.get(mutant.path, ()) if line else mutant.path in called)]
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
