"""`trocar commission`: what is due, what is refused, what the report keeps; stages themselves are stood in for."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import subprocess
import sys
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from tests import stock
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.shm.memory.segment import Identity
from trocar.tools.cli import build
from trocar.tools.commission import verb
from trocar.tools.commission.finding import Finding, Outcome
from trocar.tools.commission.stages import NAMES, CommissionStage
from trocar.tools.commission.subject import carts_of, subjects_of
from trocar.tools.new_arm.verb import new_arm
from trocar.tools.output.errors import Problem
from trocar.tools.systems import report_file
from trocar.tools.systems.supervising import StartRequest

WITH_CHILD = """
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"])
print(child.pid, flush=True)
child.wait()
"""
DEMO = PROJECT_CONFIGS / "systems" / "demo.yaml"
Run = Callable[..., Result]


@pytest.fixture
def kinematic(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Outcome | Problem]:
    """Stages end as this says, or well; no system is started, and `ran` notes which did."""
    outcomes: dict[str, Outcome | Problem] = {}
    monkeypatch.chdir(tmp_path)

    def load(stage: CommissionStage) -> Callable[..., Outcome]:
        def run(bench: object, *_: object, **__: object) -> Outcome:
            ran.append(stage.name)
            outcome = outcomes.get(stage.name, Outcome(figures={"volts": 2.5}))
            if isinstance(outcome, Problem):
                raise outcome
            return outcome
        return run

    @contextlib.contextmanager
    def running(job: verb.Job, clock: str) -> Iterator[None]:
        jobs.append(job)
        clocks.append(clock)
        yield  # stages that are stood in for look at nothing

    monkeypatch.setattr(CommissionStage, "load", load)
    monkeypatch.setattr(verb, "_running", running)
    ran.clear()
    clocks.clear()
    return outcomes


ran: list[str] = []
jobs: list[verb.Job] = []
clocks: list[str] = []


def _run(*words: str, file: Path = DEMO) -> Result:
    return CliRunner().invoke(build("commission"), ["commission", str(file), "--boards", "emulated", "--yes", *words])


def _tries(path: str = "commission-demo.json") -> list[dict[str, object]]:
    tries: list[dict[str, object]] = json.loads(Path(path).read_text())["tries"]
    return tries


def test_all_stages_run_in_order_and_are_reported(kinematic) -> None:
    assert _run().exit_code == 0
    assert tuple(ran) == NAMES
    rows = _tries()
    assert [row["stage"] for row in rows] == list(NAMES)
    assert all(row["passed"] and row["figures"] == {"volts": 2.5} and row["boards"] == "emulated" for row in rows)
    ran.clear()
    assert "all stages have passed" in _run().output
    assert ran == []


def test_a_rehearsal_is_in_simulated_time_but_where_a_watchdog_is_measured(kinematic) -> None:
    assert _run().exit_code == 0
    assert clocks == ["paced", "wall", "paced"]


def test_a_stage_in_real_time_is_rehearsed_again_and_says_that_a_busy_computer_may_stop_it(kinematic) -> None:
    kinematic["stop"] = Outcome([Finding("IO1, board 6", "its watchdog did not act", "0.03 s", "have it checked")])
    stopped = _run()
    assert stopped.exit_code == 1 and ran == [*NAMES[: NAMES.index("stop")], *["stop"] * verb.REHEARSALS]
    assert "the load of other programs" in " ".join(stopped.output.split())
    assert len([row for row in _tries() if row["stage"] == "stop"]) == 1
    kinematic.clear()
    kinematic["home"] = Problem("PSM1: tracking")
    assert "the load of other programs" not in _run().output


def test_a_rerun_goes_on_at_the_stage_that_stopped(kinematic) -> None:
    kinematic["axis"] = Outcome([Finding("PSM1 axis 2, board 6", "moves by -0.03 rad", "forwards",
                                         "turn the plug round")])
    stopped = _run()
    assert stopped.exit_code == 1
    assert "STOP PSM1 axis 2, board 6: moves by -0.03 rad; allowed: forwards; turn the plug round" in stopped.output
    assert ran == ["scan", "read", "power", "currents", "tables", "brakes", "axis"]
    assert _tries()[-1]["problems"] == ["PSM1 axis 2, board 6: moves by -0.03 rad; allowed: forwards; turn the plug "
                                        "round"]
    ran.clear()
    kinematic.clear()
    assert _run().exit_code == 0
    assert ran == list(NAMES[NAMES.index("axis"):])


def test_one_stage_can_be_repeated_but_none_left_out(kinematic) -> None:
    assert "stage axis comes after scan, which has not passed" in _run("--stage", "axis").output
    first = _run("--stage", "scan")
    assert first.exit_code == 0 and "stage scan passed; next: read" in first.output and "all done" not in first.output
    assert ran == ["scan"]
    assert _run("--stage", "scan").exit_code == 0
    assert len(_tries()) == 2
    assert _run("--stage", "dance").exit_code == 2


def test_a_repeated_stage_that_stops_is_due_again(kinematic) -> None:
    _run()
    kinematic["power"] = Outcome([Finding("PSM1", "no supply", "one", "switch it on")])
    assert _run("--stage", "power").exit_code == 1
    ran.clear()
    kinematic.clear()
    assert _run().exit_code == 0
    assert ran == list(NAMES[NAMES.index("power"):])


def test_other_files_or_arms_begin_anew(kinematic, tmp_path: Path) -> None:
    _run()
    ran.clear()
    assert _run("--arm", "PSM1").exit_code == 0
    assert tuple(ran) == NAMES
    text = (PROJECT_CONFIGS / "io" / "PSM1-demo.yaml").read_text()
    for pattern, begins in (("offset: 1.7145}", "all stages"), ("scale: -7.722695805e-6", "== scan")):
        (tmp_path / "io").mkdir(exist_ok=True)
        assert pattern in text
        changed = text.replace(pattern, "offset: 1.7}" if "offset" in pattern else "scale: -7.8e-6")
        (tmp_path / "io" / "PSM1-demo.yaml").write_text(changed)
        assert begins in _run().output  # a calibrated potentiometer is no other robot, another scale is


def test_an_arm_whose_currents_are_not_calibrated_starts_and_gets_no_further_than_measuring_them(
        kinematic, tmp_path: Path) -> None:
    (tmp_path / "io").mkdir()
    file, text = tmp_path / "io" / "PSM1-demo.yaml", (PROJECT_CONFIGS / "io" / "PSM1-demo.yaml").read_text()
    nominal = re.sub(r"(current_to_bits: .*offset: )[^}]*", r"\g<1>32768.0", text)
    file.write_text(nominal)
    made = tmp_path / "PSM1-demo-rehearsed.json"
    kinematic["currents"] = Outcome(figures={"amperes": 0.0}, files=[made])
    first = _run()
    assert first.exit_code == 0 and ran == ["scan", "read", "power", "currents"]
    assert verb.is_calibrating(jobs[-1].document) and verb.CALIBRATING in jobs[-1].request.sets
    put = f"in a copy of the folder, put {made.name} in the place of PSM1-demo.yaml"
    assert f"to rehearse the rest: {put}, and run the same command there" in " ".join(first.output.split())
    refused = _run()
    assert refused.exit_code == 1
    assert f"nominal current offsets: {put} (--stage currents repeats" in " ".join(refused.output.split())
    file.write_text(text)
    assert _run().exit_code == 0 and tuple(ran) == NAMES
    assert not verb.is_calibrating(jobs[-1].document)


def test_a_stage_that_has_nothing_to_write_leads_to_the_next_one(kinematic, tmp_path: Path) -> None:
    new_arm(name="PSM1", generation="Si", serial="23456", to=tmp_path)
    kinematic["currents"] = Outcome()
    assert _run(file=tmp_path / "system-PSM1.json").exit_code == 0
    assert ran == ["scan", "read", "power", "currents", "tables"]


def test_no_arm_homes_in_calibration_mode(kinematic) -> None:
    assert _run("--set", verb.CALIBRATING).exit_code == 0 and ran[-1] == "currents"
    for last in ("tables", "brakes", "calibrate"):
        assert _run("--set", verb.CALIBRATING).exit_code == 0 and ran[-1] == last
    refused = _run("--set", verb.CALIBRATING)
    assert refused.exit_code == 1 and "no arm homes in calibration mode" in refused.output
    assert ran[-1] == "calibrate"


def test_what_the_system_says_is_a_finding_like_any_other(kinematic) -> None:
    kinematic["home"] = Problem("PSM1: not homed in time")
    stopped = _run()
    assert stopped.exit_code == 1
    assert "STOP stage home: PSM1: not homed in time; docs/errors.md has causes and remedies\n" in stopped.output
    assert "trocar logs --system commission " in stopped.output
    assert ran[-1] == "home"


def test_the_stages_are_listed_with_what_they_stop_at(kinematic) -> None:
    kinematic["power"] = Outcome([Finding("PSM1", "no supply", "one", "switch it on")])
    _run()
    rows = [json.loads(line) for line in _run("--list", "--json").output.splitlines()]
    assert [row["state"] for row in rows] == ["passed", "passed", "stopped", *[""] * (len(NAMES) - 3)]
    assert all(row["stops_at"] for row in rows)
    assert ran == ["scan", "read", "power"]


def test_a_real_robot_is_never_commissioned_without_a_person(kinematic, tmp_path: Path) -> None:
    real = tmp_path / "real.yaml"
    real.write_text(DEMO.read_text().replace("boards: emulated", "boards: real"))
    words = ["commission", str(real), "--yes"]
    refused = CliRunner().invoke(build("commission"), words)
    assert refused.exit_code == 2
    assert "--yes is for emulated boards" in refused.output
    assert ran == []


def test_a_rehearsal_never_writes_into_the_files_of_the_robot(kinematic) -> None:
    result = _run("--write")
    assert result.exit_code == 2 and "rehearsal" in result.output and ran == []


def test_a_report_that_cannot_be_written_is_refused_before_anything_starts(kinematic, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    refused = _run("--report", str(tmp_path / "file" / "book.json"))
    assert refused.exit_code == 1 and ran == []
    assert "cannot be written: Not a directory; --report names another file" in " ".join(refused.output.split())
    assert _run("--stage", "scan").exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"file", "commission-demo.json"}  # nothing beside them


def test_a_second_commissioning_names_the_first_one(kinematic, monkeypatch: pytest.MonkeyPatch) -> None:
    with subprocess.Popen([sys.executable, "-c", WITH_CHILD, "trocar", "commission"], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE) as first:
        assert first.stdout is not None
        identity = Identity(int(first.stdout.readline()), 0, 0, "supervisor")
        monkeypatch.setattr(verb, "supervisor_of", lambda system: identity)
        refused = _run()
    assert refused.exit_code == 1 and ran == []
    assert f"a commissioning runs already (pid {first.pid}, system commission)" in refused.output
    assert "trocar down" not in refused.output


def test_the_list_of_real_boards_says_what_a_rehearsal_has_passed(kinematic, tmp_path: Path) -> None:
    assert _run("--stage", "scan").exit_code == 0
    real = tmp_path / DEMO.name
    real.write_text(DEMO.read_text().replace("boards: emulated", "boards: real"))
    listed = CliRunner().invoke(build("commission"), ["commission", str(real), "--list"])
    assert "1 of 14 stages have passed in a rehearsal: --boards emulated lists those" in " ".join(listed.output.split())


def test_what_is_no_report_is_left_alone(kinematic, tmp_path: Path) -> None:
    other = tmp_path / "notes.json"
    other.write_text("{}")
    refused = _run("--report", str(other))
    assert refused.exit_code == 1
    assert "is no report of commissioning" in refused.output
    assert other.read_text() == "{}"
    _run("--report", str(tmp_path / "book.json"))
    copy = tmp_path / "demo2.yaml"
    copy.write_text(DEMO.read_text())
    assert "is the report of demo.yaml" in _run("--report", str(tmp_path / "book.json"), file=copy).output


def test_a_system_without_boards_has_nothing_to_commission(kinematic) -> None:
    refused = _run(file=PROJECT_CONFIGS / "systems" / "kinematic.yaml")
    assert refused.exit_code == 1
    assert "no robot on boards" in refused.output


def test_an_arm_that_is_not_there_is_refused_with_those_that_are(kinematic) -> None:
    refused = _run("--arm", "PSM1", "--arm", "ECM")
    assert refused.exit_code == 1 and "no arm on boards ECM" in refused.output and "PSM1" in refused.output


def test_without_a_terminal_a_person_cannot_be_asked_and_nothing_starts(kinematic) -> None:
    refused = CliRunner().invoke(build("commission"), ["commission", str(DEMO), "--boards", "emulated"])
    assert refused.exit_code == 2
    assert "no terminal" in refused.output
    assert ran == []


def test_a_rehearsal_is_easy_on_the_machine_unless_it_is_told_otherwise(kinematic) -> None:
    assert _run("--set", "io.period_s=0.001").exit_code == 0
    sets = jobs[-1].request.sets
    assert sets.index("io.period_s=0.002") < sets.index("io.period_s=0.001")  # the last one counts
    assert {"processes.IO1.late_s=0.5", "processes.PSM1.late_s=0.5"} <= set(sets)


@pytest.mark.parametrize("pressed", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_try_is_recorded(kinematic, monkeypatch: pytest.MonkeyPatch, pressed: signal.Signals) -> None:
    def interrupted(*_: object) -> Outcome:
        signal.raise_signal(pressed)
        raise AssertionError

    monkeypatch.setattr(verb, "_tried", interrupted)
    ended = _run()
    assert ended.exit_code == 130
    assert "stopped by Ctrl-C; everything is off; the same command resumes with the interrupted stage" in \
        " ".join(ended.output.split())
    (tried,) = json.loads(Path("commission-demo.json").read_text())["tries"]
    assert not tried["passed"] and "interrupted" in tried["problems"][0]


def test_report_files_and_versions_are_packed_into_one_archive(
        kinematic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(report_file, "findings", lambda: iter(()))
    made = [tmp_path / name for name in ("PSM1-demo-rehearsed.json", "io/PSM1.json", "arm/PSM1.json")]
    for file in made:
        file.parent.mkdir(exist_ok=True)
        file.write_text("{}")
    kinematic["scan"] = Outcome(files=made)
    assert _run("--stage", "scan").exit_code == 0
    assert _tries()[0]["made"] == ["PSM1-demo-rehearsed.json", "io/PSM1.json", "arm/PSM1.json"]
    ran.clear()
    packed = _run("--pack", "all.tar.gz")
    assert packed.exit_code == 0 and not ran, packed.output
    with tarfile.open("all.tar.gz") as tar:
        names = {name.partition("/")[2] for name in tar.getnames()}
    assert {"versions.json", "CONTENTS.txt", "files/commission-demo.json", "files/demo.yaml",
            "files/PSM1-demo-rehearsed.json",
            *(f"files/{each}" for each in ("arms/PSM1-demo.yaml", "io/PSM1-demo.yaml", "io/PSM1.json", "arm/PSM1.json"))
            } <= names



def test_setup_joints_alone_wait_for_no_value_of_an_arm_but_for_those_of_their_brakes(tmp_path: Path) -> None:
    loaded = load_system(stock.find("dvrk-site/jhu-daVinci/system-SUJ.json"), search=[stock.find("dvrk-share")])
    demo = load_system(DEMO, boards="emulated").system
    assert loaded.system is not None and demo is not None
    others = tuple(replace(io, name="IO2") for io in loaded.system.ios)
    ios = tuple(replace(io, calibration_mode=True) for io in (*demo.ios, *others))
    both = replace(demo, carts=tuple(replace(cart, io="IO2") for cart in loaded.system.carts), ios=ios)
    assert [subject.name for subject in subjects_of(both)] == ["PSM1"] and not subjects_of(both, ["SUJ"])
    assert [cart.name for cart in carts_of(both)] == ["SUJ"] == [cart.name for cart in carts_of(both, ["SUJ"])]
    assert not carts_of(both, ["PSM1"]) and not carts_of(demo)
    book = verb.CommissionReport(tmp_path / "book.json", DEMO.name)

    def lacks(*arms: str) -> list[str]:
        job = verb.Job(StartRequest(DEMO, "x"), both, list(arms), None, False)
        return [stage for _, stage in verb._lacks(job, book, "")]

    assert "calibrate" in lacks() and "calibrate" in lacks("PSM1") and lacks("SUJ") == []
    (place,) = (place for io in both.ios for place in io.places if place.robot.name == "SUJ")
    same = tuple(replace(one, current_to_bits=replace(one.current_to_bits, offset=32768.0))
                 for one in place.robot.actuators)
    nominal = replace(place.robot, actuators=same)
    both = replace(both, ios=tuple(replace(io, robots=tuple(nominal if robot.name == "SUJ" else robot
                                                            for robot in io.robots)) for io in both.ios))
    assert lacks("SUJ") == ["currents"] and "currents" not in lacks("PSM1")
    job = verb.Job(StartRequest(DEMO, "x"), both, ["SUJ"], None, False)
    assert [row.name for row in verb._due(job, book, "", "")] == ["scan", "read", "power", "currents"]
    for stage in NAMES[:4]:
        book.add(stage, Outcome(), 1.0, "real", "")
    with pytest.raises(Problem, match=r"SUJ: .* nominal current offsets: put the new files in the place"):
        verb._due(replace(job, document=replace(both, emulation=None)), book, "", "")
