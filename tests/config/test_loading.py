"""Where files are found, what the command line changes, and how emulated boards replace real ones."""

from __future__ import annotations

import grp
import os
import pwd
import shutil
from pathlib import Path

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.config import Machine, check_file
from trocar.procs.config.loading.emulated import default_addresses
from trocar.procs.config.read.source import SourceFile

IO = "io/PSM1-demo.yaml"


def test_set_changes_the_section_of_trocar(home: Home) -> None:
    sets = [
        "trocar.io.period_s=1e-3",
        "io.spin_us=20",
        "io.current_error_a=0.5",
        "processes.PSM1.cpu=1",
        "clock=lockstep",
        "arm.use_setpoint_v=false",
    ]
    loaded = home.load(sets=sets)
    system = loaded.system
    assert system is not None
    assert (system.io("IO1").current_error_a, system.io("IO1").current_error_s) == (0.5, 0.05)
    assert (system.io("IO1").period_s, system.io("IO1").spin_us, system.clock) == (0.001, 20.0, "lockstep")
    assert system.process("IO1").period_s == 0.001 and system.process("PSM1").cpus == (1,)
    assert not system.arm("PSM1").use_setpoint_v


def test_set_accepts_a_mapping(home: Home) -> None:
    group, user = grp.getgrgid(0).gr_name, pwd.getpwuid(os.getuid()).pw_name
    system = home.load(sets=["supervisor_lost_s=2", f"group={group}", f"service_user={user}"]).system
    assert system is not None
    assert (system.supervisor_lost_s, system.group, system.service_user) == (2.0, group, user)


@pytest.mark.parametrize(("given", "key", "allowed"), [
    ("io.period=1e-3", "trocar.io.period", "period_s"), ("io.period_s=fast", "trocar.io.period_s", "a number"),
    ("io.spin_us=1000", "trocar.io.spin_us", "up to 50"), ("io.period_s", "", "key=value"),
    ("io..x=1", "io..x", "dots"), ("io=[", "io", "YAML"), ("clock.x.y=1", "trocar.clock", "wall"),
    ("IOs.0.port=udp", "trocar.IOs", "clock"),
    ("processes.PSM1.hung_s=0.01", "trocar.processes.PSM1.hung_s", "from 0.1 up to 86400"),
    ("processes.PSM9.cpu=1", "trocar.processes.PSM9", "PSM1"),
    ("service_user=no-such-user", "trocar.service_user", "a user of this machine")])
def test_wrong_set_is_named_as_such(home: Home, given: str, key: str, allowed: str) -> None:
    problem = home.error(sets=[given])
    assert problem.file == "--set" and problem.key == key and allowed in problem.allowed
    assert str(problem).startswith("--set: error: ")


def test_values_of_single_processes_win(home: Home) -> None:
    home.edit(
        SYSTEM,
        "boards: emulated",
        """boards: emulated
  io: {period_s: 0.0005, priority: 40}
  arm: {priority: 30, period_s: 0.0005}
  processes:
    IO1: {priority: 50, on_exit: stay-down, restart_limit: 1, backoff_s: 0.5}
    PSM1: {period_s: 0.002, cpu: 0, late_s: 0.2, hung_s: 86400}""",
    )
    system = home.load().system
    assert system is not None
    io, arm = system.process("IO1"), system.process("PSM1")
    assert (io.period_s, io.priority, io.on_exit, io.restart_limit, io.backoff_s) == (0.0005, 50, "stay-down", 1, 0.5)
    assert (arm.period_s, arm.priority, arm.cpus) == (0.002, 30, (0,))
    assert (arm.late_s, arm.hung_s, io.late_s, io.hung_s) == (0.2, 86400.0, None, None)
    assert system.arm("PSM1").period_s == 0.002 and system.io("IO1").period_s == 0.0005


def test_written_period_is_used_as_written(home: Home) -> None:
    home.edit(SYSTEM, "port: udp", "port: udp\n    period: 0.000606667")
    system = home.load().system
    assert system is not None and system.io("IO1").period_s == 0.000606667
    assert system.process("IO1").period_s == 0.000606667


def test_working_folder_comes_first_and_path_before_configs(home: Home, tmp_path: Path) -> None:
    other = tmp_path / "other"
    for folder in (other, tmp_path / "elsewhere"):
        (folder / "pid").mkdir(parents=True)
        shutil.copy(home.path / "pid/PSM.yaml", folder / "pid/PSM.yaml")
    system = home.load(search=[other]).system
    assert system is not None and system.ios[0].pids[0].source == str(tmp_path / "elsewhere/pid/PSM.yaml")
    (tmp_path / "elsewhere/pid/PSM.yaml").unlink()
    system = home.load(search=[other]).system
    assert system is not None and system.ios[0].pids[0].source == str(other / "pid/PSM.yaml")


def test_a_folder_of_the_command_line_that_does_not_exist_is_an_error(home: Home) -> None:
    absent = home.path / "nowhere"
    problem = home.error(search=[absent])
    assert (problem.file, problem.value) == ("--path", str(absent))
    for file in (SYSTEM, "pid/PSM.yaml"):
        assert problem in check_file(home.path / file, search=[absent], configs=home.path).problems


def test_settings_path_is_meant_from_the_system_file(home: Home) -> None:
    (home.path / "systems/mine/pid").mkdir(parents=True)
    shutil.copy(home.path / "pid/PSM.yaml", home.path / "systems/mine/pid/PSM.yaml")
    home.edit(SYSTEM, "\ntrocar:", "\nsettings: {path: [mine]}\ntrocar:")
    system = home.load().system
    assert system is not None and system.ios[0].pids[0].source == str(home.path / "systems/mine/pid/PSM.yaml")


def test_default_names_are_built_from_name_and_serial(home: Home) -> None:
    home.edit(SYSTEM, "    arm_file: arms/PSM1-demo.yaml\n", "")
    home.edit(SYSTEM, "    IO_file: io/PSM1-demo.yaml\n", "")
    home.edit(SYSTEM, "    PID_file: pid/PSM.yaml\n", "")
    shutil.copy(home.path / "arms/PSM1-demo.yaml", home.path / "systems/PSM1-demo.yaml")
    shutil.copy(home.path / IO, home.path / "systems/sawRobotIO1394-PSM1-demo.yaml")
    loaded = home.load()
    assert loaded.errors == () and loaded.system is not None
    assert loaded.system.ios[0].pids[0].source.endswith("pid/PSM.yaml")


def test_null_and_empty_count_as_absent(home: Home) -> None:
    home.edit(SYSTEM, "port: udp", "port: udp\n    protocol: null\n    configuration_files: []")
    home.edit(IO, "tolerances:  # 5°, 5 mm", "coupling: {}\n      tolerances:")
    system = home.load().system
    assert system is not None and system.ios[0].protocol == "broadcast-query-read-write"


def test_short_protocol_names_are_spelled_out(home: Home) -> None:
    home.edit(SYSTEM, "port: udp", "port: udp\n    protocol: srw")
    system = home.load().system
    assert system is not None and system.ios[0].protocol == "sequential-read-write"


def test_real_boards_keep_their_port(home: Home) -> None:
    home.edit(SYSTEM, "boards: emulated", "boards: real")
    system = home.load().system
    assert system is not None and system.emulation is None and system.notes == ()
    assert system.ios[0].port == "udp"
    assert [row.name for row in system.processes] == ["IO1", "PSM1", "system"] and system.process("IO1").after == ()


def test_command_line_decides_over_the_file(home: Home) -> None:
    real = home.load(boards="real").system
    assert real is not None and real.emulation is None
    assert home.error(boards="simulated").file == "--boards"


@pytest.mark.parametrize("port", ["fw", "fw:1", "2", "udp:10.0.0.4", "udpfw", "eth:0", "eth:enp3s0", "ethfw"])
def test_every_port_that_can_be_opened_is_accepted(home: Home, port: str) -> None:
    home.edit(SYSTEM, "port: udp", f"port: '{port}'")
    loaded = home.load(boards="real")
    assert loaded.system is not None and loaded.warnings == ()
    assert loaded.system.ios[0].port == port


def test_a_file_that_is_in_no_folder_is_told_how_to_add_one(home: Home) -> None:
    home.edit(SYSTEM, "pid/PSM.yaml", "pid/theirs.json")
    assert "--path" in str(home.error())


def test_port_that_only_a_controller_itself_can_open_is_an_error_but_for_emulated_boards(home: Home) -> None:
    home.edit(SYSTEM, "port: udp", "port: emio")
    assert home.load().errors == ()
    assert home.error(boards="real").key == "IOs[0].port"


def test_every_bus_has_an_address_of_its_own(home: Home) -> None:
    second = (home.path / IO).read_text().replace("PSM1", "PSM2").replace("board_id: 6", "board_id: 8")
    (home.path / "io/PSM2-demo.yaml").write_text(second)
    home.edit(SYSTEM, "    port: udp\n", "    port: udp\n  - {name: IO2, port: udp}\n")
    arm = "  - {name: PSM2, type: PSM, serial: demo, IO: IO2, arm_file: arms/PSM1-demo.yaml,\n"
    home.edit(SYSTEM, "\ntrocar:", f"{arm}     IO_file: io/PSM2-demo.yaml, PID_file: pid/PSM.yaml}}\n\ntrocar:")
    loaded = home.load(machine=Machine(lambda index: f"127.9.9.{16 * (index + 1)}"))
    assert loaded.errors == () and loaded.system is not None and loaded.system.emulation is not None
    rows = [(bus.io, bus.address, [c.board_id for c in bus.controllers]) for bus in loaded.system.emulation.buses]
    assert rows == [("IO1", "127.9.9.16", [6, 7]), ("IO2", "127.9.9.32", [7, 8])]
    assert [io.port for io in loaded.system.ios] == ["udp:127.9.9.16", "udp:127.9.9.32"]
    assert loaded.system.process("PSM2").after == ("IO2",)


def test_addresses_depend_on_the_system_and_stay_in_127() -> None:
    first, again, other = default_addresses("one"), default_addresses("one"), default_addresses("two")
    assert first(0) == again(0) != other(0)
    assert first(0).startswith("127.") and [first(k).rsplit(".", 1)[1] for k in range(3)] == ["16", "32", "48"]
    assert not any(default_addresses(str(n))(0).startswith("127.0.") for n in range(2000))


def test_instrument_put_into_a_manual_arm_is_loaded(home: Home) -> None:
    home.edit("arms/PSM1-demo.yaml", "tool_detection: FIXED\ntool:", "tool_detection: MANUAL\n#")
    home.edit(SYSTEM, "boards: emulated", 'boards: emulated\n  emulation: {instruments: {PSM1: ":400006"}}')
    system = home.load().system
    assert system is not None and system.emulation is not None
    assert system.arms[0].tool is None
    assert [tool.name for tool in system.arms[0].tools][:1] == ["LARGE_NEEDLE_DRIVER:400006"]
    assert system.emulation.instruments == (("PSM1", "LARGE_NEEDLE_DRIVER:400006"),)


def test_system_name_must_be_usable(home: Home) -> None:
    named = home.load(name="or-3").system
    assert named is not None and named.name == "or-3"
    assert "letters" in home.error(name="a b").allowed
    odd = home.path / "systems/my system.v2.yaml"
    shutil.copy(home.path / SYSTEM, odd)
    stem = home.load("systems/my system.v2.yaml").system
    assert stem is not None and stem.name == "my_system_v2"


def test_unreadable_file_beside_others_does_not_hide_them(home: Home) -> None:
    (home.path / "pid/PSM.yaml").write_text("pid: [")
    (home.path / "kinematic/PSM.yaml").write_text("DH: 3")
    files = {Path(problem.file).name + str(problem.line) for problem in home.load().errors}
    assert files == {"PSM.yaml1"} and len(home.load().errors) == 2


def test_what_stands_on_no_line_is_told_without_one() -> None:
    reported = SourceFile(Path("x.yaml"), {}, {}).problem(("a",), "is missing")
    assert (reported.file, reported.line) == ("x.yaml", 0)


def test_a_key_under_its_old_name_is_found_on_its_line_unless_the_new_one_is_there_too() -> None:
    file = SourceFile(Path("x.yaml"), {"old": 1, "other": 2}, {(): 1, ("old",): 3, ("other",): 4})
    renamed = file.renamed({"old": "new"})
    assert renamed.at(("new",)) == 1 and not renamed.has(("old",)) and renamed.problem(("new",), "").line == 3
    assert renamed.problem(("other",), "").line == 4
    both = SourceFile(Path("x.yaml"), {"old": 1, "new": 2}, {})
    assert both.renamed({"old": "new"}).at(("new",)) == 2 and both.renamed({"old": "new"}).has(("old",))


def test_what_the_command_line_set_stands_on_no_line() -> None:
    file = SourceFile(Path("x.yaml"), {"a": {"b": 1}}, {("a",): 3}, frozenset({("a", "b")}))
    problems = file.problem(("a", "b"), ""), file.problem(("a", "b", "c"), "")
    assert [(problem.file, problem.line) for problem in problems] == [("--set", 0)] * 2
    assert (file.problem(("a", "c"), "").file, file.problem(("a", "c"), "").line) == ("x.yaml", 3)
