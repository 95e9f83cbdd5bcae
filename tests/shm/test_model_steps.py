"""Models and prose of the protocols of shm/ have the same steps, and every mutant of a model is searched for."""

from __future__ import annotations

import re

import pytest

from tests.shm.test_models import MODELS, MUTANTS
from trocar.shm.mailbox import mailbox
from trocar.shm.ring import ring

PROSE = {"ring": ring.__doc__, "mailbox": mailbox.__doc__}


def steps(text: str, pattern: str) -> set[str]:
    return set(re.findall(pattern, text, re.MULTILINE))


@pytest.mark.parametrize("model", PROSE)
def test_prose_and_model_have_the_same_steps(model: str) -> None:
    text = (MODELS / f"{model}.pml").read_text()
    in_model = steps(text, r"^ .*[\w);>\\].*/\* ([A-Z][1-9]) \*/$")  # behind a statement
    assert in_model == steps(PROSE[model] or "", r"\b[A-Z][1-9]\b")


@pytest.mark.parametrize("model", PROSE)
def test_every_mutant_of_a_model_is_tried(model: str) -> None:
    text = (MODELS / f"{model}.pml").read_text()
    switches = steps(text, r"^#if.*?(\w+)\)?$") | steps(text, r"^#if !defined\((\w+)\)")
    settings = steps(text, r"^#ifndef (\w+).*\n#define \1 ")
    tried = {macros.split()[0] for name, macros, _ in MUTANTS if name == model}
    assert switches - settings - {"MIXED", "ACCEPTS", "STOPS"} == tried
