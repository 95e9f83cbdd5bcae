"""The system in the storm: started and ended through the front door, its processes, its witness."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import psutil

from tests.system.test_socket_bridge import free
from trocar.procs.document.system import SystemConfig as Document
from trocar.procs.document.system import from_json
from trocar.procs.machine.paths import ROOT
from trocar.shm.memory.segment import SegmentError, names_of
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.output.errors import Problem
from trocar.tools.systems.supervising import Background, StartRequest

FILE = ROOT / "configs" / "systems" / "demo-teleop.yaml"
END_S = 20.0
OF_IO = "pid_enabled,effort_mode,setpoint_position,pid_generation,bias_generation,fault,tracking_check"
OF_ARMS = "mode,in_effort,position,pid_generation,bias_generation"
WITNESSED = (f"IO1.state:io:{OF_IO}", *(f"{arm}.setpoint:arm:{OF_ARMS}" for arm in ("MTMR", "PSM1")))
BRIDGE = "socket_bridge"
SETS = ("clock=wall", "io.spin_us=0", "io.period_s=0.002", "socket.may_power=false")


def wait_for(condition: Callable[[], object], seconds: float) -> bool:
    """Whether it came true in time."""
    end = monotonic_ns() + round(seconds * 1e9)
    while not condition():
        if monotonic_ns() > end:
            return False
        pause(0.01)
    return True


class System:
    """One system, whose socket's clients may not power anything; `start` may be called again after it has ended.

    `witnessed`: records besides the boards', as the recorder takes them.
    """

    def __init__(self, name: str, folder: Path, file: Path = FILE, paths: tuple[Path, ...] = (),
                 witnessed: Sequence[str] = WITNESSED) -> None:
        self.name, self.folder, self._file, self._paths, self._witnessed = name, folder, file, paths, witnessed
        folder.mkdir(parents=True, exist_ok=True)
        os.environ["TROCAR_STATE"], os.environ["TROCAR_SYSTEM"] = str(folder), name
        self.port = free()
        self.records: list[Path] = []
        self.ever: set[int] = set()  # all processes that were seen
        self._background: Background | None = None
        self._witness: subprocess.Popen[str] | None = None
        self.document: Document

    def start(self) -> None:
        """`up`, and the witness beside it; Problem when it does not come up."""
        self._background = Background(StartRequest(self._file, self.name, "emulated", self._paths, sets=(
            *SETS, f"socket.listen=127.0.0.1:{self.port}")), tied=True)
        self._background.wait_until_up(lambda text, fraction: None)
        self.document = from_json(directory.document(self.name))
        self.records.append(self.folder / f"truth-{len(self.records)}.bin")
        words = [sys.executable, "-m", "tests.soak.recorder", self.name, str(self.records[-1]), *self._witnessed]
        self._witness = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self._witness.stdout is not None
        self._witness.stdout.readline()
        self.look()

    @property
    def supervisor(self) -> int:
        """Its pid."""
        assert self._background is not None
        return self._background.popen.pid

    @property
    def is_up(self) -> bool:
        """The supervisor lives and says RUNNING."""
        return self._background is not None and self._background.popen.poll() is None and \
            self._background.state() == "RUNNING"

    @property
    def instances(self) -> list[str]:
        """Processes by name, without the supervisor and the bridge, which comes and goes with its clients."""
        return [name for name in directory.instances(self.name) if name not in ("supervisor", BRIDGE)]

    def pid(self, instance: str) -> int:
        """Of a process; 0: there is none."""
        if instance == "supervisor":
            return self.supervisor
        try:
            page = ControlPage(self.name, instance)
        except SegmentError:
            return 0
        pid = int(page.get("pid"))
        page.close()
        self.ever.add(pid)
        return pid

    def look(self) -> dict[str, str]:
        """What is wrong with each process; those that run are not there."""
        found = {}
        for name in self.instances:
            pid = self.pid(name)
            with contextlib.suppress(SegmentError):
                page = ControlPage(self.name, name)
                state, age_ns = page.state, monotonic_ns() - int(page.get("heartbeat_ns"))
                page.close()
                if state != "RUNNING" or not _lives(pid):
                    found[name] = f"{state}, process {pid} {'lives' if _lives(pid) else 'is gone'}"
                elif age_ns > 500_000_000:
                    found[name] = f"silent for {age_ns * 1e-9:.1f} s"
        return found

    def signal(self, instance: str, number: int) -> bool:
        """Send a signal to a process; False: there is none."""
        pid = self.pid(instance)
        if not _lives(pid):
            return False
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
        return True

    def died(self) -> list[str]:
        """After the supervisor was killed: what is left of its processes when they had time to end."""
        if self._background is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._background.popen.wait(END_S)
        wait_for(lambda: not self._living(), END_S)
        self._end_witness()
        self._background = None
        return [f"process {pid} {_name(pid)} after the supervisor's end" for pid in self._living()]

    def stop(self) -> list[str]:
        """`trocar down`; what is wrong after it."""
        reported = subprocess.run([sys.executable, "-m", "trocar", "down", "--system", self.name], cwd=ROOT,
                                  capture_output=True, text=True, check=False, timeout=120)
        left = [f"trocar down: {reported.stdout} {reported.stderr}"] if reported.returncode else []
        left += [f"process {pid} {_name(pid)} after trocar down" for pid in self._living()]
        left += [f"segment {'~'.join(parts)} after trocar down" for parts in names_of(self.name)]
        self._end_witness()
        if self._background is not None:
            try:
                code = self._background.popen.wait(END_S)
            except subprocess.TimeoutExpired:
                left.append("the supervisor has not ended")
                self._background.popen.kill()
            else:
                if code < 0:
                    left.append(f"the supervisor ended with {code}")
        return left

    def clean(self) -> None:
        """Whatever is left goes: nothing of a storm outlives it."""
        for pid in [*self._living(), *([self._witness.pid] if self._witness is not None else [])]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        with contextlib.suppress(Problem, SegmentError, OSError):
            subprocess.run([sys.executable, "-m", "trocar", "down", "--system", self.name], cwd=ROOT, check=False,
                           capture_output=True, timeout=120)

    def _living(self) -> list[int]:
        return [pid for pid in sorted(self.ever) if _lives(pid)]

    def _end_witness(self) -> None:
        if self._witness is not None:
            self._witness.terminate()
            self._witness.wait(END_S)
            self._witness = None


def _lives(pid: int) -> bool:
    try:
        return bool(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _name(pid: int) -> str:
    try:
        return " ".join([word for word in psutil.Process(pid).cmdline() if word][-4:])
    except psutil.NoSuchProcess:
        return ""
