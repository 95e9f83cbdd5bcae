"""The colours of the pages: legible, and different for colour-blind eyes as well."""

from __future__ import annotations

import re
from itertools import combinations

import pytest

from tests.gui.colours import DEUTERANOPIA, NORMAL, PROTANOPIA, contrast, difference
from trocar.procs.gui.pages.assets import STATIC

EYES = {"normal": NORMAL, "deuteranopia": DEUTERANOPIA, "protanopia": PROTANOPIA}
STATES = ("good", "warn", "bad", "accent", "soft")
"""What colour alone could be read from; each has an icon or a word, too."""
LINES = tuple(f"s{i}" for i in range(8))


def palette(theme: str) -> dict[str, str]:
    """The colours of a theme by their names."""
    text = (STATIC / "style.css").read_text(encoding="utf-8")
    start = r":root" if theme == "light" else r'html\[data-theme="dark"\]'
    return dict(re.findall(r"--(\w+): (#\w+)", " ".join(re.findall(rf"^{start} {{([^}}]*)}}", text, re.M))))


def test_differences_and_contrasts_are_those_of_the_standards() -> None:
    assert difference("#808080", "#808080") == 0.0
    assert difference("#000000", "#ffffff") == pytest.approx(100.0, abs=1e-3)
    assert difference("#ff0000", "#00ff00") == pytest.approx(86.608, abs=1e-3)
    assert difference("#0000ff", "#ffff00") == pytest.approx(103.427, abs=1e-2)
    assert contrast("#000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_states_and_lines_differ_for_all_eyes(theme: str) -> None:
    colours = palette(theme)
    for names in (STATES, LINES):
        found = {(one, other, eye): difference(colours[one], colours[other], matrix)
                 for one, other in combinations(names, 2) for eye, matrix in EYES.items()}
        assert not {key: round(value, 1) for key, value in found.items() if value < 10.0}


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_texts_are_legible_on_all_backgrounds(theme: str) -> None:
    colours = palette(theme)
    pairs = [(text, ground) for text in (*STATES, "text", *LINES) for ground in ("card", "bg")]
    pairs += [("good", "lit"), ("text", "lit"), ("warn", "amber"), ("text", "amber"), ("on", "accent")]
    found = {pair: contrast(colours[pair[0]], colours[pair[1]]) for pair in pairs}
    found["white", "danger"] = contrast("#ffffff", colours["danger"])
    found["text", "stop"] = contrast("#18202a", "#ffd400")
    assert not {pair: round(value, 2) for pair, value in found.items() if value < 4.5}
    assert contrast(colours["edge"], colours["card"]) >= 3.0, "borders that carry a meaning"
