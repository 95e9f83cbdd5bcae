"""Small mistakes in the modules of MODULES, drawn at random: see tests.soak.mutants, which tries them.

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

import collections
import contextlib
import difflib
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import parso
from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider
from parso.tree import BaseNode, NodeOrLeaf

ROOT = Path(__file__).resolve().parents[2]
MAX_NUMBER = 1000

MODULES = (
    "procs/io/pid.py", "procs/fpga/velocity.py", "procs/io/safety.py", "procs/io/setpoint_tracker.py",
    "procs/io/power.py", "procs/io/fault_handler.py", "procs/arm/motion.py", "procs/arm/joints.py",
    "procs/arm/governor.py", "procs/node/streams.py", "tests/soak/judge.py",
    "procs/arm/effort*.py", "procs/teleop/*.py", "procs/console/*.py", "procs/suj/*.py", "procs/config/read/*.py",
    "procs/config/models/*.py", "procs/config/loading/io_checks.py",
)
EQUIVALENT = {
    ("procs/arm/effort_limits.py", "wider = np.where(self._drives, spread, 0.0).max(axis=1)  # and back to the joints",
     "wider = np.where(self._drives, spread, -1.0).max(axis=1)  # and back to the joints"):
        "every joint has a motor, and nothing is less than 0 there",
    ("procs/arm/effort_limits.py", "wider = np.where(self._drives, spread, 0.0).max(axis=1)  # and back to the joints",
     "wider = np.where(self._drives, spread, 1.0).max(axis=1)  # and back to the joints"):
        "nothing is less than 1 there",
    ("procs/config/read/validate.py",
     "slip = bool(difflib.get_close_matches(name.lower(), nearest, n=1, cutoff=_SLIP))",
     "slip = bool(difflib.get_close_matches(name.lower(), nearest, n= 2, cutoff=_SLIP))"): "there is one at most",
    ("procs/suj/interface_board.py", "break", "continue"): "after none there is none",
    ("procs/arm/motion.py", "self.effort[...] = 0.0", "pass"): "read in effort mode only, which sets it each cycle",
    ("procs/console/goovis.py", "if self._file >= 0:", "if self._file >= 1:"): "descriptor 0 is the standard input's",
    ("procs/io/pid.py", "self._dead = bool(np.any(outer > 0.0))", "self._dead = bool(np.any(outer != 0.0))"):
        "no file may have a dead-band below 0",
    ("procs/suj/joints.py", "self._reported = shown", "pass"): "what is shown is written again as it is",
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
