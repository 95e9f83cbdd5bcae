"""Several users' processes in one: what one of them does wrong, and what the others notice."""

from __future__ import annotations

import dataclasses
import gc
import io
import logging
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.conftest import World
from trocar.procs.document.system import Process as Row
from trocar.procs.document.system import SystemConfig
from trocar.procs.document.user_process import UserCommand, UserField, UserProcess, UserTopic
from trocar.procs.supervisor.memory import create_all
from trocar.procs.user import filters
from trocar.procs.user.filters import HostedFilter, filter_in
from trocar.procs.user.process import UserLoop
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.origins import ACTING, NO_ORIGIN
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.system.loglines import Stamped
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.tools import cli
from trocar.tools.inspect.processes import statuses
from trocar.tools.inspect.standing import first_thing

FOR_NS = 60_000_000_000  # so long a supervisor is there that beats once
DECLARED = UserProcess("good", "good.py", 0.002, (UserTopic("count", 100.0, 16, (UserField("count", "int"),)),),
                       (UserCommand("go"),), host="lab")
ROWS = tuple(Row(name, "user", 0.002, start="elsewhere", restart_limit=2, backoff_s=1.0, host="lab")
             for name in ("good", "bad"))


class Good(UserLoop):
    count = 0

    def update(self) -> None:
        self.count += 1
        self.publish("count", count=self.count)

    def on_go(self) -> None:
        pass


class Bad(Good):
    ended = 0

    def update(self) -> None:
        super().update()
        raise ZeroDivisionError("no more")

    def quit(self) -> None:
        Bad.ended += 1


class Flaky(Good):
    fails = True

    def update(self) -> None:
        super().update()
        if Flaky.fails:
            raise ZeroDivisionError("no more")


class Hanging(Good):
    def update(self) -> None:
        while True:
            pass


class StillClock:
    now_ns = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ns


class Lab:
    """Two filters, called by turns."""

    def __init__(self, name: str) -> None:
        self.name, self.made = name, list[HostedFilter]()
        self.rings: list[RingReader] = []

    def add(self, name: str, kind: type[UserLoop], most_s: float = 5.0) -> RingReader:
        row = next(row for row in ROWS if row.name == name)
        self.made.append(HostedFilter(self.name, row, lambda: kind, most_s))
        self.rings.append(directory.reader(self.name, name, "count"))
        return self.rings[-1]

    def cycle(self, times: int = 1) -> None:
        for _ in range(times):
            for each in self.made:
                each.cycle()

    def problem(self, name: str) -> str:
        return next(row.problem for row in statuses(self.name) if row.name == name)

    def told(self, name: str) -> list[str]:
        events = directory.reader(self.name, name, "events")
        rows = [row["code"].decode() for row in events.last(100)]
        events.close()
        return rows


@pytest.fixture
def lab(world: World, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    users = (DECLARED, dataclasses.replace(DECLARED, name="bad"))
    create_all(SystemConfig(world.name, "a test", "wall", (), (), None, (*ROWS, Row("lab", "filters", 0.002)),
                            users=users))
    page = ControlPage(world.name, "supervisor", write=True)
    page.field("heartbeat_ns")[...] = monotonic_ns() + FOR_NS
    page.close()
    monkeypatch.setattr(ACTING, "origin", NO_ORIGIN)
    made = Lab(world.name)
    yield made
    for each in made.made:
        each.stop()
    for ring in made.rings:
        ring.close()
    world.remove()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> StillClock:
    made = StillClock()
    monkeypatch.setattr(filters, "monotonic_ns", made)
    return made


def count(ring: RingReader) -> int:
    return int(ring.field("count")) if ring.newest() else 0


def test_each_is_called_once_a_period(lab: Lab) -> None:
    first, second = lab.add("good", Good), lab.add("bad", Good)
    lab.cycle(4)  # the first makes them
    assert count(first) == count(second) == 3
    assert {row.state for row in statuses(lab.name) if row.name in ("good", "bad")} == {"RUNNING"}


def test_one_that_raises_begins_anew_and_the_others_go_on(lab: Lab, clock: StillClock) -> None:
    Bad.ended = 0
    bad, good = lab.add("bad", Bad), lab.add("good", Good)
    lab.cycle(11)
    assert count(good) == 10 and count(bad) == 1 and Bad.ended == 1
    assert lab.problem("bad") == "failed: ZeroDivisionError: no more" and lab.problem("good") == ""
    assert lab.told("bad") == ["user-error"]
    assert first_thing([row for row in statuses(lab.name) if row.name == "bad"], []) == (
        "bad failed: ZeroDivisionError: no more: trocar restart lab; trocar logs bad may say why")
    events = directory.reader(lab.name, "bad", "events")
    assert b"trocar restart lab" in events.last(1)["hint"][0]
    events.close()
    clock.now_ns += 1_000_000_000
    lab.cycle(2)
    assert bad.head == 2 and Bad.ended == 2, "it began anew after backoff_s"
    clock.now_ns += 1_000_000_000
    lab.cycle(2)
    assert bad.head == 2, "twice as long the next time"
    clock.now_ns += 1_000_000_000
    lab.cycle(2)
    assert bad.head == 3 and lab.problem("bad").endswith("given up")
    clock.now_ns += 100_000_000_000
    lab.cycle(2)
    assert bad.head == 3 and count(good) == 18


def test_one_that_failed_says_so_until_it_has_run_well_for_a_while(lab: Lab, clock: StillClock) -> None:
    Flaky.fails = True
    lab.add("bad", Flaky)
    for _ in range(2):
        lab.cycle(2)
        clock.now_ns += 2_000_000_000
    Flaky.fails = False
    lab.cycle(2)
    assert lab.problem("bad") == "it has failed 2 times in a row: ZeroDivisionError: no more"
    clock.now_ns += 11_000_000_000
    lab.cycle()
    assert lab.problem("bad") == ""


def test_the_log_of_a_filter_is_its_lines_in_that_of_its_host(
        lab: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    (tmp_path / lab.name).mkdir()
    out = io.StringIO()
    handler = logging.StreamHandler(out)
    handler.setFormatter(Stamped("lab"))
    for name, text in (("lab", "begins"), ("bad", "ended by an error\nTraceback"), ("good", "bad luck"),
                       ("bad", "bad took 5 ms")):
        logger = logging.Logger(name)
        logger.addHandler(handler)
        logger.warning(text)
    (tmp_path / lab.name / "lab.log").write_text(out.getvalue())
    result = CliRunner().invoke(cli.build("logs"), ["logs", "bad", "--system", lab.name])
    assert [row.partition("WARNING  ")[2] or row for row in result.stdout.splitlines()] == [
        "bad: ended by an error", "Traceback", "bad took 5 ms"]
    assert CliRunner().invoke(cli.build("logs"), ["logs", "nothing", "--system", lab.name]).exit_code == 1


@pytest.mark.parametrize(("period_s", "problem"), [(0.003, ""), (0.35, "runs at 2.857 Hz instead of 500")])
def test_a_host_that_runs_at_a_fraction_of_its_rate_says_so(lab: Lab, period_s: float, problem: str) -> None:
    page = ControlPage(lab.name, "lab", write=True)
    page.segment.claim("lab")
    page.field("period_avg")[...] = page.field("period_max")[...] = period_s
    page.show("RUNNING")
    assert lab.problem("lab").partition(":")[0] == problem
    page.close()


def test_one_that_is_slow_is_named(lab: Lab, clock: StillClock) -> None:
    class Slow(Good):
        def update(self) -> None:
            clock.now_ns += 5_000_000

    lab.add("bad", Slow)
    good = lab.add("good", Good)
    lab.cycle(5)
    assert lab.told("bad") == ["user-slow"] and lab.told("good") == [] and count(good) == 4


@pytest.fixture
def no_gc_callbacks() -> Iterator[None]:
    """Those of hypothesis are Python: what the time's end raises in one of them is lost there."""
    kept = gc.callbacks[:]
    gc.callbacks.clear()
    yield
    gc.callbacks[:] = kept


@pytest.mark.usefixtures("no_gc_callbacks")
def test_one_that_hangs_is_ended(lab: Lab) -> None:
    lab.add("bad", Hanging, 0.05)
    good = lab.add("good", Good)
    lab.cycle(4)
    assert "TimeUp: it took more than 0.05 s" in lab.problem("bad") and count(good) == 3


def test_one_that_exits_ends_itself_alone(lab: Lab) -> None:
    class Exiting(Good):
        def update(self) -> None:
            sys.exit("no more")

    lab.add("bad", Exiting)
    good = lab.add("good", Good)
    lab.cycle(3)
    assert "failed: sys.exit('no more') in test_filters.py line " in lab.problem("bad") and count(good) == 2


def test_a_setup_that_fails_is_theirs_alone(lab: Lab) -> None:
    class NoSensor(Good):
        def setup(self) -> None:
            raise OSError("no sensor")

    lab.add("bad", NoSensor)
    good = lab.add("good", Good)
    lab.cycle(3)
    assert lab.problem("bad") == "failed: OSError: no sensor" and count(good) == 2


def test_none_acts_for_whom_another_was_asked_by(lab: Lab) -> None:
    seen: dict[str, list[int]] = {"good": [], "bad": []}

    class Looking(Good):
        def update(self) -> None:
            assert ACTING.origin is not None
            seen[self.name].append(ACTING.origin.id)

    for name in seen:
        lab.add(name, Looking)
    lab.cycle(2)
    person = Client(lab.name, "good")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ACTING, "origin", None)
        person.send("go")
    lab.cycle(2)
    assert seen["bad"] == [0, 0, 0] and seen["good"][0] == 0 and seen["good"][1:] == [person.origin.id] * 2
    person.close()


def test_a_filter_has_an_update_and_no_main(tmp_path: Path) -> None:
    file = tmp_path / "filter_of_a_test.py"
    file.write_text("import trocar\nclass A(trocar.Process):\n    def main(self): pass\n")
    with pytest.raises(ImportError, match="A has a main"):
        filter_in(str(file))
    file.write_text("def main(process): pass\n")
    with pytest.raises(ImportError, match="has a main"):
        filter_in(str(file))
