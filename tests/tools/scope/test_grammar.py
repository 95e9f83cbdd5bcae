"""Conditions: what is one, what they are made of, and how a wrong one is told."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.crtk.field_paths import parse_path
from trocar.tools.scope.grammar import (
    BadCondition,
    Comparison,
    Condition,
    EventSeen,
    FaultSeen,
    Joined,
    leaves,
    parse_condition,
)

FIELD = "PSM1/measured_js.velocity[0]"
PATH = parse_path(FIELD)
FAST = Comparison(PATH, ">", 0.5)


@pytest.mark.parametrize(("text", "tree"), [
    (f"{FIELD} > 0.5", FAST), (f"{FIELD}>0.5", FAST), (f"  {FIELD} > .5 ", FAST), (f"{FIELD} > 5e-1", FAST),
    (f"abs({FIELD}) >= 2", Comparison(PATH, ">=", 2.0, True)),
    (f"{FIELD} != -1", Comparison(PATH, "!=", -1.0)),
    ("PSM1/state.state == FAULT", Comparison(parse_path("PSM1/state.state"), "==", "FAULT")),
    ('PSM1/state.tool == "LARGE:1"', Comparison(parse_path("PSM1/state.tool"), "==", "LARGE:1")),
    ("PSM1/state.tool == LARGE:1", Comparison(parse_path("PSM1/state.tool"), "==", "LARGE:1")),
    ("PSM1/state.is_busy", Comparison(parse_path("PSM1/state.is_busy"))),
    ("event", EventSeen()), ("event PSM1 error", EventSeen(("PSM1", "error"))),
    ("event tracking", EventSeen(("tracking",))), ('event "cannot follow"', EventSeen((), "cannot follow")),
    ("fault", FaultSeen()), ("fault PSM1", FaultSeen("PSM1")),
    ("fault or event PSM1", Joined("or", (FaultSeen(), EventSeen(("PSM1",))))),
    (f"not {FIELD} > 0.5 and fault", Joined("and", (Joined("not", (FAST,)), FaultSeen()))),
    (f"fault or {FIELD} > 0.5 and event", Joined("or", (FaultSeen(), Joined("and", (FAST, EventSeen()))))),
    (f"(fault or {FIELD} > 0.5) and event", Joined("and", (Joined("or", (FaultSeen(), FAST)), EventSeen()))),
])
def test_a_condition_is_a_tree(text: str, tree: Condition) -> None:
    assert parse_condition(text) == tree


@pytest.mark.parametrize(("text", "why"), [
    ("", "at its end (character 1): a field is expected here"),
    (f"{FIELD} >", "at its end (character 31): a number or a word is expected here"),
    (f"{FIELD} => 1", "is not understood"),
    (f"{FIELD} > 0.5 fault", "at 'fault' (character 36): and, or, or the end is expected here"),
    (f"({FIELD} > 0.5", "a closing bracket is missing"),
    ("PSM1/state > 1", "this is a whole topic, a field is expected"),
    ("PSM1/state.position[a] > 1", "[a] is no index"),
    (f"abs {FIELD} > 1", "an opening bracket belongs behind abs"),
    (f"abs({FIELD})", "one of > >= < <= == != is expected here"),
    ("velocity > 1", "at 'velocity > 1' (character 1): a field is expected here"),
    ("__import__('os')", "a field is expected here"),
    ("not " * 40 + "fault", "more than 20 deep"),
    ("fault or " * 200 + "fault", "allowed are 1000"),
])
def test_a_wrong_condition_says_where_and_what_is_allowed(text: str, why: str) -> None:
    with pytest.raises(BadCondition) as caught:
        parse_condition(text)
    assert why in str(caught.value)


@given(st.text(" ()<>=!\"'[]._/-:0159abdefnortvPSMé→\n\0", max_size=80))
def test_any_text_is_a_condition_or_refused(text: str) -> None:
    try:
        parse_condition(text)
    except BadCondition as error:
        assert "\n" not in str(error)


def written(tree: Condition) -> str:
    if isinstance(tree, Joined):
        parts = [f"({written(part)})" for part in tree.parts]
        return f"not {parts[0]}" if tree.word == "not" else f" {tree.word} ".join(parts)
    if isinstance(tree, Comparison):
        field = f"abs({tree.path.text})" if tree.of_size else tree.path.text
        value = f'"{tree.value}"' if isinstance(tree.value, str) else repr(tree.value)
        return f"{field} {tree.operator} {value}" if tree.operator else field
    if isinstance(tree, FaultSeen):
        return f"fault {tree.name}"
    return " ".join(("event", *tree.words)) + (f' "{tree.text}"' if tree.text else "")


VALUES = st.floats(-1e6, 1e6) | st.text("abc XYZ:<>=()", max_size=8)
NAMES = st.sampled_from(["PSM1", "MTML-PSM1", "io_1", "tracking", "error"])
LEAVES = st.builds(Comparison, st.just(PATH), st.sampled_from([">", ">=", "<", "<=", "==", "!="]), VALUES, st.booleans()
                   ) | st.builds(FaultSeen, NAMES | st.just("")) | st.builds(
    EventSeen, st.lists(NAMES, max_size=2).map(tuple), st.text("abc (and or)", max_size=8))
TREES = st.recursive(
    LEAVES, lambda some: st.builds(Joined, st.just("not"), st.tuples(some)) | st.builds(
        Joined, st.sampled_from(("and", "or")), st.tuples(some, some)),
    max_leaves=5)


@given(TREES)
def test_a_tree_that_is_written_is_read_again(tree: Condition) -> None:
    assert parse_condition(written(tree)) == tree
    assert len(list(leaves(tree))) >= 1
