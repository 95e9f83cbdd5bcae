"""Decisions of a console: from pedals, presence and selection to the command for each of its teleoperations.

A teleoperation runs when it is enabled, selected and has its turn: those of the endoscope while the camera pedal is
pressed, the others while it is not. In its turn with the operator present (not needed for the endoscope): `enable`; in
its turn without an operator: `align_MTM`; in all other cases `disable`. Nothing here uses shared memory or reads a
clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from trocar.procs.console.selection import ECM, Selectable, at_load, conflicts, shared_arm, tapped
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.tables import codes
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin

if TYPE_CHECKING:
    from trocar.procs.console.outbox import Mailboxes

ENABLE, ALIGN, DISABLE = "enable", "align_MTM", "disable"
DISABLED: Final = "DISABLED"
OPERATOR, CLUTCH, CAMERA = "operator_present", "clutch", "camera"
PAYLOADS: Final = {RELEASED: 0.0, PRESSED: 1.0, CLICKED: 2.0}  # as the commands of teleoperations have them
BEEPS: Final = {  # s, Hz, how often
    (CLUTCH, PRESSED): (0.1, 700.0, 1), (CLUTCH, RELEASED): (0.1, 700.0, 1), (CLUTCH, CLICKED): (0.05, 2000.0, 2),
    (CAMERA, PRESSED): (0.1, 1000.0, 1), (CAMERA, RELEASED): (0.1, 1000.0, 1), (CAMERA, CLICKED): (0.05, 2500.0, 2),
    (OPERATOR, PRESSED): (0.3, 1500.0, 1), (OPERATOR, RELEASED): (0.3, 1200.0, 1),
}
REFUSED_NS: Final = 500_000_000  # delay before a refused request is repeated


class Logic:
    """One console; `members` are the teleoperations of all consoles, in the order of the document."""

    def __init__(self, name: str, members: Sequence[Selectable], desk: Mailboxes, scale: float) -> None:
        """No operator, no pedal pressed, teleoperation not enabled, compatible teleoperations selected."""
        self.name, self.scale = name, scale
        self.mine = tuple(member for member in members if member.console == name)
        self._members, self._desk = tuple(members), desk
        self._by_name = {member.name: member for member in self.mine}
        self.selected = at_load(members) & set(self._by_name)
        self.elsewhere: set[str] = set()  # selected in other consoles, as these show it
        self.asked = dict.fromkeys(self._by_name, "")
        self.lapsed: set[str] = set()  # they, or we, have restarted: they do not run until presence is shown again
        self.fallen: set[str] = set()  # they stopped by themselves; requested again when a person acts
        self.operator = self.clutch = self.camera = self.wanted = False
        self.origin: Origin = NO_ORIGIN
        """The person's command that enabled teleoperation."""
        self._again_ns = dict.fromkeys(self._by_name, 0)
        self._unreported: dict[str, float] = {}  # clutch states that could not be delivered yet
        self._awaiting = ""  # to be selected as soon as other consoles have released its arms

    # -- events --------------------------------------------------------------------------------------------------------

    def press(self, button: str, kind: int) -> None:
        """A button was pressed, released or clicked; the operator's presence counts as one."""
        if kind != CLICKED:
            setattr(self, {OPERATOR: "operator", CLUTCH: "clutch", CAMERA: "camera"}[button], kind == PRESSED)
        if kind == PRESSED and button == OPERATOR:
            self.lapsed -= {member.name for member in self.mine if member.kind != ECM}
        elif kind == PRESSED and button == CAMERA:
            self.lapsed -= {member.name for member in self.mine if member.kind == ECM}
        if kind == PRESSED and button != CLUTCH:
            self._pick_up()
        self._desk.button(button, kind)
        self.update()  # teleoperations are stopped before other messages
        if button == CLUTCH:
            # those at rest first: their effect on a shared master must not undo the command of the running ones
            for member in sorted(self.mine, key=lambda member: self.asked[member.name] in (ENABLE, ALIGN)):
                if kind == CLICKED:
                    self._desk.ask(member.name, "clutch", (PAYLOADS[kind],))
                else:
                    self._report_clutch(member.name, PAYLOADS[kind])
            if kind == CLICKED and (chosen := tapped(self.mine, self.selected)):
                self.select(chosen)
        duration_s, frequency_hz, count = BEEPS.get((button, kind), (0.0, 0.0, 0))
        for _ in range(count):
            self._desk.beep(duration_s, frequency_hz)

    def lose_operator(self, why: str) -> None:
        """No input detects the operator any more."""
        if self.operator:
            self._desk.status(f"{self.name}: {why}; the operator counts as absent")
            self.press(OPERATOR, RELEASED)

    def faults_until(self, generation: int) -> None:
        """The last fault of an arm was this one: teleoperation that was wanted before it no longer is."""
        if self.wanted and self.origin.generation < generation:
            self._desk.report(codes.TELEOP_DISABLED, f"{self.name}: {codes.TELEOP_DISABLED.cause}")
            self.enable(False)

    def enable(self, on: bool, origin: Origin = NO_ORIGIN) -> None:
        """Teleoperation is enabled, by whom, or disabled; the request is a sign of presence, too."""
        self.wanted, self.origin = on, origin
        if on:
            self.lapsed.clear()
            self._pick_up()
        self._desk.emit("teleop_enabled", component=self.name, value=float(on))
        self._desk.status(f"{self.name}: teleoperation {'enabled' if on else 'disabled'}")
        self.update()

    def set_scale(self, scale: float, origin: Origin) -> None:
        """One scale for all teleoperations of the console, set by a person."""
        self.scale = scale
        for member in self.mine:
            if not self._desk.ask(member.name, "set_scale", (scale,), origin=origin):
                self._desk.status(f"{member.name} did not get the scale {scale:g}")
        self._desk.emit("scale", component=self.name, value=scale)

    def select(self, teleop: str) -> bool:
        """Select it and unselect those that share an arm, elsewhere too; true: done, false: others must release it."""
        member = self._by_name[teleop]
        for other in conflicts(member, self._members):
            if other.name in self.selected:
                self._desk.status(f"{other.name} unselected to free {shared_arm(member, other)}")
                self.unselect(other.name)
            elif other.name in self.elsewhere and self._awaiting != teleop:
                self._desk.status(f"{other.console} is requested to free {shared_arm(member, other)}")
                self._desk.free(other.name)
        if any(other.name in self.elsewhere for other in conflicts(member, self._members)):
            self._awaiting = teleop
            return False
        self._awaiting = "" if self._awaiting == teleop else self._awaiting
        self._pick_up()
        if teleop not in self.selected:
            self.selected.add(teleop)
            self._desk.emit("selected", teleop, teleop)
        self.update()
        return True

    def unselect(self, teleop: str) -> None:
        """Unselect it, which stops it."""
        self._awaiting = "" if self._awaiting == teleop else self._awaiting
        if teleop in self.selected:
            self.selected.discard(teleop)
            self._desk.emit("unselected", teleop, teleop)
        self.update()

    def knows(self, teleop: str) -> bool:
        """Whether it is one of ours."""
        return teleop in self._by_name

    def forget(self, teleop: str) -> None:
        """No longer wait until others have freed its arms."""
        self._awaiting = "" if self._awaiting == teleop else self._awaiting

    def began_anew(self, teleop: str) -> None:
        """Its process has restarted: it gets the current states and runs when presence is shown again."""
        self.lapsed.add(teleop)
        # one that had stopped by itself is not requested again by this
        self.asked[teleop] = self.word(self._by_name[teleop]) if teleop in self.fallen else ""
        self._unreported.pop(teleop, None)
        if self.clutch:
            self._report_clutch(teleop, PAYLOADS[PRESSED])

    def refused(self, teleop: str, now_ns: int) -> None:
        """It refused the request; the request is repeated after a delay."""
        self.asked[teleop] = ""
        self._again_ns[teleop] = now_ns + REFUSED_NS

    def shows(self, teleop: str, desired: str) -> None:
        """The desired state in a teleoperation's record; DISABLED although requested: an error has stopped it."""
        if desired == DISABLED and self.asked[teleop] in (ENABLE, ALIGN):
            self.fallen.add(teleop)
        else:
            self.fallen.discard(teleop)

    def _pick_up(self) -> None:
        self.asked.update(dict.fromkeys(self.fallen, ""))
        self.fallen.clear()

    # -- consequences --------------------------------------------------------------------------------------------------

    def word(self, member: Selectable) -> str:
        """The command that a teleoperation should have now."""
        turn = self.camera if member.kind == ECM else not self.camera
        if not (turn and self.wanted and member.name in self.selected):
            return DISABLE
        if member.kind == ECM:
            return ENABLE if member.name not in self.lapsed else DISABLE
        return ENABLE if self.operator and member.name not in self.lapsed else ALIGN

    def update(self, now_ns: int | None = None) -> None:
        """Send the commands that are due; those that stop first. None: refused ones, too."""
        self._yield()
        words = [(self.word(member), member.name) for member in self.mine]
        for word, name in sorted(words, key=lambda row: row[0] != DISABLE):
            due = word != self.asked[name] and (now_ns is None or now_ns >= self._again_ns[name])
            if due and self._desk.ask(name, "state_command", text=word, origin=self.origin):
                self.asked[name] = word

    def step(self, now_ns: int) -> None:
        """Once a cycle: complete pending actions."""
        if self._awaiting:
            self.select(self._awaiting)
        self.update(now_ns)
        for teleop, value in list(self._unreported.items()):
            self._report_clutch(teleop, value)

    def _report_clutch(self, teleop: str, value: float) -> None:
        if self._desk.ask(teleop, "clutch", (value,)):
            self._unreported.pop(teleop, None)
        else:
            self._unreported[teleop] = value

    def _yield(self) -> None:
        """Two consoles selected teleoperations that share an arm: the first one in the document keeps its own."""
        for member in self.mine:
            if member.name not in self.selected:
                continue
            for other in conflicts(member, self._members):
                if other.name in self.elsewhere and self._members.index(other) < self._members.index(member):
                    self.selected.discard(member.name)
                    self._desk.status(f"{member.name} unselected to free {shared_arm(member, other)}")
                    self._desk.emit("unselected", member.name, member.name)
                    break
