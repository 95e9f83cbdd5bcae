"""The commands of the system; refusals have a reason."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial

from trocar.procs.crtk.names import none_such
from trocar.procs.node.requests import ANSWERED, CommandRefused, Handler, carry_out, has_left
from trocar.procs.system.bring_up import POWER_OFF, POWER_ON, ArmOnRing, BringUp
from trocar.procs.system.sound import BEEPS, SPEECH, Sound
from trocar.procs.tables import codes
from trocar.procs.tables.bring_up import HOME
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.received import Request
from trocar.shm.system.events import Events

BEEP_S, BEEP_HZ = 0.3, 3000.0
MIN_S, MAX_S = 0.05, 60.0
SHOWN = 8  # joint positions in a pose
LOWEST_HZ, HIGHEST_HZ = 20.0, 10_000.0


class SystemCommands:
    """One method per row of the `system` command table."""

    def __init__(self, arms: Sequence[ArmOnRing], consoles: Sequence[LoopClient], events: Events, sound: Sound,
                 volume: float, drawn: Collection[str]) -> None:
        """`consoles` are the mailboxes of all consoles, `drawn` the arms of which a pose can be shown."""
        self._arms, self._consoles, self._events, self._sound = arms, consoles, events, sound
        self.volume, self.beeps = volume, 0
        self.bring_up: BringUp | None = None
        self._asked: list[Request] = []
        """Requests that wait for the end of `bring_up`."""
        self._stops: list[Callable[[], object]] = []
        """What stops consoles and arms, tried in each cycle until it is sent."""
        self._holds: list[Request] = []
        """Requests that wait for that."""
        self._drawn = drawn
        self._shows: tuple[Request, int] | None = None
        """The request that shows a pose, with its program, while that runs."""
        self._now_ns = 0
        self._table: dict[str, Handler] = {
            **dict.fromkeys((POWER_ON, HOME, POWER_OFF), self._begin), "hold": self._hold,
            "set_volume": self._set_volume, "beep": self._beep, "string_to_speech": self._say,
            "show_pose": self._show,
        }

    def execute(self, requests: Iterable[Request], now_ns: int) -> None:
        """Execute new requests, then continue a bring-up that is under way."""
        self._now_ns = now_ns
        for request in requests:
            carry_out(request, self._table[request.name])
        self._stops = [send for send in self._stops if not send()]
        if not self._stops:
            for request in self._holds:
                request.done()
            self._holds.clear()
        if self._shows is not None and has_left(*self._shows):
            self._shows = None
        if self.bring_up is not None:
            self.bring_up.step(now_ns)
            if self.bring_up.is_over:
                self._end(self.bring_up)

    @property
    def shown(self) -> tuple[str, Sequence[float]]:
        """The arm of which a pose is shown, and its joint positions; "": none."""
        return (self._shows[0].text.strip(), self._shows[0].values.tolist()) if self._shows is not None else ("", ())

    def beep(self, duration_s: float = BEEP_S, frequency_hz: float = BEEP_HZ, volume: float | None = None) -> None:
        """Emit the event and sound a beep, by default at the system's volume."""
        loud = self.volume if volume is None else volume
        self.beeps += 1
        self._events.emit("beep", f"{duration_s:g} s, {frequency_hz:g} Hz", value=duration_s, limit=frequency_hz)
        self._sound.beep(duration_s, frequency_hz, loud)

    def _begin(self, request: Request) -> str:
        if self.bring_up is not None and self.bring_up.goal != request.name:
            self._answer(f"{request.name} was requested")
        if request.name == POWER_OFF:
            self._stop_teleop()
        self._events.status(f"system: {request.name}", "system")
        request.accept()
        self.bring_up = BringUp(request.name, self._arms, self._now_ns, request.origin)
        self._asked.append(request)
        return ANSWERED

    def _hold(self, request: Request) -> str:
        """Arms are held from here, too: what this process has just sent to them comes before."""
        if self.bring_up is not None and self.bring_up.goal != POWER_OFF:
            self.bring_up = None
            self._answer("hold was requested")
        self._stop_teleop()
        self._stops += [partial(arm.hold, request.origin) for arm in self._arms]
        self._events.status("system: hold", "system")
        request.accept()
        self._holds.append(request)
        return ANSWERED

    def _stop_teleop(self) -> None:
        for console in self._consoles:
            console.poll()
            self._stops.append(partial(console.send, "teleop_enable", (0.0,)))

    def _end(self, bring_up: BringUp) -> None:
        self.bring_up, problems = None, bring_up.problems
        if problems:
            self._events.report(codes.SYSTEM_INCOMPLETE, f"{bring_up.goal} is not complete: {problems}", "system")
        else:
            self._events.status(f"system: {bring_up.goal} done", "system")
        self._answer(problems)

    def _answer(self, problems: str) -> None:
        for request in self._asked:
            request.fail(problems) if problems else request.done()
        self._asked.clear()

    def _set_volume(self, request: Request) -> str:
        asked = float(request.values[0])
        self.volume = min(max(asked, 0.0), 1.0)
        self._events.emit("volume", value=self.volume)
        self._events.status(f"system: volume {100.0 * self.volume:.0f} %", "system")
        if asked == self.volume:
            return ""
        self._events.report(codes.BEEP_CLIPPED, f"volume {asked:g} clipped to {self.volume:g}", "system", -1, asked,
                            self.volume)
        return f"clipped: volume {asked:g} → {self.volume:g}"

    def _beep(self, request: Request) -> str:
        given = (*map(float, request.values), *(BEEP_S, BEEP_HZ, self.volume)[len(request.values) :])
        limits = ((MIN_S, MAX_S), (LOWEST_HZ, HIGHEST_HZ), (0.0, 1.0))
        used = [min(max(value, lower), upper) for value, (lower, upper) in zip(given, limits, strict=True)]
        clipped = []
        for what, value, good in zip(("duration", "frequency", "volume"), given, used, strict=True):
            if value != good:
                clipped.append(f"{what} {value:g} → {good:g}")
                self._events.report(codes.BEEP_CLIPPED, f"beep: {what} {value:g} clipped to {good:g}", "system", -1,
                                    value, good)
        self.beep(*used)
        return "; ".join(filter(None, ("clipped: " * bool(clipped) + ", ".join(clipped), self._sound.lacks_of(BEEPS))))

    def _say(self, request: Request) -> str:
        text = request.text.strip()
        if not text:
            raise CommandRefused("takes a text")
        self._events.emit("string_to_speech", text)
        self._sound.say(text, self.volume)
        return self._sound.lacks_of(SPEECH)

    def _show(self, request: Request) -> None:
        name = request.text.strip()
        if name and name not in self._drawn:
            raise CommandRefused(none_such("arm", name, self._drawn))
        if name and not 0 < len(request.values) <= SHOWN:
            raise CommandRefused(f"takes 1 to {SHOWN} joint positions, not {len(request.values)}")
        self._shows = (request, request.pid) if name else None
