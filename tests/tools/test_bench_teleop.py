"""`trocar bench teleop`: the system that it measures."""

from __future__ import annotations

import pytest

from trocar.procs.config import load_system
from trocar.tools.bench import teleop
from trocar.tools.output.errors import Problem
from trocar.tools.systems.supervising import StartRequest


@pytest.mark.parametrize(("sets", "periods_s"), [
    ((), (0.000666667, 0.000666667)),
    (("io.spin_us=0",), (0.000666667, 0.000666667)),
    (("io.period_s=0.002", "io.spin_us=0"), (0.002, 0.000666667)),
])
def test_what_is_set_comes_on_top_of_the_usual_periods(
    sets: tuple[str, ...], periods_s: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[StartRequest] = []

    def start(request: StartRequest) -> None:
        asked.append(request)
        raise Problem("not here")

    monkeypatch.setattr(teleop, "up_meanwhile", start)
    with pytest.raises(Problem, match="not here"):
        teleop.run(sets=sets)
    system = load_system(asked[0].file, boards="emulated", sets=asked[0].sets).system
    assert system is not None and (system.ios[0].period_s, system.arms[0].period_s) == periods_s
    assert all("io.spin_us=0" not in sets or io.spin_us == 0.0 for io in system.ios)
