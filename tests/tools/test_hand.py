"""The demo's hand at a whole system in this process: it lets go by a fault, and works again when it is asked to.

Each row breaks what docs/emulated-boards.md says that may break while the slave follows, and hands mend it. Then what
`trocar status` names is typed, until all is well, and an operator enables teleoperation again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
from typer.testing import CliRunner, Result

from tests.host.hosted import COARSE, document
from tests.system.test_demo_faults import named
from trocar.procs.host.host import Host
from trocar.procs.machine.paths import ROOT
from trocar.shm.mailbox.client import Client
from trocar.shm.time.clock import sleeping_by
from trocar.tools import cli
from trocar.tools.examples.hand import Hand, figure_eight
from trocar.tools.examples.operator_sim import OperatorSim
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.standing import in_a_line, standings

APP = cli.build()
BEAT_S, LONG_S, WHILE_S = 0.02, 60.0, 0.4
REMEDIES = 3
HEADINGS = ("faults of a robot", "faults of boards and buses", "faults of datagrams")


@dataclass(frozen=True)
class BrokenRun:
    """Orders to boards; what mends it; whether following ends by it."""

    breaks: tuple[str, ...]
    mends: tuple[str, ...] = ()
    ends: bool = True


def switched(order: str) -> BrokenRun:
    """What a 1 breaks and a 0 mends."""
    return BrokenRun((f"{order} 1",), (f"{order} 0",))


FAULTS = (
    switched("emergency_stop"), switched("power_loss PSM1"), switched("amp_fault MTMR 2"), switched("amp_fault PSM1 3"),
    BrokenRun(("encoder_jump PSM1 3 -40000",)), switched("pot_dead PSM1 1"),
    BrokenRun(("current_error PSM1 3 0.6",), ("current_error PSM1 3 0",)),
    BrokenRun(("pot_drift PSM1 1 0.5",), ("pot_drift PSM1 1 0 0",)),
    BrokenRun(("swap_motors PSM1 3 4",), ("swap_motors PSM1 3 4",)),
    BrokenRun(("unplug_board 7 IO1",), ("plug_board 7 IO1",)),
    BrokenRun(("temperature 7 66.5 31 IO1",), ("temperature 7 31 31 IO1",)),
    BrokenRun(("encoder_scale PSM1 1 1.25", "jam PSM1 0 1"), ("encoder_scale PSM1 1 1", "jam PSM1 0 0"), ends=False),
    BrokenRun(("bus_reset IO1", "drop_block 7 5 IO1", "spoil_sequence 7 5 IO1", "delay_replies 3 0.01 IO1",
            "duplicate_replies 3 IO1", "drop_replies 3 IO1", "corrupt_tl 3 IO1", "reply_rate lost 0.02",
            "packet_loss 0.001 IO1"), ("clear_packet_faults",), ends=False),
    BrokenRun(("lose_replies 100",), ("clear_packet_faults",)),
    switched("press PSM1_arm_clutch"), switched("press clutch"),
)
"""MTMR takes five times as long to home as PSM1: what may break in either arm does so in the slave, all but one."""


def test_every_fault_that_can_be_ordered_is_tried() -> None:
    text, listed = (ROOT / "docs" / "emulated-boards.md").read_text(encoding="utf-8"), set[str]()
    for heading in HEADINGS:
        table = text.partition(f"| {heading} |")[2].partition("\n\n")[0]
        listed |= set(re.findall(r"^\| `trocar send boards (\w+)", table, re.MULTILINE))
    tried = {order.split()[0] for fault in FAULTS for order in (*fault.breaks, *fault.mends)}
    assert len(listed) > 15 and listed <= tried, listed - tried


class HostedDemo:
    """The demo's system with its hand, which draws an eight while the slave follows."""

    def __init__(self, host: Host) -> None:
        self.host, self.seat = host, OperatorSim(host.name, "console")
        self.teleop = self.seat.teleops[0]
        self.hand = Hand(host.name, self.seat, self.teleop)
        self.clients = {name: host.client(name) for name in ("boards", "console")}
        self._beats = 0

    def beat(self) -> None:
        """What `trocar demo` does, half as often."""
        self.host.run(BEAT_S)
        self._beats += 1
        if self.hand.holds():
            self.hand.draw(figure_eight(math.pi * self._beats * BEAT_S / 4.0, 0.03))
        else:
            self._beats = 0

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Go on until that is so."""
        for _ in range(round(LONG_S / BEAT_S)):
            if condition():
                return
            self.beat()
        pytest.fail(f"did not happen within {LONG_S} s: {what}; {self.teleop.reported}")

    def passes(self, seconds: float) -> None:
        """So long."""
        for _ in range(round(seconds / BEAT_S)):
            self.beat()

    def asks(self, name: str, command: str, *values: float, text: str = "") -> None:
        """A command, carried out to its end."""
        client: Client = self.clients[name]
        number, ended = client.send(command, values, text), list[str]()

        def is_over() -> bool:
            ended.extend(f"{reply.outcome} {reply.text}".strip() for reply in client.poll()
                         if reply.id == number and reply.outcome != "accepted")
            return bool(ended)

        self.until(is_over, f"an answer to {command}")
        assert ended[0].startswith("done"), f"{name} {command}: {ended}"

    def order(self, order: str) -> None:
        """Hands and accidents, as they are typed."""
        word, *rest = order.split()
        numbers = [float(each) for each in rest if re.fullmatch(r"-?[\d.]+", each)]
        self.asks("boards", word, *numbers, text=" ".join(each for each in rest if not re.fullmatch(r"-?[\d.]+", each)))

    def types(self, *words: str) -> Result:
        """A verb, while the hand moves."""
        with sleeping_by(lambda seconds: self.passes(max(BEAT_S, seconds))):
            return CliRunner().invoke(APP, [*words, "--system", self.host.name])

    def status(self) -> str:
        """The last line of `trocar status`, once it names a remedy or says that all is well."""
        seen = [""]

        def is_clear() -> bool:
            processes = statuses(self.host.name)
            seen.append(in_a_line(processes, standings(self.host.name, processes)))
            return bool(named(seen[-1])) or "all well" in seen[-1]

        self.until(is_clear, "a remedy is named")
        return seen[-1]

    def recover(self) -> None:
        """Type what status names until it names nothing; then ask for teleoperation."""
        for _ in range(REMEDIES):
            for words in named(self.status()):
                done = self.types(*words.split())
                assert done.exit_code == 0, f"trocar {words}: {done.output}"
        assert not named(self.status()), self.status()
        self.asks("console", "teleop_enable", 1.0)
        self.until(lambda: self.teleop.is_following, "it follows again")


@pytest.fixture(scope="module")
def demo() -> Iterator[HostedDemo]:
    """One for all rows, each of which leaves it following."""
    with Host(document("demo-teleop.yaml", "emulated", COARSE), history=32) as host:
        host.run(0.1)
        made = HostedDemo(host)
        made.recover()
        yield made
        made.hand.close()
        made.seat.__exit__()


@pytest.mark.slow
@pytest.mark.simulated
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: ", ".join(fault.breaks)[:40])
def test_what_breaks_while_the_demo_follows_is_recovered_by_an_operator(demo: HostedDemo, fault: BrokenRun) -> None:
    demo.passes(WHILE_S)
    assert demo.teleop.is_following, demo.teleop.reported
    for order in fault.breaks:
        demo.order(order)
    if fault.ends:
        demo.until(lambda: not demo.teleop.is_following, "following ends")
    demo.passes(WHILE_S)
    for order in fault.mends:
        demo.order(order)
    demo.passes(WHILE_S)
    demo.recover()


@pytest.mark.slow
@pytest.mark.simulated
def test_after_a_restart_of_the_slave_the_hand_pinches_once_an_operator_shows_presence_again(demo: HostedDemo) -> None:
    demo.passes(WHILE_S)
    demo.host.restart("PSM1", killed=True)
    demo.until(lambda: not demo.teleop.is_following, "following ends")
    demo.passes(2.0)
    assert not demo.teleop.is_following, "it was not enabled"
    demo.order("press coag 0")
    demo.order("press coag 1")
    demo.until(lambda: demo.teleop.is_following, "it follows again")
