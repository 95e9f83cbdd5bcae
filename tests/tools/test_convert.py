"""`trocar convert`: what it writes, what it prints and its exit code."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from tests import stock
from tests.old import actuator, config, joint, pid, robot, three
from tests.tools.converters.test_convert_rob import TWO
from trocar.procs.config import check_file
from trocar.tools import cli

NAME = "sawRobotIO1394-PSM1-01234"


def run(*words: object) -> Result:
    return CliRunner().invoke(cli.build("convert"), ["convert", *map(str, words)])


def rows(*words: object) -> list[dict[str, Any]]:
    """What `--json` says of each file; the summary, which comes last, aside."""
    *found, last = map(json.loads, run(*words, "--json").stdout.splitlines())
    assert list(last) == ["summary"]
    return found


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


def test_json_output_is_one_object_a_file(tmp_path: Path) -> None:
    old = written(tmp_path, config(three()))
    (file,) = rows(old)
    assert (file["ok"], file["kind"], file["problems"]) == (True, "io", [])
    assert file["written"] == [{"file": str(tmp_path / f"{NAME}.json"), "kind": "io", "problems": []}]
    change = file["changes"][0]
    assert change["outcome"] == "converted"
    assert (change["old"], change["new"]) == ("0.00025 deg/bit", "4.36332313e-06 rad/bit")


def test_files_that_are_there_need_force(tmp_path: Path) -> None:
    old, new = written(tmp_path, config(three())), written(tmp_path, "mine", f"{NAME}.json")
    done = run(old)
    assert done.exit_code == 1
    assert done.stdout == "" and str(new) in done.stderr and "--force" in done.stderr
    assert new.read_text() == "mine"
    assert run(old, "--force").exit_code == 0
    assert new.read_text().startswith("{")


def test_the_old_file_is_never_overwritten(tmp_path: Path) -> None:
    text = json.dumps({"kinematic": "kinematic/psm.json", "generation": "Classic", "tool-detection": "MANUAL"})
    old = written(tmp_path, text, "PSM1-1.json")
    done = run(old, "--force")
    assert done.exit_code == 1 and "by what it becomes" in done.stderr and done.stdout == ""
    assert old.read_text() == text
    folder = tmp_path / "new"
    folder.mkdir()
    assert run(old, "--to", folder).exit_code == 0
    assert json.loads((folder / "PSM1-1.json").read_text())["tool_detection"] == "MANUAL"


def test_what_is_lost_exits_one_and_writes_the_rest(tmp_path: Path) -> None:
    done = run(written(tmp_path, pid(joint(0, gains='Nonlinear="0.35"'), 1), "pid.xml"))
    assert done.exit_code == 1
    assert "lost: joints/joint/pid@Nonlinear = 0.35" in done.stdout
    assert "keys lost: 1" in done.stdout
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


CHAIN = {"name": "PSM1", "type": "PSM", "io": "sawRobotIO1394-PSM1-11111.xml",
         "kinematic": "psm-large-needle-driver.json"}


def console(folder: Path, name: str, **keys: object) -> Path:
    return written(folder, json.dumps({"arms": [CHAIN], "io": {"port": "udp"}} | keys), f"console-{name}.json")


def test_consoles_of_one_run_share_the_files_that_are_equal(tmp_path: Path) -> None:
    to = tmp_path / "to"
    to.mkdir()
    first, second = rows(console(tmp_path, "A"), console(tmp_path, "B"), "--to", to)
    assert [Path(row["file"]).name for row in first["written"]] == ["system-A.json", "PSM1-11111.json"]
    assert [Path(row["file"]).name for row in second["written"]] == ["system-B.json"]
    assert second["equal"] == [str(to / "PSM1-11111.json")]
    again = rows(console(tmp_path, "A"), "--to", to)
    assert again[0]["written"] == [] and len(again[0]["equal"]) == 2, "nor is it a mistake to run again"


def test_arm_files_that_consoles_make_differently_get_names_of_their_own(tmp_path: Path) -> None:
    other = CHAIN | {"kinematic": "psm-pro-grasp.json"}
    run(console(tmp_path, "A"), console(tmp_path, "B", arms=[other]))
    system = json.loads((tmp_path / "system-B.json").read_text())
    assert system["arms"][0]["arm_file"] == "PSM1-11111-B.json"
    tools = [json.loads((tmp_path / name).read_text())["tool"] for name in ("PSM1-11111.json", "PSM1-11111-B.json")]
    assert tools == ["LARGE_NEEDLE_DRIVER:400006", "PROGRASP_FORCEPS:400093"]


def pedals(bit: int) -> bytes:
    inputs = "".join(f'<DigitalIn BoardID="3" BitID="{bit + number}" Name="{name}" Pressed="1" Trigger="all"/>'
                     for number, name in enumerate(("CLUTCH", "CAMERA", "COAG")))
    return config(inputs)


PEDALS = "sawRobotIO1394-MTMR-foot-pedals"


def test_references_follow_the_files_of_the_same_run(tmp_path: Path) -> None:
    """A site's own pedals have the name that stock ones had once, under which those are not found today."""
    (tmp_path / "io").mkdir()
    own = written(tmp_path / "io", pedals(4), f"{PEDALS}.xml")
    old = console(tmp_path, "A", io={"port": "udp", "footpedals": f"io/{PEDALS}.xml"})
    to = tmp_path / "to"
    to.mkdir()
    run(old, own, "--to", to)
    system = json.loads((to / "system-A.json").read_text())
    assert system["consoles"][0]["IO_pedals"]["IO_file"] == f"{PEDALS}.json"
    assert (to / f"{PEDALS}.json").exists()


def test_a_stock_file_in_place_of_an_own_one_is_a_warning_with_its_values(tmp_path: Path) -> None:
    stock = tmp_path / "stock"
    stock.mkdir()
    run(written(stock, pedals(0), f"{PEDALS}-QLA1.xml"))
    written(tmp_path, pedals(4), f"{PEDALS}.xml")
    old = console(tmp_path, "A", io={"port": "udp", "footpedals": f"{PEDALS}.xml"})
    (row,) = rows(old, "--path", stock)
    (warning,) = (problem for problem in row["problems"] if problem["severity"] == "warning")
    assert warning["key"] == "io.footpedals" and str(stock / f"{PEDALS}-QLA1.json") in warning["text"]
    assert "digital_inputs[clutch].bit_id 4 → 0" in warning["text"] and "differs in 3 values" in warning["text"]
    written(tmp_path, pedals(0), f"{PEDALS}.xml")
    (row,) = rows(old, "--path", stock)
    assert row["problems"] == [], "the same by another name"


def test_own_gains_that_give_way_to_stock_ones_are_told_with_their_values(tmp_path: Path) -> None:
    written(tmp_path, pid(joint(0), 1), "sawControllersPID-PSM.xml")
    done = run(console(tmp_path, "A", arms=[CHAIN | {"pid": "sawControllersPID-PSM.xml"}]))
    assert "warning: arms[0].pid" in done.stdout and "p_gain 20" in done.stdout


def test_a_folder_is_converted_whole_and_keeps_its_folders(tmp_path: Path) -> None:
    site, to = tmp_path / "site", tmp_path / "site" / "new"
    (site / "io").mkdir(parents=True)
    to.mkdir()
    written(site / "io", config(three()), "sawRobotIO1394-PSM1-11111.xml")
    written(site, '{"a": 1}', "notes.json")
    written(site, '{"arms": [{"name": "ECM", "measured_cp": []}]}', "suj-fixed.json")
    written(site, "<?xml version='1.0'?><opencv/>", "camera.xml")
    console(site, "A", arms=[CHAIN | {"io": "io/sawRobotIO1394-PSM1-11111.xml"}])
    first = rows(site, "--to", to)
    assert [Path(row["file"]).name for row in first if not row["copied"]] == ["console-A.json",
                                                                             "sawRobotIO1394-PSM1-11111.xml"]
    assert {path.name for path in to.iterdir()} >= {"camera.xml", "notes.json", "suj-fixed.json"}
    system = json.loads((to / "system-A.json").read_text())
    assert (to / system["arms"][0]["IO_file"]).samefile(to / "io" / "sawRobotIO1394-PSM1-11111.json")
    assert not any(row["written"] for row in rows(site, "--to", to)), "what lies in the new folder is not old"


def test_files_of_setup_joints_get_todays_names_and_consoles_find_them(tmp_path: Path) -> None:
    today = stock.find("dvrk-site/jhu-daVinci/suj-ECM-1-2-3.json").read_text()
    old = re.sub(r'"(\w+)"\s*:', lambda key: key.group().replace("_", "-").replace("SUJ", "suj"), today)
    site, to = tmp_path / "site", tmp_path / "new"
    site.mkdir()
    to.mkdir()
    written(site, old, "suj-1.json")
    console(site, "A", arms=[{"name": "SUJ", "type": "SUJ", "simulation": "KINEMATIC", "kinematic": "suj-1.json"}])
    done = run(site, "--to", to)
    assert "wrote " + str(to / "suj-1.json") + ": setup joints, Classic file, fine" in done.stdout, done.stdout
    assert "converted: arms[0].primary-offsets → primary_offsets (today's name)" in done.stdout
    system = json.loads((to / "system-A.json").read_text())
    assert (system["arms"][0]["arm_file"], done.exit_code) == ("suj-1.json", 0)


def test_broken_files_of_a_folder_have_failed_as_they_do_alone(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    old.mkdir()
    for name, text in (("a.json", '{"a": '), ("b.xml", "<x><y></x>"),
                       ("pid.xml", pid(joint(0), 1).replace(b' type="PID"', b"")),
                       ("other.xml", "<notes/>")):
        written(old, text, name)
    done = run(old, "--to", new)
    assert done.exit_code == 1 and "1 copied, 3 failed" in done.stdout, done.stdout
    assert re.search(r"other\.xml:1: warning: .*not converted", done.stdout)
    assert [path.name for path in new.iterdir()] == ["other.xml"]
    assert all(run(old / name).exit_code == 1 for name in ("a.json", "b.xml", "pid.xml"))
