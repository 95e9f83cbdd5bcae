"""Log files begin anew when they are large or old, under whoever writes them."""

from __future__ import annotations

import re
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import psutil

from tests.conftest import ROOT
from tests.system.robot import wait_for
from trocar.procs.document.system import Logs
from trocar.procs.machine.log_files import CHUNK, LogFolder, is_old, put_aside, put_run_aside
from trocar.procs.supervisor.log_keeper import AGAIN_NS, LogKeeper
from trocar.shm.system.loglines import parsed

PARENT = """
import os, subprocess, sys
words = [sys.executable, "-I", "-S", "procs/machine/log_files.py", sys.argv[1], str(os.getpid()), "1000", "9", "2"]
print(subprocess.Popen(words).pid, flush=True)
sys.stdin.read()
"""


BEGIN = re.compile(rb"\d{4}-\S+ \S+ \d+\.\d+ INFO (earlier entries are in \S+|[^\n]*)\n")


def there(folder: Path) -> dict[str, bytes]:
    """Without the line that each new file begins with."""
    return {path.name: BEGIN.sub(b"", path.read_bytes()) for path in sorted(folder.iterdir())}


def test_a_large_file_begins_anew_under_its_writer(tmp_path: Path) -> None:
    logs = LogFolder(tmp_path, 10, 1e9, 2)
    with (tmp_path / "PSM1.log").open("ab", buffering=0) as writer, (tmp_path / "IO1.log").open("ab") as other:
        other.write(b"few")
        other.flush()
        for number in range(4):
            writer.write(b"%d: something\n" % number)
            logs.look(float(number))
            logs.look(float(number))
        writer.write(b"4: little")
        logs.look(5.0)
    assert there(tmp_path) == {"IO1.log": b"few", "PSM1.log": b"4: little", "PSM1.1.log": b"3: something\n",
                               "PSM1.2.log": b"2: something\n"}
    line = parsed((tmp_path / "PSM1.log").read_text().splitlines()[0])
    assert line.text == "earlier entries are in PSM1.1.log" and line.monotonic_s > 0.0
    assert [name for name in there(tmp_path) if is_old(Path(name))] == ["PSM1.1.log", "PSM1.2.log"]


def test_an_old_file_begins_anew_when_there_is_something_in_it(tmp_path: Path) -> None:
    logs = LogFolder(tmp_path, 1000, 60.0, 2)
    (tmp_path / "PSM1.log").touch()
    logs.look(0.0)
    logs.look(100.0)
    assert list(there(tmp_path)) == ["PSM1.log"]
    (tmp_path / "PSM1.log").write_text("few")
    logs.look(101.0)
    assert there(tmp_path) == {"PSM1.log": b"", "PSM1.1.log": b"few"}
    logs.look(170.0)
    logs.look(300.0)
    assert list(there(tmp_path)) == ["PSM1.1.log", "PSM1.log"], "nothing was written since"
    with (tmp_path / "PSM1.log").open("a") as file:
        file.write("more")
    logs.look(160.0)
    assert there(tmp_path)["PSM1.log"] == b"more"


def test_of_a_flood_the_newest_is_kept(tmp_path: Path) -> None:
    (tmp_path / "PSM1.log").write_bytes(b"a" * 3 * CHUNK + b"z" * CHUNK)
    LogFolder(tmp_path, 1000, 1e9, 1).look(0.0)
    first, _, rest = there(tmp_path)["PSM1.1.log"].partition(b"\n")
    assert first == b"%d bytes before this were too many to be kept" % (3 * CHUNK - 1000)
    assert rest == b"a" * 1000 + b"z" * CHUNK


def test_what_cannot_be_kept_is_emptied(tmp_path: Path) -> None:
    (tmp_path / "PSM1.log").write_bytes(b"a" * 20)
    (tmp_path / "PSM1.1.log").mkdir()  # cannot be written
    LogFolder(tmp_path, 10, 1e9, 1).look(0.0)
    assert "could not be kept: [Errno" in (tmp_path / "PSM1.log").read_text()


def test_the_run_before_is_put_aside(tmp_path: Path) -> None:
    path = tmp_path / "PSM1.log"
    for number in range(4):
        put_aside(path, 2)
        path.write_text(str(number))
    assert there(tmp_path) == {"PSM1.log": b"3", "PSM1.1.log": b"2", "PSM1.2.log": b"1"}
    put_aside(path, 0)
    assert there(tmp_path) == {}


def test_the_file_that_a_run_writes_already_is_not_put_aside(tmp_path: Path) -> None:
    words = [sys.executable, "-c", f"from {put_run_aside.__module__} import *; put_run_aside(Path({str(tmp_path)!r}))"]
    (tmp_path / "PSM1.log").write_text("of the last run")
    with (tmp_path / "supervisor.log").open("wb") as log:
        subprocess.run(words, cwd=ROOT, stderr=log, check=True)
    assert there(tmp_path) == {"PSM1.1.log": b"of the last run", "supervisor.log": b""}


def test_who_looks_after_them_ends_with_its_parent(tmp_path: Path) -> None:
    words = [sys.executable, "-c", PARENT, str(tmp_path)]
    with subprocess.Popen(words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        keeper = int(parent.stdout.readline())
        (tmp_path / "PSM1.log").write_bytes(b"a" * 2000)
        wait_for(lambda: (tmp_path / "PSM1.1.log").exists(), 20, "it is looked after")
        parent.kill()
    wait_for(lambda: not psutil.pid_exists(keeper) or psutil.Process(keeper).status() == psutil.STATUS_ZOMBIE, 20,
             "its end")


def test_it_is_started_again(tmp_path: Path) -> None:
    with closing(LogKeeper(tmp_path, Logs())) as keeper:
        before = keeper._popen
        keeper.beat(AGAIN_NS + 1)
        assert keeper._popen is before
        before.kill()
        before.wait()
        keeper.beat(AGAIN_NS + 2)
        assert keeper._popen is before, "not at once"
        keeper.beat(2 * AGAIN_NS + 2)
        assert keeper._popen is not before and keeper._popen.poll() is None
