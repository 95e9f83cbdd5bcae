"""docs/configuration.md names every key of the `trocar:` section, and its examples are good."""

from __future__ import annotations

import re

import pytest

from tests.config.conftest import SYSTEM, Home
from tests.conftest import ROOT
from trocar.procs.config.models.trocar_section import (
    ArmOptions,
    ControllerKeys,
    EmulatedBusKeys,
    EmulationOptions,
    IoOptions,
    ModelVariationKeys,
    ProcessKeys,
    QuirkKeys,
    TrocarSection,
)
from trocar.procs.config.read.yamltext import parse_yaml
from trocar.procs.document.keys import keys_in
from trocar.procs.document.system import ArmConfig, IoConfig

PAGE = (ROOT / "docs/configuration.md").read_text()


def test_every_key_is_on_the_page() -> None:
    words = {word for code in re.findall(r"`([^`\n]+)`", PAGE) for word in re.findall(r"\w+", code)}
    for model in (TrocarSection, IoOptions, ArmOptions, ProcessKeys, EmulationOptions, EmulatedBusKeys, ControllerKeys,
                  ModelVariationKeys, QuirkKeys):
        assert set(model.model_fields) - words - {"buses"} == set(), model.__name__
    assert "    buses:" in PAGE


@pytest.mark.parametrize(("section", "made"), [("io", IoConfig), ("arm", ArmConfig)])
def test_every_option_of_io_and_arms_reaches_its_process(home: Home, section: str, made: type) -> None:
    demo = parse_yaml((home.path / SYSTEM).read_text()).data
    assert isinstance(demo, dict)
    given = {field.name: not field.default if key.high is None else key.high * 0.75
             for field, _, key in keys_in(made) if not key.of}
    assert set(given) == set(TrocarSection.model_fields[section].annotation.model_fields) - {
        "priority", "cpu", "period_s", "tasks"}
    loaded = home.load_made({**demo, "trocar": {section: given}}).system
    assert loaded is not None
    (row,) = loaded.ios if made is IoConfig else loaded.arms
    assert {name: getattr(row, name) for name in given} == given


def test_examples_of_the_page_are_accepted(home: Home) -> None:
    of_robots, of_the_bench = (parse_yaml(text).data for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL))
    assert isinstance(of_robots, dict) and isinstance(of_the_bench, dict)
    alone = home.load_made(of_the_bench)
    assert alone.errors == () and alone.system is not None and alone.system.emulation is not None
    demo = parse_yaml((home.path / SYSTEM).read_text()).data
    assert isinstance(demo, dict)
    loaded = home.load_made({**demo, **of_robots})
    assert loaded.errors == () and loaded.system is not None and loaded.system.emulation is not None
    boards = {c.board_id: c for c in loaded.system.emulation.buses[0].controllers}
    assert list(boards) == [7, 6, 10]
    assert (boards[6].firmware, boards[6].qla, boards[6].quirks.direction_lag) == (9, "1.5", False)
    assert (boards[10].hardware, boards[10].fpga) == ("DQLA", "V3")
