"""`trocar bus scan|read|write|watch`: the controllers on a bus, for people with a board on the desk."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from typing import Annotated, Any, Final

import typer

from trocar.procs.fpga import registers
from trocar.procs.tables.codes import FIRMWARE_UNKNOWN
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.inspect import register_names, samples
from trocar.tools.inspect.bus_client import NO_SERIALS, BusClient, FoundBoard, shared_id
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import answer, emit, note, number, page, table, tell
from trocar.tools.verbs.options import JsonOption

PERIOD_S: Final = 0.1  # of the live view
MAX_REGISTERS: Final = 1024
ALL: Final = "all"
ALL_BOARDS: Final = 0x3F  # as `Port` has it
FOREIGN_SAMPLES: Final = 3  # in a row, before somebody else is said to sample the board

PortArgument = Annotated[str, typer.Argument(
    metavar="PORT", help="As in system files: udp[:IP], udpfw[:IP], eth:INTERFACE, ethfw:INTERFACE, fw[:N].")]
BoardArgument = Annotated[str, typer.Argument(metavar="BOARD", help="Board id, 0 to 15 (its rotary switch).")]
RegisterArgument = Annotated[str, typer.Argument(
    metavar="REGISTER", help="A name (STATUS, ENCODER:2 for axis 2) or a number (0x25, 37).")]


def scan(
    port: PortArgument = "udp",
    with_serials: Annotated[bool, typer.Option(
        "--serials/--no-serials", help="Serial numbers; asking for them writes PROM commands.")] = True,
    as_json: JsonOption = False,
) -> int:
    """Find every controller of a bus. Serial numbers are left out while a running system drives it.

    Example: trocar bus scan udp:169.254.0.100
    """
    with BusClient(port) as desk:
        driver = desk.driver() if with_serials else ""
        ask = with_serials and not driver
        rows = [_scanned(desk, board, ask_proms=ask) for board in desk.boards]
    code = 1 if any(row["status"] is None for row in rows) else 0
    if as_json:
        emit(*rows)
        return code
    table("", ("board", "node", "hardware", "Rev", "FPGA", "serials", "state"), [_cells(row) for row in rows])
    if driver:
        note(f"no serial numbers: {driver}")
    return code


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    numbers = [f"{kind} {row[key]}" for kind, key in (("FPGA", "fpga_serial"), ("QLA", "qla_serial")) if row[key]]
    return (str(row["board"]), f"{row['node']} hub" if row["is_hub"] else str(row["node"]), row["hardware"],
            str(row["firmware"]), f"V{row['fpga']}", ", ".join(numbers) or "–", row["state"])


def _scanned(desk: BusClient, board: FoundBoard, *, ask_proms: bool) -> dict[str, Any]:
    """A board as a row; of boards that share an id nothing more is known."""
    alike = [info for info in desk.boards if info.board == board.board]
    if len(alike) > 1:
        return {**dataclasses.asdict(board), **NO_SERIALS, "status": None, "watchdog_s": None,
                "state": shared_id(alike)}
    status = desk.read(board.board, registers.STATUS)
    row = dataclasses.asdict(board) | (desk.serials(board) if ask_proms else NO_SERIALS)
    watchdog = desk.read(board.board, registers.WATCHDOG)
    state = [f"power {_on(status & registers.STATUS_POWER)}",
             f"relay {'closed' if status & registers.STATUS_RELAY else 'open'}",
             f"watchdog {register_names.watchdog_text(watchdog)}"
             + (", tripped" if status & registers.STATUS_WATCHDOG else "")]
    return {**row, "status": status, "watchdog_s": (watchdog & 0xFFFF) * registers.WATCHDOG_UNIT_S,
            "state": ", ".join(state)}


def _on(bit: int) -> str:
    return "on" if bit else "off"


def read(
    port: PortArgument,
    board: BoardArgument,
    register: RegisterArgument,
    count: Annotated[int, typer.Argument(metavar="COUNT", min=1, max=MAX_REGISTERS,
                                         help="Number of registers from there.")] = 1,
    as_json: JsonOption = False,
) -> int:
    """Read registers: hexadecimal, and their meaning where it is known. Changes nothing, even while an io uses the bus.

    If no axis is given, an axis register is read for all axes.

    Example: trocar bus read udp 0 STATUS
    """
    wanted = _board_id(board)
    if register.upper() not in register_names.AXIS_REGISTERS:
        register_names.addresses(register, None, count)  # what cannot be a register is reported before the bus is asked
    with BusClient(port) as desk:
        info = desk.board(wanted)
        rows = [_valued(info, address, desk.read(wanted, address))
                for address in register_names.addresses(register, info, count)]
    if as_json:
        emit(*rows)
        return 0
    if len(rows) == 1:
        row = rows[0]
        tell(f"{info.title} {row['register']} = {row['hex']}" + (f"  {row['meaning']}" if row["meaning"] else ""))
    else:
        cells = [(row["register"], f"0x{row['address']:04X}", row["hex"], row["meaning"]) for row in rows]
        table(info.title, ("register", "address", "value", "meaning"), cells)
    return 0


def _valued(board: FoundBoard, address: int, value: int) -> dict[str, Any]:
    return {"board": board.board, "register": register_names.address_name(address), "address": address, "value": value,
            "hex": f"0x{value:08X}", "meaning": register_names.meaning(address, value, board)}


def _board_id(text: str) -> int:
    if not text.isdecimal() or not 0 <= int(text) <= 15:
        raise Misuse(f"board {text}: allowed 0 to 15, the position of its rotary switch")
    return int(text)


def write(
    port: PortArgument,
    board: Annotated[str, typer.Argument(metavar="BOARD", help="Board id, 0 to 15, or all.")],
    register: RegisterArgument,
    value: Annotated[str, typer.Argument(metavar="VALUE", help="A number: 0x000C0000 or 786432.")],
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Write without asking.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Write one register: shows old and new value and asks. Refused while a running io drives the bus.

    Example: trocar bus write udp 0 WATCHDOG 0x1680
    """
    wanted, new = None if board.lower() == ALL else _board_id(board), _value(value)
    _one_address(register, None)
    if not yes and not sys.stdin.isatty():
        raise Misuse("write asks for confirmation, but there is no terminal; --yes writes without asking")
    with BusClient(port) as desk:
        targets = tuple(desk.board(b) for b in ([info.board for info in desk.boards] if wanted is None else [wanted]))
        if yes and (unknown := next((info for info in targets if info.is_unknown), None)):
            raise Problem(f"{unknown.title}: the effect of a write is unknown here; --yes does not write")
        address = _one_address(register, targets[0] if len(targets) == 1 else None)
        desk.refuse_others("nothing was written")
        old = {info.board: desk.read(info.board, address) for info in targets}
        _announce(address, new, targets, old, everyone=wanted is None)
        if not yes and not typer.confirm("Write it?", err=True):
            note("nothing was written")
            return 1
        desk.write(ALL_BOARDS if wanted is None else wanted, address, new)
        for info in targets:
            now = _valued(info, address, desk.read(info.board, address))
            answer({**now, "old": old[info.board], "written": new},
                   f"written; board {info.board} now reads {now['hex']}  {now['meaning']}".rstrip(), as_json)
    return 0


def _value(text: str) -> int:
    try:
        value = int(text, 0)
    except ValueError:
        value = -1
    if not 0 <= value <= 0xFFFF_FFFF:
        raise Misuse(f"value {text}: allowed 0 to 0xFFFFFFFF, hexadecimal or decimal")
    return value


def _one_address(register: str, board: FoundBoard | None) -> int:
    """The register to write: never one of every axis at once."""
    bare = register.upper() in register_names.AXIS_REGISTERS
    return register_names.addresses(register, None if bare else board)[0]


def _announce(address: int, new: int, targets: tuple[FoundBoard, ...], old: dict[int, int], *, everyone: bool) -> None:
    """What is going to be written, on the error stream: it never mixes with data."""
    numbers = ", ".join(str(info.board) for info in targets)
    where = f"ALL boards of the bus ({numbers})" if everyone else targets[0].title
    note(f"{where}, register {register_names.address_name(address)} (0x{address:04X})")
    for info in targets:
        was = _valued(info, address, old[info.board])
        note(f"  now{f' board {info.board}' if everyone else ''} {was['hex']}  {was['meaning']}".rstrip())
    if any(info.is_unknown for info in targets):
        note(f"  the effect of a write is unknown for this firmware; {FIRMWARE_UNKNOWN.remedy}")
    note(f"  new 0x{new:08X}  {register_names.written_meaning(address, new, targets[0])}".rstrip())


def watch(
    port: PortArgument,
    board: BoardArgument,
    once: Annotated[bool, typer.Option("--once", help="Print one sample and exit.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Watch one board live, ten times a second; q or Ctrl-C leaves. Refused while a running io drives the bus.

    Reading does not refresh the watchdog, but it restarts the board's sample timer, which a running io on another
    machine uses to measure time.

    Example: trocar bus watch udp 0 --once
    """
    wanted = _board_id(board)
    with BusClient(port) as desk:
        info = desk.board(wanted)
        samples.layout(info)
        desk.refuse_others("watching would restart the sample timers it relies on")
        if once or as_json or not sys.stdout.isatty():
            _stream(desk, info, once=once, as_json=as_json)
        else:
            _live(desk, info)
    return 0


class Watching:
    """Samples of one board in turn, as long as nobody else samples it."""

    def __init__(self, desk: BusClient, board: FoundBoard) -> None:
        """Nothing is asked yet."""
        self._desk, self._board = desk, board
        self._asked_ns = 0
        self._foreign = 0

    def sample(self) -> samples.BoardSample:
        """One more; Problem when samples in between were taken by somebody else."""
        begin = monotonic_ns()
        taken = samples.take(self._desk, self._board)
        between_s, self._asked_ns = (begin - self._asked_ns) * 1e-9 if self._asked_ns else 0.0, begin
        self._foreign = self._foreign + 1 if taken.since_s < 0.5 * between_s else 0
        if self._foreign >= FOREIGN_SAMPLES:
            raise Problem(f"another host samples {self._board.title} ({taken.since_s * 1e3:.1f} ms ago): "
                          "watching stops, so as not to restart its sample timer")
        return taken


def _stream(desk: BusClient, board: FoundBoard, *, once: bool, as_json: bool) -> None:
    watching = Watching(desk, board)
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            sample = watching.sample()
            emit(sample.as_dict()) if as_json else tell(_page(sample, ""))
            if once:
                return
            pause(PERIOD_S)


def _live(desk: BusClient, board: FoundBoard) -> None:
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    from trocar.tools.output.keys import keys

    watching = Watching(desk, board)
    console = Console(highlight=False)
    with contextlib.suppress(KeyboardInterrupt), keys() as pressed, \
            Live(console=console, screen=console.is_terminal, auto_refresh=False) as live:
        while pressed() not in ("q", "Q"):
            begin = monotonic_ns()
            live.update(Text(_page(watching.sample(), " (q: quit)")), refresh=True)
            pause(max(0.0, PERIOD_S - (monotonic_ns() - begin) * 1e-9 - 0.05))  # `pressed` waits 0.05 s itself


def _page(sample: samples.BoardSample, hint: str) -> str:
    degrees = [number(t) for t in sample.celsius]
    facts = [("status", f"0x{sample.status:08X}  {', '.join(sample.words)}"),
             ("watchdog", register_names.watchdog_text(sample.watchdog)),
             ("inputs", f"0x{sample.digital_input:08X}  "
                        f"{register_names.input_words(sample.digital_input, sample.board.hardware)}"),
             ("temperatures", " ".join(degrees) + " °C" if degrees else "–")]
    columns = ("axis", "pot", "current", "encoder", "counts/s", "amplifier", "inputs")
    cells = [(str(axis.axis), _bits(axis.pot_bits), _bits(axis.current_bits),
              _bits(axis.encoder_counts) + (" !" if axis.overflow else ""), number(axis.velocity_counts_s),
              axis.amplifier, axis.inputs) for axis in sample.axes]
    return "\n".join((page(sample.board.title + hint, ("", "now"), facts), page("", columns, cells, columns[:5]),
                      "pot and current in bits; ! overflow; inputs: - + h are high limit and home pins"))


def _bits(value: int | None) -> str:
    return "–" if value is None else str(value)
