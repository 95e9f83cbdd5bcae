"""`trocar convert` of whole folders, as processes: what it writes and copies, when it refuses, and how it sums up."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests import stock
from tests.old import config, joint, pid, three
from tests.tools.converters.test_convert_back import ROBOTS, Writer
from trocar.procs.config.read.jsontext import parse_json
from trocar.procs.machine.paths import ROOT

pytestmark = pytest.mark.slow

IO = "sawRobotIO1394-PSM1-11111"


def trocar(*words: object, home: Path) -> subprocess.CompletedProcess[str]:
    """A verb, run where no file of ours lies."""
    return subprocess.run([sys.executable, "-m", "trocar", *map(str, words)], cwd=home, text=True, capture_output=True,
                          timeout=300, check=False, env=os.environ | {"PYTHONPATH": str(ROOT)})


def copied(name: str, to: Path) -> Path:
    """A folder of the test data, to be written to."""
    shutil.copytree(stock.find(name), to, copy_function=shutil.copyfile)
    for folder in (to, *(path for path in to.rglob("*") if path.is_dir())):
        folder.chmod(0o755)
    return to


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def errors(folder: Path, home: Path) -> dict[str, list[tuple[str, str]]]:
    """Key and value of every error that `trocar check` finds in the files of a site, by their names."""
    files = sorted(path.relative_to(folder) for path in folder.rglob("*.json"))
    done = trocar("check", *(folder / file for file in files), "--path", stock.find("dvrk-share"), "--json", home=home)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    return {str(file): [(problem["key"], problem["value"]) for problem in row["problems"]
                        if problem["severity"] == "error"]
            for file, row in zip(files, rows, strict=True)}


def as_before(site: Path) -> None:
    """A site as it was before dVRK 2.4: IO files in XML, one arm file in its old spelling."""
    for number, name in enumerate(ROBOTS):
        file = site / name
        file.with_suffix(".xml").write_bytes(Writer(4 + number % 2).text(json.loads(file.read_text())))
        file.unlink()
    arm = site / "jhu-dVRK/PSM1-28007.json"
    today = parse_json(arm.read_text()).data
    assert isinstance(today, dict)
    arm.write_text(json.dumps({key.replace("_", "-"): value for key, value in today.items() if key[0] != "$"}))


def summary(done: subprocess.CompletedProcess[str]) -> dict[str, object]:
    """What `--json` ends with."""
    row = json.loads(done.stdout.splitlines()[-1])["summary"]
    assert isinstance(row, dict)
    return row


def test_a_site_that_is_up_to_date_is_copied_whole(tmp_path: Path) -> None:
    site, new = stock.find("dvrk-site"), tmp_path / "new"
    done = trocar("convert", site, "--to", new, "--path", stock.find("dvrk-share"), home=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert names(new) == names(site) and "files: 0 written, 32 copied" in done.stdout.splitlines()[-1]
    assert all((new / name).read_bytes() == (site / name).read_bytes() for name in names(site))


def test_a_converted_site_has_no_errors_that_its_old_files_did_not_have(tmp_path: Path) -> None:
    site, new = copied("dvrk-site", tmp_path / "site"), tmp_path / "made/new"
    wrong = site / "jhu-dVRK/system-PSM1.json"
    wrong.write_text(wrong.read_text().replace('"fw"', '"udpp"'))
    wanted = names(site)
    had = errors(site, tmp_path)
    as_before(site)
    done = trocar("convert", site, "--to", new, "--path", stock.find("dvrk-share"), home=tmp_path)
    assert names(new) == wanted, done.stdout
    assert errors(new, tmp_path) == had
    assert sum(map(len, had.values())) == 1
    told = [line for line in done.stdout.splitlines() if "error" in line]
    assert '"udpp"' in told[0] and f"which {wrong} has as well" in told[1] and done.returncode == 1


def test_what_stands_in_the_way_is_told_before_anything_is_written(tmp_path: Path) -> None:
    site, new = tmp_path / "site", tmp_path / "new"
    for folder in (site, new):
        folder.mkdir()
    (site / f"{IO}.xml").write_bytes(config(three()))
    (site / "z.xml").write_bytes(pid(joint(0), 1))
    (new / "z.json").write_text("mine")
    done = trocar("convert", site, "--to", new, home=tmp_path)
    assert (done.returncode, done.stdout, names(new)) == (1, "", {"z.json"})
    (line,) = done.stderr.splitlines()
    assert "z.json" in line and "--force" in line and f"{IO}.json" not in line
    assert trocar("convert", site, "--to", new, "--force", home=tmp_path).returncode == 0
    assert names(new) == {"z.json", f"{IO}.json"}


@pytest.mark.parametrize("to", ["taken/new", "/proc/new"])
def test_a_folder_that_cannot_be_written_is_told_before_anything_else(tmp_path: Path, to: str) -> None:
    (tmp_path / "taken").write_text("a file")
    (tmp_path / f"{IO}.xml").write_bytes(config(three()))
    done = trocar("convert", f"{IO}.xml", "--to", to, home=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert to in line and names(tmp_path) == {"taken", f"{IO}.xml"}


def test_the_summary_counts_files_and_names_what_is_lost(tmp_path: Path) -> None:
    site = tmp_path / "site"
    site.mkdir()
    (site / "pid.xml").write_bytes(pid(joint(0, gains='Nonlinear="0.35"'), 1))
    (site / "wrong.xml").write_bytes(config(three()).replace(b'AxisID="1"', b'AxisID="one"'))
    (site / "LICENSE").write_text("ours")
    (site / ".git").mkdir()
    (site / ".git/config").write_text("not ours")
    (site / "long.mp4").write_bytes(b" " * 4_000_001)
    done = trocar("convert", site, "--to", tmp_path / "new", "--json", home=tmp_path)
    row = summary(done)
    assert (row["written"], row["copied"], row["equal"], row["failed"], row["left_out"]) == (1, 1, 0, 1, 1)
    (lost,) = row["lost"] if isinstance(row["lost"], list) else []
    assert (lost["file"], lost["key"]) == (str(site / "pid.xml"), "joints/joint/pid@Nonlinear") and lost["reason"]
    assert names(tmp_path / "new") == {"pid.json", "LICENSE"}
    told = trocar("convert", site, "--to", tmp_path / "new", home=tmp_path).stdout
    last = told[told.index("files: 0 written"):]
    assert "2 there already and equal" in last and "1 failed" in last and "joint/pid@Nonlinear = 0.35" in last


def test_a_secret_stays_one_in_the_copy(tmp_path: Path) -> None:
    (site := tmp_path / "site").mkdir()
    (site / "token").write_text("0123456789abcdef")
    (site / "token").chmod(0o600)
    assert trocar("convert", site, "--to", tmp_path / "new", home=tmp_path).returncode == 0
    assert (tmp_path / "new/token").stat().st_mode & 0o777 == 0o600


def test_a_file_of_today_stays_where_an_old_one_would_take_its_name(tmp_path: Path) -> None:
    (site := tmp_path / "site").mkdir()
    (site / "pid.xml").write_bytes(pid(joint(0), 1))
    (site / "pid.json").write_text('{"$id": "saw-controllers-pid.schema.json", "$version": "1"}')
    done = trocar("convert", site, "--to", tmp_path / "new", home=tmp_path)
    assert (tmp_path / "new/pid.json").read_bytes() == (site / "pid.json").read_bytes()
    assert done.returncode == 1 and "1 failed" in done.stdout


def test_the_check_looks_where_trocar_check_would(tmp_path: Path) -> None:
    """A file beside the old one is no help to who gets the new folder alone."""
    (site := tmp_path / "site").mkdir()
    (site / "x.json").write_text('{"$id": "saw-robot-io.schema.json", "$version": "6"}')
    old = site / "console.json"
    old.write_text(json.dumps({"arms": [], "io": {"configuration-files": ["x.xml"], "port": "udp"}}))
    done = trocar("convert", old, "--to", tmp_path / "new", home=tmp_path)
    assert done.returncode == 1 and "configuration_files[0]" in done.stdout
