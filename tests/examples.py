"""How many examples a property is tried with: a seventh in the quick part, ten times as many in a soak."""

from __future__ import annotations

from typing import Any, Final

from hypothesis import settings

MANY: Final = 100  # where a test does not say
LEAST: Final = 5
SHARES: Final = {"quick": 0.15, "full": 1.0, "soak": 10.0}
chosen: float = SHARES["full"]


def choose(markexpr: str) -> None:
    """The profile for what `-m` says; before tests are imported."""
    global chosen  # noqa: PLW0603
    name = "quick" if "not slow" in markexpr else "soak" if markexpr == "soak" else "full"
    chosen = SHARES[name]
    settings.register_profile(name, deadline=None, max_examples=round(MANY * chosen))  # a busy machine is no mistake
    settings.load_profile(name)


def examples(number: int, **more: Any) -> settings:
    """So many in the full profile; `more` as of hypothesis's settings."""
    return settings(max_examples=max(round(number * chosen), min(number, LEAST)), **more)
