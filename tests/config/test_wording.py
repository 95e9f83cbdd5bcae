"""What is said of any wrong value at any key: file, line, key, value and what is allowed, each once."""

from __future__ import annotations

import importlib
import itertools
import pkgutil
from pathlib import Path

import pytest
from pydantic import BaseModel

from tests.config.conftest import SYSTEM, Home
from trocar.procs.config import models
from trocar.procs.config.read.problem import FileProblem, value_text
from trocar.procs.config.read.shapes import fields_of
from trocar.procs.config.read.source import SourceFile
from trocar.procs.config.read.validate import validate

MARK = "zqx"  # in every value, and in nothing that is allowed
FILE, LINE = "spoiled.json", 47
MODELS = [model for module in pkgutil.iter_modules(models.__path__)
          for model in vars(importlib.import_module(f"{models.__name__}.{module.name}")).values()
          if isinstance(model, type) and issubclass(model, BaseModel)
          and model.__module__ == f"{models.__name__}.{module.name}"]
TEXTS = [f"{start}{MARK}" for start in ("", "udp:", "eth:a/", "fw:", "fw:9999", "127.0.0.", "[::1]:", "9" * 30)]
VALUES: list[object] = [
    *TEXTS, -987654321.5, 987654321123, float("inf"), TEXTS[:2], TEXTS[2:4],
    *(shape for text in TEXTS for shape in ([text], {MARK: text}, [[text]]))]


def told_once(problem: FileProblem, value: object) -> None:
    line = str(problem)
    assert line.startswith(f"{FILE}:{LINE}: {problem.severity}: {problem.key} = {value_text(value)}: "), line
    assert problem.allowed and line.count("allowed:") == 1, line
    assert not any(said in problem.text for said in (FILE, problem.key, value_text(value))), line
    assert MARK not in problem.text and MARK not in problem.allowed, line


def test_a_wrong_value_is_told_with_file_line_key_value_and_what_is_allowed_each_once() -> None:
    told = 0
    for model, value in itertools.product(MODELS, VALUES):
        keys = fields_of(model)
        lines: dict[tuple[str | int, ...], int] = {("outer",): LINE, **{("outer", key): LINE for key in keys}}
        source = SourceFile(Path(FILE), {"outer": dict.fromkeys(keys, value)}, lines)
        for problem in validate(model, source, ("outer",))[1]:
            if "required" not in problem.text:
                told_once(problem, source.at(_path(problem.key)))
                told += 1
    assert told > 16_500, "each key of each model refuses most of them"


def _path(text: str) -> tuple[str | int, ...]:
    parts: list[str | int] = []
    for part in text.split("."):
        name, *numbers = part.split("[")
        parts += [name, *(int(number.rstrip("]")) for number in numbers)]
    return tuple(parts)


@pytest.mark.parametrize("port", ["udpp", "udp:1.2", "udp:300.1.1.1", "fw:x", "fw:100", "eth:a/b", "emio:0"])
def test_a_port_that_is_none_is_told_with_what_is_allowed_once(home: Home, port: str) -> None:
    home.edit(SYSTEM, "port: udp", f'port: "{port}"')
    problem = next(problem for problem in home.load(boards="real").errors if problem.key == "IOs[0].port")
    assert str(problem).count("allowed:") == 1 and str(problem).count(port) == 1
    assert problem.line and str(problem).startswith(f"{problem.file}:{problem.line}: ")
