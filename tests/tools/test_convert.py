"""`trocar convert`: what it writes, what it prints and its exit code."""

from __future__ import annotations

import json
from pathlib import Path

from typer.testing import CliRunner, Result

from procs.lib.config import check_file
from tests.lib.test_convert_rob import TWO
from tests.old import actuator, config, joint, pid, robot, three
from tools import cli

NAME = "sawRobotIO1394-PSM1-01234"


def run(*words: object) -> Result:
    return CliRunner().invoke(cli.build("convert"), ["convert", *map(str, words)])


def written(folder: Path, text: bytes | str, name: str = f"{NAME}.xml") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_the_new_file_lies_beside_the_old_one_and_passes_the_check(tmp_path: Path) -> None:
    done = run(written(tmp_path, config(three())))
    new = tmp_path / f"{NAME}.json"
    assert done.exit_code == 0
    assert f"wrote {new}: io file, fine" in done.stdout
    assert check_file(new).problems == ()


def test_every_kind_passes_the_check(tmp_path: Path) -> None:
    files = [
        written(tmp_path, pid(joint(0), 1), "sawControllersPID-X.xml"),
        written(tmp_path, TWO, "dvx.rob"),
        written(tmp_path, json.dumps({"arms": []}), "console-X.json"),
    ]
    done = run(*files)
    assert done.exit_code == 0, done.stdout
    kinds = {path.name: check_file(path).kind for path in tmp_path.glob("*.json")}
    assert kinds == {"sawControllersPID-X.json": "pid", "dvx.json": "kinematic", "system-X.json": "system",
                     "console-X.json": "system"}


def test_every_change_is_one_line(tmp_path: Path) -> None:
    old = written(tmp_path, config(robot(actuator(0, unit="deg"), 1)))
    lines = run(old).stdout.splitlines()
    assert f"{old}:6: converted: Robot/Actuator/Encoder/PositionLimitsSoft@Upper = 45 deg → 0.785398163 rad" in lines


def test_json_output_is_one_object(tmp_path: Path) -> None:
    old = written(tmp_path, config(three()))
    printed = json.loads(run(old, "--json").stdout)
    (file,) = printed["files"]
    assert (printed["ok"], file["ok"], file["kind"], file["problems"]) == (True, True, "io", [])
    assert file["written"] == [{"file": str(tmp_path / f"{NAME}.json"), "kind": "io", "problems": []}]
    change = file["changes"][0]
    assert (change["fate"], change["old"], change["new"]) == ("converted", "0.00025 deg/bit", "4.36332313e-06 rad/bit")


def test_files_that_are_there_need_force(tmp_path: Path) -> None:
    old, new = written(tmp_path, config(three())), written(tmp_path, "mine", f"{NAME}.json")
    done = run(old)
    assert done.exit_code == 1
    assert f"{new}: error: is there already; allowed: --force to overwrite, --to FOLDER" in done.stdout
    assert new.read_text() == "mine"
    assert run(old, "--force").exit_code == 0
    assert new.read_text().startswith("{")


def test_the_old_file_is_never_overwritten(tmp_path: Path) -> None:
    text = json.dumps({"kinematic": "kinematic/psm.json", "generation": "Classic", "tool-detection": "MANUAL"})
    old = written(tmp_path, text, "PSM1-1.json")
    done = run(old, "--force")
    assert done.exit_code == 1 and "is the old file" in done.stdout
    assert old.read_text() == text
    folder = tmp_path / "new"
    folder.mkdir()
    assert run(old, "--to", folder).exit_code == 0
    assert json.loads((folder / "PSM1-1.json").read_text())["tool_detection"] == "MANUAL"


def test_another_folder_must_be_there(tmp_path: Path) -> None:
    done = run(written(tmp_path, config(three())), "--to", tmp_path / "nowhere")
    assert done.exit_code == 2
    assert "no such folder" in done.stderr


def test_what_is_lost_exits_one_and_writes_the_rest(tmp_path: Path) -> None:
    done = run(written(tmp_path, pid(joint(0, gains='Nonlinear="0.35"'), 1), "pid.xml"))
    assert done.exit_code == 1
    assert "lost: joints/joint/pid@Nonlinear = 0.35" in done.stdout
    assert "1 key could not be converted" in done.stdout
    assert (tmp_path / "pid.json").exists()


def test_a_mistake_exits_one_and_writes_nothing(tmp_path: Path) -> None:
    old = written(tmp_path, config(three()).replace(b'AxisID="1"', b'AxisID="one"'))
    done = run(old)
    assert done.exit_code == 1
    expected = "error: Robot/Actuator[2]@AxisID = one: out of range; allowed: a whole number from 0 to 15"
    assert f"{old}:9: {expected}" in done.stdout
    assert f"{old}: nothing was written" in done.stdout
    assert list(tmp_path.iterdir()) == [old]


def test_what_the_check_finds_exits_one(tmp_path: Path) -> None:
    text = config(three()).replace(b"32701", b"32700").replace(b"32702", b"32700")
    done = run(written(tmp_path, text))
    assert done.exit_code == 1
    assert "is not calibrated" in done.stdout and "io file, 1 error left" in done.stdout


def test_a_missing_file_is_told_and_the_others_are_converted(tmp_path: Path) -> None:
    done = run(tmp_path / "nowhere.xml", written(tmp_path, config(three())))
    assert done.exit_code == 1
    assert "cannot be read: No such file" in done.stdout
    assert (tmp_path / f"{NAME}.json").exists()


def test_the_check_looks_where_path_says(tmp_path: Path) -> None:
    stock, to = tmp_path / "stock", tmp_path / "to"
    stock.mkdir()
    to.mkdir()
    console = {"arms": [], "io": {"configuration-files": ["x.xml"], "port": "udp"}}
    old = written(tmp_path, json.dumps(console), "console.json")
    assert run(old, "--to", to).exit_code == 1
    run(written(stock, config(three()), "x.xml"))
    assert run(old, "--to", to, "--force", "--path", stock).exit_code == 0


def test_a_system_finds_what_was_converted_with_it(tmp_path: Path) -> None:
    suj = actuator(0).replace("<Encoder", "<Old").replace("</Encoder", "</Old")
    io = written(tmp_path, config(robot(suj, 1, name="SUJ", attributes='Type="io-only"')), "suj-io.xml")
    console = {"arms": [], "io": {"configuration-files": ["suj-io.xml"], "port": "udp"}}
    done = run(written(tmp_path, json.dumps(console), "console-A.json"), io)
    assert done.exit_code == 0, done.stdout
    assert f"wrote {tmp_path / 'system-A.json'}: system file, fine" in done.stdout
