"""What may happen: one table of events, each carried out by `strike`. Chance comes from the caller's generator."""

from __future__ import annotations

import random
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tests.soak.diary import Diary
from tests.soak.person import MASTER, ROBOTS, SLAVE, StormPerson
from tests.soak.powerless import ATTEMPTS, powerless
from tests.soak.system import System
from trocar.shm.time.clock import monotonic_ns, pause

BOARDS = {2: MASTER, 3: MASTER, 6: SLAVE, 7: SLAVE}
HELD_UP_S = 0.06  # surely more than the 30 ms that count
DEAD_BUS_S = 0.15
MIN_S, MAX_S = 0.02, 3.0
MAX_PACKETS = 60
IO = "IO1"


@dataclass
class Weather:
    """Strikes the system; what it changed for longer is put right by `clear`."""

    system: System
    person: StormPerson
    diary: Diary
    chance: random.Random

    def __post_init__(self) -> None:
        self.favourites: Sequence[str] = ()  # processes that are hit more often than others
        self.only = ""  # the one kind of event there is; empty: all
        self._undo: list[tuple[str, Sequence[float], str]] = []
        self.table: dict[str, tuple[float, Callable[[], str]]] = {
            "kill": (14, lambda: self._kill(self._anybody())),
            "pause": (26, lambda: self._pause(self._anybody())),
            "packet_loss": (6, self._packet_loss),
            "mislabel": (6, lambda: self._replies("corrupt_tl")),
            "lose": (4, lambda: self._replies("lose_replies")),
            "drop": (3, lambda: self._replies("drop_replies")),
            "duplicate": (3, lambda: self._replies("duplicate_replies")),
            "delay": (6, self._delay),
            "drop_block": (8, self._drop_block),
            "spoil_sequence": (4, self._spoil),
            "unplug": (6, self._unplug),
            "bus_reset": (2, lambda: self._order("bus_reset", (), IO)),
            "amp_fault": (6, self._amp_fault),
            "power_loss": (4, self._power_loss),
            "emergency_stop": (6, self._emergency_stop),
            "powerless": (5, self._powerless),
            "supervisor_kill": (1, lambda: self._kill("supervisor")),
            "supervisor_pause": (2, lambda: self._pause("supervisor")),
        }

    def choose(self) -> str:
        """Name of the next event."""
        names = [name for name in self.table if self.only in ("", name)] or list(self.table)
        return self.chance.choices(names, [self.table[name][0] for name in names])[0]

    def strike(self, name: str) -> str:
        """Let it happen; returns what it was, in words."""
        return self.table[name][1]()

    def clear(self) -> list[str]:
        """Put right what lasts; what could not be."""
        left = [(*each, reported) for each in self._undo if (reported := self.person.report("boards", *each))]
        self._undo = [(command, values, text) for command, values, text, _ in left]
        return [f"boards {command}: {reported}" for command, _, _, reported in left]

    def forget(self) -> None:
        """The boards are new ones."""
        self._undo.clear()

    # processes

    def _anybody(self) -> str:
        return self.chance.choice(list(self.favourites) if self.chance.random() < 0.5 else self.system.instances)

    def _length(self) -> float:
        low, high = MIN_S, MAX_S
        return float(low * (high / low) ** self.chance.random())

    def _kill(self, who: str) -> str:
        self._note(f"kill -9 {who}")
        if who == IO or who == "boards":
            self.diary.lose(ROBOTS, f"{who} killed")
        if who == "boards":
            self.forget()
        self.diary.void([who], streams=False)
        self.system.signal(who, signal.SIGKILL)
        return f"kill -9 {who}"

    def _pause(self, who: str) -> str:
        length_s = self._length()
        words = f"SIGSTOP {who} {length_s * 1e3:.0f} ms"
        self._note(words)
        self.system.signal(who, signal.SIGSTOP)
        begin = monotonic_ns()
        pause(length_s)
        passed_s = (monotonic_ns() - begin) * 1e-9
        if length_s > {IO: HELD_UP_S, "boards": DEAD_BUS_S}.get(who, MAX_S + 1.0):
            self.diary.lose(ROBOTS, words)
        if length_s > HELD_UP_S:
            self.diary.void([who], streams=False)
        self.system.signal(who, signal.SIGCONT)
        return f"{words} ({passed_s * 1e3:.0f})"

    # programs

    def _powerless(self) -> str:
        return powerless(self.system, self.diary, self.chance.choice(ATTEMPTS))

    # bus

    def _count(self) -> int:
        """Of packets: often few, which do no harm, and up to more than the watchdog stands."""
        return round(MAX_PACKETS ** self.chance.random())

    def _replies(self, command: str) -> str:
        return self._order(command, (self._count(),), IO)

    def _delay(self) -> str:
        return self._order("delay_replies", (self._count(), self.chance.uniform(0.0005, 0.05)), IO)

    def _packet_loss(self) -> str:
        reported = self._order("packet_loss", (self.chance.uniform(0.02, 0.6),), IO)
        pause(self.chance.uniform(0.05, 1.0))
        self._order("clear_packet_faults", ())
        return reported

    def _drop_block(self) -> str:
        return self._order("drop_block", (self.chance.choice(list(BOARDS)), self._count()), IO)

    def _spoil(self) -> str:
        return self._order("spoil_sequence", (self.chance.choice(list(BOARDS)), self._count()), IO)

    def _unplug(self) -> str:
        board = self.chance.choice(list(BOARDS))
        reported = self._order("unplug_board", (board,), IO, undo=(board,), mends="plug_board", loses=(BOARDS[board],))
        self._later()
        return reported

    # power

    def _amp_fault(self) -> str:
        robot, axis = self.chance.choice(ROBOTS), self.chance.randint(0, 6)
        reported = self._order("amp_fault", (axis, 1), robot, undo=(axis, 0), loses=(robot,))
        self._later()
        return reported

    def _power_loss(self) -> str:
        robot = self.chance.choice(ROBOTS)
        reported = self._order("power_loss", (1,), robot, undo=(0,), loses=(robot,))
        self._later()
        return reported

    def _emergency_stop(self) -> str:
        reported = self._order("emergency_stop", (1,), "", undo=(0,), loses=ROBOTS)
        self._later()
        return reported

    def _later(self) -> None:
        """What was broken is put right a moment later, or only when the person looks after the robot."""
        if self.chance.random() < 0.7:
            pause(self.chance.uniform(0.01, 1.0))
            self.clear()

    def _order(self, command: str, values: Sequence[float], text: str = "", undo: Sequence[float] | None = None,
               mends: str = "", loses: Sequence[str] = ()) -> str:
        reported = " ".join([command, *(f"{value:g}" for value in values), text]).strip()
        self._note(reported)
        if undo is not None:
            self._undo.append((mends or command, undo, text))
        refused = self.person.report("boards", command, values, text)
        self.diary.lose(loses, reported)
        return f"{reported} (boards: {refused})" if refused else reported

    def _note(self, words: str) -> None:
        self.diary.note("event", words)
