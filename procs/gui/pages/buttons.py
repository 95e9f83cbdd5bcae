"""The page Buttons: pedals, head sensors, switches and buttons of arms; outputs, and instruments that are read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from trocar.procs.document.emulated_names import names_on_boards
from trocar.procs.document.system import DigitalOutput, IoConfig, SystemConfig
from trocar.procs.gui.catalogue import BUTTONS, pins, record
from trocar.procs.gui.pages.assets import script
from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import arg, box, button, columns, form, head, live, switch

ARM_INPUTS: Final = (("clutch", "clutch"), ("adapter", "sterile adapter"), ("tool", "instrument"),
                     ("suj_clutch", "SUJ clutch"), ("suj_clutch_2", "SUJ clutch 2"))


def buttons_page(document: SystemConfig) -> None:
    """Its content."""
    script("forms.js")
    if document.consoles:
        with box("cards"):
            for console in document.consoles:
                _console(console.name)
    uses = _uses(document)
    names = names_on_boards((io.name, row.name) for io in document.ios for row in io.digital_inputs)
    for io in document.ios:
        if io.digital_inputs:
            _inputs(io.name, pins(io.name), [row.name for row in io.digital_inputs], uses,
                    names if document.emulation is not None else {})
        if io.digital_outputs:
            _outputs(io)
        if io.instrument_readers:
            _readers(io)
    for row in document.third_parties:
        if row.inputs:
            _inputs(row.name, record(row.name), list(row.inputs), uses, {})


def has_buttons(document: SystemConfig) -> bool:
    """Whether there are buttons to show."""
    return bool(document.consoles or any(io.digital_inputs or io.digital_outputs or io.instrument_readers
                                         for io in document.ios))


def _uses(document: SystemConfig) -> dict[tuple[str, str], str]:
    """Purpose of an io's input."""
    found: dict[tuple[str, str], list[str]] = {}
    for console in document.consoles:
        for use, wired in (("clutch", console.clutch), ("camera", console.camera),
                           *(("operator is present", sensor) for sensor in console.operator_present)):
            if wired is not None:
                found.setdefault((wired.io, wired.name), []).append(f"{console.name}: {use}")
    for arm in document.arms:
        for field, use in ARM_INPUTS:
            if name := getattr(arm.inputs, field):
                found.setdefault((arm.io, name), []).append(f"{arm.name}: {use}")
    for focus in document.focuses:
        for way, wired in zip(("in", "out"), focus.pedals, strict=False):
            found.setdefault((wired.io, wired.name), []).append(f"{focus.name}: {way}")
    return {key: ", ".join(words) for key, words in found.items()}


def _console(name: str) -> None:
    state = record(name)
    with box("card", data_source=state):
        with box("row head"):
            Part("h2", "title", name)
            live(f"{state}.input_type", classes="kind")
            box("spacer")
            Part("span", "age")
            Part("a", "", "Act as if pressed", href="/console")
        with box("row facts"):
            Part("span", "light", "operator is present", data_on=f"{state}.operator_present")
            Part("span", "light", "clutch", data_on=f"{state}.clutch")
            Part("span", "light", "camera", data_on=f"{state}.camera")
            with Part("span", "quiet"):
                Part("span", "", "inputs that detect the operator: ")
                live(f"{state}.present_inputs", "num:0")


def _inputs(owner: str, source: str, names: list[str], uses: dict[tuple[str, str], str],
            on_boards: dict[tuple[str, str], str]) -> None:
    titles = ("input", "now", "last", "at", "used as", "emulated" if on_boards else "")
    with _listed(f"{owner}: inputs", source, titles):
        for i, name in enumerate(names):
            last = f"{BUTTONS}.last.{owner}.{i}"
            with Part("tr"):
                Part("td", "", name)
                _light("pressed", f"{source}.input.{i}")
                _value(f"{last}.what")
                _value(f"{last}.at_ms", "time")
                Part("td", "quiet", uses.get((owner, name), ""))
                with Part("td"):
                    if on_boards:
                        there = on_boards[owner, name]
                        use = uses.get((owner, name), "")
                        asks = f"{use}: this may start motion. Continue?" if use else ""
                        switch("Press", f"{source}.input.{i}", [[("boards", "press", [1], there)]],
                               [[("boards", "press", [0], there)]], confirm=asks,
                               confirm_off=asks if use.endswith((": clutch", ": camera")) else "", data_input=name)


def _outputs(io: IoConfig) -> None:
    source = pins(io.name)
    with _listed(f"{io.name}: outputs", source, ("output", "now", "", "")):
        for i, row in enumerate(io.digital_outputs):
            with Part("tr"):
                Part("td", "", row.name)
                _light("high", f"{source}.output.{i}")
                with Part("td"):
                    if not row.set_by or io.calibration_mode:
                        _output(io.name, row, f"{source}.output.{i}")
                Part("td", "quiet", _about(row))


def _about(row: DigitalOutput) -> str:
    if row.is_pwm:
        return f"PWM at {row.pwm_hz:g} Hz"
    ends = [f"stays {level} for {time:g} s" for level, time in (("high", row.high_s), ("low", row.low_s)) if time]
    return ", ".join([*ends, *([f"set by {row.set_by} {row.robot}"] if row.set_by else [])])


def _output(io: str, row: DigitalOutput, path: str) -> None:
    if not row.is_pwm:
        switch("High", path, [[(io, "set_output", [1], row.name)]], [[(io, "set_output", [0], row.name)]],
               confirm=f"Set {row.name} high?", confirm_off=f"Set {row.name} low?")
        return
    with form(io, "set_pwm", row.name, "row"):
        arg("input", "num", data_low="0", data_high="1", size="4", inputmode="decimal", aria_label="Duty cycle")
        Part("button", "commands", "Set", type="button", data_submit="", data_confirm=f"Set {row.name}?")


def _readers(io: IoConfig) -> None:
    source = record(io.name, "instruments")
    with _listed(f"{io.name}: instruments", source, ("reader", "status", "instrument", "")):
        for i, row in enumerate(io.instrument_readers):
            with Part("tr"):
                Part("td", "", row.name)
                _value(f"{source}.status.{i}")
                _value(f"{source}.tool.{i}")
                with Part("td"):
                    button("Read", [[(io.name, "trigger_read", [], row.name)]], "quiet")


@contextmanager
def _listed(title: str, source: str, titles: tuple[str, ...]) -> Iterator[None]:
    """A table; its rows are made inside."""
    with box("card", data_source=source):
        head("h2", "", title)
        with box("scroll"), Part("table", "words"):
            columns(titles)
            with Part("tbody"):
                yield


def _light(text: str, path: str) -> None:
    with Part("td"):
        Part("span", "light", text, data_on=path)


def _value(path: str, kind: str = "text") -> None:
    with Part("td"):
        live(path, kind)
