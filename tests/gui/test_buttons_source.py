"""Buttons of a system that the test plays: the last event of each, also of before somebody looked."""

from __future__ import annotations

import dataclasses

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.document.system import DigitalInput, SystemConfig, from_json
from trocar.procs.gui.buttons_source import ButtonsSource
from trocar.shm.system import directory
from trocar.shm.system.events import Events
from trocar.shm.time.clock import monotonic_ns


def with_pedals(document: SystemConfig) -> SystemConfig:
    """The same with two pedals."""
    pedals = tuple(DigitalInput(name, 3, bit, True, True, True) for bit, name in enumerate(("clutch", "coag")))
    return dataclasses.replace(document, ios=(dataclasses.replace(document.ios[0], digital_inputs=pedals),))


def test_the_last_event_of_each_button_is_shown(world: World) -> None:
    with robot(world.name) as scripted:
        events = Events(ring := directory.writer(scripted.name, "IO1", "events", "io"), monotonic_ns)
        events.emit("button", "pressed", code="pressed", component="coag", value=1.0)
        events.emit("button", "clicked", code="clicked", component="nobody's", value=2.0)
        source = ButtonsSource(with_pedals(from_json(directory.document(scripted.name))))
        clutch, coag = source.read(0)["last"]["IO1"]
        assert (clutch, coag["what"]) == ({}, "pressed") and coag["at_ms"] > 1_600_000_000_000
        events.emit("status", "something else", component="coag")
        events.emit("button", "released", code="released", component="coag", value=0.0)
        events.emit("button", "clicked", code="clicked", component="clutch", value=2.0)
        assert [row["what"] for row in source.read(0)["last"]["IO1"]] == ["clicked", "released"]
        source.close()
        ring.close()
