"""THE TABLE of controllers: features of each kind of hardware; with the firmware they determine the wire format.

`Traits` has the differences between the boards of a bus as arrays to compute with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Flags, Quads
from trocar.procs.document.emulated import MADE_FOR
from trocar.procs.document.system import Controller, Quirks
from trocar.procs.fpga import blocks
from trocar.procs.fpga import registers as reg

_VALID, _AMP_MASK, _MODE = reg.DAC_VALID >> 24, reg.DAC_AMP_MASK >> 24, 0x0F  # in the top byte of a command word
HEAD, BLOCK = 0, 1  # columns of a canonical row: the hub header, then the real-time block


@dataclass(frozen=True, slots=True)
class Hardware:
    """One kind of controller."""

    name: str
    identity: int  # register 0x04
    motors: int
    encoders: int
    outputs: int
    inputs: int  # levels of unconnected digital inputs: they are pulled up


HARDWARE: Final = {
    "QLA1": Hardware("QLA1", reg.QLA1, *blocks.AXES_OF["QLA1"], 4, 0x0000_0FFF),
    "DQLA": Hardware("DQLA", reg.DQLA, *blocks.AXES_OF["DQLA"], 8, 0x0FFF_0FFF),
    "dRA1": Hardware("dRA1", reg.DRA1, *blocks.AXES_OF["dRA1"], 0, 0x0001_FFFF),
}


@dataclass(frozen=True, slots=True)
class Model:
    """One controller as it is built and configured; `node` is its place on the FireWire bus."""

    board_id: int
    node: int
    hardware: Hardware
    firmware: int
    fpga: int
    serial: str
    expander: bool  # QLA from 1.5 on with Rev 8: voltage mode, safety line
    quirks: Quirks
    robot_serial: str = ""  # of the Si arm around a dRA1, as the arm's own memory has it: p292409.cal

    @classmethod
    def of(cls, node: int, controller: Controller) -> Model:
        """The model a controller of the document names; ValueError for one there never was."""
        c, hardware = controller, HARDWARE.get(controller.hardware)
        where = f"board {c.board_id}"
        if hardware is None:
            raise ValueError(f"{where}: hardware {c.hardware}; allowed: {', '.join(HARDWARE)}")
        made = MADE_FOR[c.hardware]
        if c.fpga not in made.get(c.firmware, ()):
            allowed = ", ".join(f"{revision} on {' or '.join(versions)}" for revision, versions in made.items())
            raise ValueError(f"{where}: {c.hardware} with firmware {c.firmware} on FPGA {c.fpga}; allowed: {allowed}")
        if not 0 <= c.board_id <= 15:
            raise ValueError(f"{where}; allowed: 0 to 15")
        expander = hardware.name != "dRA1" and c.firmware >= 8 and float(c.qla) >= 1.5
        fpga = int(c.fpga.removeprefix("V"))
        return cls(c.board_id, node, hardware, c.firmware, fpga, c.serial, expander, c.quirks, c.robot_serial)

    @property
    def layout(self) -> blocks.Layout:
        """Header fields of the firmware, sizes of this board's blocks."""
        return blocks.layout_of(self.firmware, self.hardware.motors, self.hardware.encoders)

    def columns(self, width: int) -> npt.NDArray[np.intp]:
        """Positions of the quadlets of a hub block (header first) in a canonical row for `width` axes."""
        return np.array([HEAD, *(BLOCK + column for column in self.layout.columns(width))], dtype=np.intp)


def models_of(controllers: tuple[Controller, ...]) -> tuple[Model, ...]:
    """Models by ascending board id.

    ValueError for none, two with one id, one there never was, or more than hub memory has room for.
    """
    ids = [c.board_id for c in controllers]
    if not ids or len(set(ids)) != len(ids):
        raise ValueError(f"boards {sorted(ids)}; allowed: at least one, each with its own id from 0 to 15")
    models = [Model.of(node, controller) for node, controller in enumerate(controllers)]
    quads = blocks.hub_read_quads((model.firmware, model.hardware.name) for model in models)
    if quads > blocks.MAX_HUB_QUADS:
        raise ValueError(f"{len(ids)} boards with {quads} quadlets in hub memory; allowed: {blocks.MAX_HUB_QUADS}")
    return tuple(sorted(models, key=lambda model: model.board_id))


def width_of(models: Sequence[Model]) -> int:
    """Columns for axes that arrays over these boards need."""
    return max(max(model.hardware.motors, model.hardware.encoders) for model in models)


@dataclass(frozen=True, slots=True)
class Traits:
    """Arrays (boards,), and (boards, width) where they are about axes; rows by ascending board id."""

    ids: npt.NDArray[np.int64]
    old: Flags  # firmware Rev 7
    late: Flags  # firmware Rev 9
    single: Flags  # QLA1
    dual: Flags  # DQLA
    digital: Flags  # dRA1: digital amplifiers
    prompt: Flags  # a dRA1 that cuts an amplifier as soon as its current was too far off for too long
    expander: Flags  # QLA from 1.5 on
    shows_requests: Flags  # in status bits 3:0, instead of the feedback once more
    ecm: Flags  # a dRA1 in an ECM
    axes: Flags  # there is a motor
    by_control: Flags  # motors with their enables in the control word
    real_time_bits: Quads  # of a control word, out of a real-time block
    considered: Quads  # in a command word's top byte: its value is taken if only the valid one of these bits is set
    amp_mask: Quads  # the bit of a command word's top byte that marks an enable

    @classmethod
    def of(cls, models: Sequence[Model], width: int) -> Traits:
        """Of these boards, in arrays for `width` axes."""
        names = np.array([model.hardware.name for model in models])
        firmware = np.array([model.firmware for model in models])
        old, single, digital = firmware == 7, names == "QLA1", names == "dRA1"
        expander = np.array([model.expander for model in models])
        axes = np.arange(width) < np.array([model.hardware.motors for model in models])[:, None]
        modes = np.where(expander, _MODE & ~1, np.where(old | digital, 0, _MODE))
        repeats = np.array([model.quirks.repeated_amp_bits for model in models])
        tardy = np.array([model.quirks.late_deviation for model in models])
        return cls(
            ids=np.array([model.board_id for model in models], dtype=np.int64), old=old, late=firmware >= 9,
            single=single, dual=names == "DQLA", digital=digital, prompt=digital & ~tardy,
            expander=expander, shows_requests=old | ~repeats,
            ecm=np.array([model.robot_serial.startswith("e") for model in models]), axes=axes,
            by_control=axes & single[:, None],
            real_time_bits=np.where(firmware >= 9, 0xFFFF_FFFF, reg.CONTROL_REAL_TIME_BITS).astype(np.uint32),
            considered=_spread(_VALID | modes, width), amp_mask=_spread(np.where(old, 0, _AMP_MASK), width))


def _spread(values: npt.NDArray[np.int64], width: int) -> Quads:
    """A value of each board, for each of its axes."""
    return np.repeat(values.astype(np.uint32)[:, None], width, axis=1)
