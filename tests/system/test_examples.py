"""Every example of the README and of each verb's help works as it stands, from a folder that is not ours."""

from __future__ import annotations

import json
import os
import re
import select
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from inspect import signature
from pathlib import Path

import pytest

from tests.old import config, three
from tests.recordings.made import a_recording
from tests.retries import retry
from tests.system.robot import COARSE_ON_BOARDS, ROOT, TELEOP_AT_500_HZ, Robot, wait_for
from tests.system.robot import VERBS as VERBS_AT_HAND
from tests.system.verb_template import FOLDER
from trocar.tools.cli import VERBS, Verb, examples_of, loaded

pytestmark = [pytest.mark.slow, pytest.mark.simulated]  # paced, as everything without hardware is

# What the script of that name does; a fifth of the turns is enough.
SHELL = f'''trocar() {{
    if [ "$1" = up ]; then set -- "$@" {" ".join(COARSE_ON_BOARDS)}; fi
    "{sys.executable}" -P -m trocar "$@"
}}
'''
ENDLESS_S = 1.0  # verbs that end only at Ctrl-C are watched for so long from their first output on
VERB_ALONE = re.compile(r"trocar [^|;&<>$*]*$")
ENDLESS = re.compile(r"trocar (echo (?!.*(--once|-n ))|bus watch (?!.*--once))")
# Those that start a system, or end one; and what needs a process of a user's own.
ALONE = re.compile(r"trocar (demo|bench|commission|up|down|set|replay)\b")
# Tests of their own: bench, commission, demo, set: test_bench_system.py, test_commission.py, test_robot.py,
# test_user_process.py.
EXAMPLES = [example for verb in VERBS for example in examples_of(verb)]


class Person:
    """Somebody at a shell, in a folder of their own, with a system that only they see."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = {**os.environ, "PYTHONPATH": str(ROOT), "TROCAR_STATE": str(folder / "state")}
        self.environment.pop("TROCAR_SYSTEM", None)
        self.environment.pop("TROCAR_RECORDER", None)  # people have one

    def types(self, line: str, timeout: float = 180.0) -> str:
        """Run a line as it stands, again where the machine was too busy for it; fails also on a traceback."""
        reported = ""

        def attempt() -> str:
            nonlocal reported
            code, reported = self._once(line, timeout)
            fine = code == 0 or (line == "trocar doctor" and "\nbad " in reported)  # such is this machine
            return "" if fine and "Traceback" not in reported else f"{code}:\n{reported}"

        problem = retry(attempt, lambda: (self.folder / "state").rglob("*.log"), line)
        assert not problem, problem
        return reported

    def _once(self, line: str, timeout: float) -> tuple[int, str]:
        """Its exit code and what it reported. What never ends is ended by Ctrl-C.

        A shell starts an interpreter, which imports for half a second, only for lines that are more than a verb.
        """
        if VERBS_AT_HAND and VERB_ALONE.match(line) and not ENDLESS.match(line):
            with tempfile.TemporaryFile() as said:
                fewer = COARSE_ON_BOARDS if line.split()[1] in ("up", "demo") else ()
                words = [*shlex.split(line)[1:], *fewer, *(TELEOP_AT_500_HZ if "demo-teleop" in line else ())]
                verb = VERBS_AT_HAND[0].begin(words, {**self.environment, FOLDER: str(self.folder)}, said.fileno())
                code = verb.wait(timeout)
                said.seek(0)
                return code, said.read().decode()
        shell = subprocess.Popen(["bash", "-c", SHELL + line], cwd=self.folder, env=self.environment, text=True,
                                 stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                 start_new_session=True)
        if ENDLESS.match(line):
            select.select([shell.stdout], [], [], timeout)  # it has begun
        try:
            reported, _ = shell.communicate(timeout=ENDLESS_S if ENDLESS.match(line) else timeout)
        except subprocess.TimeoutExpired:
            os.killpg(shell.pid, signal.SIGINT if ENDLESS.match(line) else signal.SIGKILL)
            reported, _ = shell.communicate(timeout=60)
            assert ENDLESS.match(line), f"{line}: not over after {timeout} s"
        return shell.returncode, reported


@pytest.fixture
def person(tmp_path: Path) -> Iterator[Person]:
    one = Person(tmp_path)
    one.environment["TROCAR_SYSTEM"] = f"x{os.getpid()}"
    yield one
    subprocess.run(["bash", "-c", SHELL + "trocar down"], cwd=tmp_path, env=one.environment, capture_output=True,
                   check=False)


def blocks_of(page: str, heading: str) -> list[list[str]]:
    """The blocks of a page's section, line by line without remarks."""
    section = (ROOT / page).read_text(encoding="utf-8").partition(f"## {heading}\n")[2].partition("\n## ")[0]
    blocks = [re.findall(r"    (trocar .*)", block) for block in section.split("\n\n")]
    return [[re.sub(r"\s{2,}# .*", "", line) for line in block] for block in blocks if block]


def python_of_the_readme() -> str:
    return (ROOT / "README.md").read_text(encoding="utf-8").partition("```python\n")[2].partition("```")[0]


@pytest.mark.parametrize("number", range(len(blocks_of("README.md", "Use"))))
def test_the_readme_works_as_it_stands(person: Person, number: int) -> None:
    for line in blocks_of("README.md", "Use")[number]:
        person.types(line)
        if line == "trocar stream PSM1 configs/recordings/psm-wave.csv --rate 200":
            (person.folder / "script.py").write_text(python_of_the_readme())
            person.types(f"{sys.executable} script.py")


def test_the_console_in_the_docs_works_as_it_stands(person: Person) -> None:
    (lines,) = [block for block in blocks_of("docs/teleoperation.md", "Consoles") if "kinematic-full.yaml" in block[0]]
    for line in lines:
        person.types(line)


def test_the_demo_of_teleoperation_in_the_docs_follows_to_its_end(person: Person) -> None:
    (lines,) = [block for block in blocks_of("docs/teleoperation.md", "Teleoperation") if "demo-teleop" in block[0]]
    for line in lines:
        if "MTMR_gripper" in line:
            wait_for(lambda: "waiting: pinch" in person.types("trocar status"), 60, "it is aligned")
        if "clutch" in line:
            until_it_follows(person)
        person.types(line)
        if "clutch" in line:
            person.types(line.replace("clutch 1", "clutch 0"))
            until_it_follows(person)
    person.types("trocar down")


def until_it_follows(person: Person) -> None:
    wait_for(lambda: "ENABLED, following" in person.types("trocar status"), 60, "it follows")


def files_of(examples: list[str], folder: Path) -> None:
    """What the examples name as a person's own files."""
    wave = (ROOT / "configs/recordings/psm-wave.csv").read_text()
    goal = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -0.3], [0.0, 0.0, 0.0, 1.0]]
    own = {"recorded.csv": wave, "goals.jsonl": json.dumps({"goal": goal}) + "\n",
           "my-site": config(three(attributes='HardwareVersion="QLA1" SN="28007"')).decode()}
    (folder / "my-site").mkdir()
    for name in ("monday.mcap", "tuesday.mcap"):
        assert any(name in example for example in examples), f"no example names {name} any more"
        a_recording(folder, name=name)
    for name, text in own.items():
        assert any(name in example for example in examples), f"no example names {name} any more"
        path = folder / name
        (path / "sawRobotIO1394-PSM1-28007.xml" if path.is_dir() else path).write_text(text)


def test_examples_of_help_work_on_the_demo(person: Person) -> None:
    files_of(EXAMPLES, person.folder)
    up, down = ([example for example in EXAMPLES if example.startswith(f"trocar {verb}")] for verb in ("up ", "down"))
    for line in (*up, "trocar power-on", "trocar home"):
        person.types(line)
    for line in EXAMPLES:
        if not ALONE.match(line) and not line.startswith("trocar bus") and "power-off" not in line:
            person.types(line)
    for line in ("trocar power-off", *down):
        assert line in EXAMPLES
        person.types(line)


def test_examples_of_replay_work_on_a_recording(person: Person) -> None:
    for line in ("trocar up configs/systems/kinematic.yaml --detach", "trocar power-on", "trocar home",
                 "trocar send PSM1 move_jp 0.2 -0.1 0.15 0.4 0.3 -0.2 --wait", "trocar dump monday.mcap"):
        person.types(line)
    replays = [example for example in EXAMPLES if example.startswith("trocar replay")]
    assert {option for line in replays for option in ("--arms", "--as", "--fresh") if option in line} == {
        "--arms", "--as", "--fresh"}
    for line in replays:
        person.types(line)


JSON = {  # of the verbs that print JSON: one that works on the demo, with an arm that is homed
    "up": "", "down": "", "demo": "", "bench": "", "commission": "", "replay": "",  # they start or end a system
    "bus": "", "power-on": "power-on PSM1", "home": "home PSM1", "send": "send PSM1", "status": "status",
    "stream": "stream PSM1 configs/recordings/psm-wave.csv --for 0.2", "pid": "pid show PSM1", "logs": "logs PSM1 -n 5",
    "list": "list", "hz": "hz PSM1/state IO1/state", "echo": "echo PSM1/state --once",
    "get": "get", "record": "record short PSM1 --for 0.2",
    "scope": "scope PSM1/measured_js.position[0] --before 0.2", "attach": "attach", "recordings": "recordings",
    "dump": "dump {folder}/all.mcap", "report": "report {folder}/all.tar.gz",
    "rl": "rl rollout trocar/PsmReach-v0 -n 1 -o horizon=5",
    "check": "check configs/systems/demo.yaml configs/pid/PSM.yaml",
    "new-arm": "new-arm --name PSM1 --generation Si --serial 12345 --to {folder}/new",
    "convert": "convert {folder}/console-PSM1.json --to {folder}",
    "export": "export {folder}/monday.mcap -o {folder}/monday",
    "compare": "compare {folder}/monday.mcap {folder}/monday.mcap", "doctor": "doctor", "power-off": "power-off PSM1",
    "start": "start PSM1", "restart": "restart PSM1 --yes", "stop": "stop PSM1 --yes",
}


def prints_json(verb: Verb) -> bool:
    """Whether a verb, or one in it, takes --json."""
    return any(map(prints_json, verb.parts)) if verb.parts else "as_json" in signature(loaded(verb.door)).parameters


def test_json_is_one_object_a_line_for_every_verb(person: Person) -> None:
    assert [verb.name for verb in VERBS if prints_json(verb) and verb.name not in JSON] == []
    (person.folder / "console-PSM1.json").write_text(json.dumps({"arms": []}))
    a_recording(person.folder, name="monday.mcap")
    rows = person.types("trocar up demo.yaml --detach --json 2>/dev/null").splitlines()
    person.types("trocar power-on; trocar home")
    robot = Robot(person.environment["TROCAR_SYSTEM"], person.folder / "state")
    for verb in VERBS:
        if JSON.get(verb.name):
            rows += robot.types(*JSON[verb.name].format(folder=person.folder).split(), "--json").stdout.splitlines()
    rows += person.types("trocar down --json 2>/dev/null").splitlines()
    assert len(rows) > len(JSON) and all(isinstance(json.loads(row), dict) for row in rows)


def test_examples_of_buses_work_with_boards_on_the_desk(person: Person) -> None:
    """The boards of a real desk are at 169.254.0.100; here they are emulated, at an address of their own."""
    address = f"127.77.{os.getpid() % 250}.16"
    emulation = {"buses": {"desk": {"address": address, "controllers": {"0": {}}}}}
    system = {"$id": "dvrk-system.schema.json", "$version": "1",
              "trocar": {"boards": "emulated", "emulation": emulation}}
    (person.folder / "desk.json").write_text(json.dumps(system))
    person.types("trocar up desk.json --detach")
    for line in EXAMPLES:
        if line.startswith("trocar bus"):
            there = re.sub(r"\budp(:\S+)?", f"udp:{address}", line)
            person.types(f"{there} --yes" if "write" in there else there)  # it asks, but only at a terminal
    rows = person.types(f"trocar bus scan udp:{address} --json 2>/dev/null").splitlines()
    assert rows and all(isinstance(json.loads(row), dict) for row in rows)
