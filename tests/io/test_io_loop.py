"""The order in which io shows a cycle: faults before the record, buttons after it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from trocar.procs.io.loop import IoLoop
from trocar.procs.io.reports import IoEvent


def test_who_hears_of_a_fault_or_a_button_finds_the_record_to_it() -> None:
    seen: list[str] = []
    events = [IoEvent("button", "pressed", "pressed", "coag", value=0.0),
              IoEvent("error", "hot", "temperature", "PSM1")]
    loop: Any = IoLoop.__new__(IoLoop)
    loop.node = SimpleNamespace(wall_ns=0, events=SimpleNamespace(emit=lambda kind, *_, **__: seen.append(kind)))
    loop._core = SimpleNamespace(cycle=lambda commands: None, stamp_ns=1, good=False,
                                 reports=SimpleNamespace(events=events, changed=set(), detached=[]))
    loop._mailbox = SimpleNamespace(has_news=False)
    loop._out = SimpleNamespace(publish=lambda stamp_ns: seen.append("record"))
    loop._others = {}
    loop._subscriptions = SimpleNamespace(look=lambda: False)
    loop._woken = [SimpleNamespace(wake=lambda: seen.append("woken"))]
    loop.update()
    assert seen == ["error", "record", "button", "woken"] and not events
    loop.update()
    assert seen[4:] == ["record"]
