"""The checks of the house: tables that must agree, names, and what a module may do when it is imported."""

from __future__ import annotations

import ast
import functools
import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from tests.cases import cases
from trocar.procs.document.gains import GAINS
from trocar.procs.tables.desired_state import DESIRED_STATES
from trocar.procs.tables.manifest import PROCS
from trocar.shm.commands import COMMANDS
from trocar.shm.topics import TOPICS

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("procs", "shm", "tools")
SOURCES = [*sorted(p for folder in FOLDERS for p in (ROOT / folder).rglob("*.py")), *sorted(ROOT.glob("trocar/*.py"))]
FORBIDDEN = ("utils", "helpers", "common", "misc", "base", "manager")
LET_OFF = {ROOT / "procs" / "io"}  # the interpreter loads its own io before it looks at any path
NAMED_BY_THE_TREE = {"shm/mailbox/mailbox.py"}  # the house's own plan has it; nothing in shm/ is ever run as a script
WIRE = ("procs/fpga/", "procs/io/", "procs/boards/")  # speak big-endian
NATIVE_DTYPE = re.compile(r"^(\([^)]*\))?[<=|][iufbSV?c][0-9]+$|^\([^)]*\)[<=|>]?[iufbSV?][0-9]*$")
BIG_ENDIAN = re.compile(r"^(\([^)]*\))?>[iuf][0-9]+$")
ENVIRONMENT = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def module_of(path: Path) -> str:
    return relative(path).removesuffix(".py").replace("/", ".").removesuffix(".__init__")


@functools.cache
def source_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """The slow part of these tests, so each first looks whether the source has anything to do with its rule."""
    return ast.parse(source_of(path))


@functools.cache
def nodes_of(path: Path) -> list[ast.AST]:
    return list(ast.walk(tree_of(path)))


def texts_of(path: Path) -> set[str]:
    """Every text constant of a module."""
    return {node.value for node in nodes_of(path) if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def words_of(path: Path) -> set[str]:
    """Every identifier and attribute a module uses; texts and comments don't count."""
    found: set[str] = set()
    for node in nodes_of(path):
        if isinstance(node, ast.Name):
            found.add(node.id)
        elif isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or "", *(alias.name for alias in node.names)}
    return found


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True,
                          timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@cases("row", [row for row in PROCS if row.ours])
def test_every_kind_has_its_door(row) -> None:  # type: ignore[no-untyped-def]
    spec = importlib.util.find_spec(row.module)
    assert spec is not None and spec.origin is not None, f"{row.module} is not there"
    body = tree_of(Path(spec.origin)).body
    assert "main" in {node.name for node in body if isinstance(node, ast.FunctionDef)}
    names = {node.name for node in body if isinstance(node, ast.ClassDef)}
    assert row.kind == "supervisor" or any(name.endswith("Loop") for name in names)


def test_every_writer_of_a_topic_is_in_the_manifest() -> None:
    kinds = {row.kind for row in PROCS}
    assert {topic.writer for topic in TOPICS} - {"*"} <= kinds
    written = {(topic.writer, topic.name) for topic in TOPICS}
    assert {(row.kind, topic) for row in PROCS for topic in row.topics} <= written


@pytest.mark.parametrize("kind", [row.kind for row in PROCS if row.ours])
def test_a_kind_fills_its_fields_and_knows_its_commands(kind: str) -> None:
    fields = {field.name for topic in TOPICS if topic.writer == kind and (kind, topic.name) != ("suj", "setpoint")
              for field in topic.fields}  # that of a cart has the layout of an arm's
    fields -= {gain.key for gain in GAINS} | {desired.field for desired in DESIRED_STATES}
    unnamed = fields | {row.name for row in COMMANDS.get(kind, ())}
    for path in (ROOT / "procs" / kind).rglob("*.py"):
        if any(f'"{name}"' in source_of(path) for name in unnamed):
            unnamed -= texts_of(path)
        if kind == "io":  # fields are attributes of IoRecord, commands are methods of IoCommands
            unnamed -= {node.attr for node in nodes_of(path) if isinstance(node, ast.Attribute)}
            unnamed -= {node.name.lstrip("_") for node in nodes_of(path) if isinstance(node, ast.FunctionDef)}
    assert not unnamed, "no code fills or carries out these"


def test_the_architecture_names_files_that_are_there() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:procs|shm|tools|tests)/[\w/]+(?:\.py)?)`", page))
    assert not {name for name in named if not (ROOT / name).exists()}


@functools.cache
def kinds_compared(path: Path) -> set[str]:
    """Kinds of process that a module compares a `kind` with, by name."""
    kinds, found = {row.kind for row in PROCS}, set()
    for node in nodes_of(path) if "kind" in source_of(path) else ():
        if isinstance(node, ast.Compare) and "kind" in (getattr(node.left, "attr", ""), getattr(node.left, "id", "")):
            found |= {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and n.value in kinds}
    return found


def test_what_a_kind_is_stands_in_its_row() -> None:
    asked = ("procs/node/runtime", "procs/supervisor/", "procs/document/", "procs/config/", "shm/")
    each_keeps_to(kinds_compared, [path for path in SOURCES if relative(path).startswith(asked)])


def each_keeps_to(rule: Callable[[Path], object], paths: Iterable[Path] = SOURCES) -> None:
    """All that breaks a rule, told at once; `rule` says what is wrong with a file, nothing if nothing is."""
    found = {relative(path): wrong for path in paths if (wrong := rule(path))}
    assert not found, "\n".join(f"{name}: {wrong}" for name, wrong in found.items())


def test_file_names_say_the_subject() -> None:
    def wrong(path: Path) -> str:
        if path.stem in FORBIDDEN:
            return "says no subject"
        if len(re.findall(r"[a-z0-9]+", path.stem)) > 2 and not path.stem.startswith("__"):
            return "more than two words"
        known = relative(path) in NAMED_BY_THE_TREE or path.stem.startswith("__")
        return "would hide a library module" if not known and path.stem in sys.stdlib_module_names else ""

    each_keeps_to(wrong)


def test_folders_hide_no_library_module() -> None:
    folders = {p for p in (ROOT / "procs").rglob("*") if p.is_dir() and any(p.glob("*.py"))} - LET_OFF
    assert not {relative(p) for p in folders if p.name in sys.stdlib_module_names | set(FORBIDDEN)}


def test_layouts_are_spelled_in_shm_only() -> None:
    like_one = re.compile(r"""["'](?:\([^)"']*\))?[<=|>]?[iufbSVc?]\d*["']|dtype\(""")

    def wrong(path: Path) -> str:
        if not like_one.search(source_of(path)):
            return ""
        nodes, texts = nodes_of(path), texts_of(path)
        if {t for t in texts if NATIVE_DTYPE.match(t)}:
            return "a layout of shared memory belongs to shm/topics.py"
        if not relative(path).startswith(WIRE) and {t for t in texts if BIG_ENDIAN.match(t)}:
            return "big-endian words belong to the wire"
        structured = [node for node in nodes if isinstance(node, ast.Call)
                      and getattr(node.func, "attr", "") == "dtype" and node.args
                      and isinstance(node.args[0], ast.List | ast.Dict)]
        return "a record's layout belongs to shm/topics.py" if structured else ""

    each_keeps_to(wrong, [path for path in SOURCES if not relative(path).startswith("shm/")])


OF_SIGNALS = ("procs/node/runtime.py", "procs/node/life.py", "procs/node/realtime.py", "procs/machine/end_signals.py")


def test_only_the_runtime_knows_signals_and_schedulers() -> None:
    def wrong(path: Path) -> set[str]:
        if not re.search("signal|sched_|setproctitle", source_of(path)):
            return set()
        name, used = relative(path), words_of(path)
        theirs = {"signal"} if not name.startswith("procs/supervisor/") else set()
        return {w for w in used if w.startswith("sched_") or w == "setproctitle"} | (used & theirs)

    each_keeps_to(wrong, [path for path in SOURCES if relative(path) not in OF_SIGNALS])


def test_a_loop_s_body_fits_a_screen() -> None:
    def too_long(path: Path) -> list[str]:
        loops = [node for node in nodes_of(path) if isinstance(node, ast.FunctionDef)
                 and any(isinstance(n, ast.While) for n in ast.walk(node))]
        return [node.name for node in loops if (node.end_lineno or 0) - node.lineno >= 40]

    each_keeps_to(too_long, [path for path in SOURCES if path.name == "loop.py"])


IMPORT_QUIETLY = """
import os, sys, threading
roots = (os.path.realpath(sys.prefix), os.path.realpath(sys.base_prefix), os.path.realpath({root!r}))
libraries = "ctypes numpy yaml pydantic typer rich psutil mujoco posix_ipc json logging textual gymnasium"
for name in libraries.split():
    try: __import__(name)
    except ImportError: pass
wrong, on = [], [False]
STARTS = ("subprocess.Popen", "os.fork", "os.posix_spawn", "os.exec", "os.system", "socket.bind", "socket.connect",
          "os.remove", "os.mkdir", "os.rename", "os.putenv", "shutil.", "tempfile.")
def watch(event, arguments):
    if not on[0]: return
    if event == "open" and isinstance(arguments[0], (str, bytes)):
        path = os.path.realpath(os.fsdecode(arguments[0]))
        quiet = path.endswith((".py", ".pyc", ".so")) or "site-packages" in path or path.startswith(
            (*roots[:2], "/usr/lib", "/etc", "/lib"))
        if not quiet: wrong.append(f"{{event}} {{path}}")
    elif event.startswith(STARTS): wrong.append(f"{{event}} {{arguments}}")
sys.addaudithook(watch)
threads = threading.active_count()
import importlib
failed = []
for name in {modules!r}:
    del wrong[:]
    on[0] = True
    try: importlib.import_module(name)
    finally: on[0] = False
    failed += [f"{{name}}: {{w}}" for w in wrong]
if threading.active_count() != threads: failed.append("a thread was started")
print("\\n".join(failed))
"""


@pytest.mark.slow
def test_importing_any_module_does_nothing() -> None:
    modules = [module_of(p) for p in SOURCES if p.name != "__main__.py"]
    out = python(IMPORT_QUIETLY.format(root=str(ROOT), modules=modules))
    assert out.strip() == ""


def test_rings_mailboxes_and_time_know_no_robot() -> None:
    out = python("import sys, trocar.shm.mailbox.client, trocar.shm.time.held_time, trocar.shm.ring.stamps\n"
                 "print(*(name for name in sys.modules if name.startswith('trocar.')))")
    rooms = {name.split(".")[2] for name in out.split() if name.count(".") >= 2}
    assert rooms == {"memory", "ring", "time", "mailbox"} and "trocar.procs" not in out


@pytest.mark.slow
def test_io_needs_little_to_start() -> None:
    out = python("import sys, trocar.procs.io.loop\nprint(*{m.split('.')[0] for m in sys.modules})")
    allowed = sys.stdlib_module_names | {"numpy", "posix_ipc", "trocar", "__mp_main__"}
    startup = set(python("import sys\nprint(*{m.split('.')[0] for m in sys.modules})").split())  # .pth files of a venv
    assert not {m for m in out.split() if m not in allowed | startup and not m.startswith(("_", "sitecustomize"))}


@pytest.mark.parametrize("command", ["tools/start", "tools/test"])
def test_the_two_commands_of_the_readme_exist(command: str) -> None:
    path = ROOT / command
    assert path.is_file() and os.access(path, os.X_OK)
    assert command in (ROOT / "README.md").read_text(encoding="utf-8")


def test_no_file_has_outgrown_its_subject() -> None:
    def outgrown(path: Path) -> int:
        lines = len(source_of(path).splitlines())
        return lines if lines > 400 else 0

    each_keeps_to(outgrown)


def test_no_class_name_stands_for_two_things() -> None:
    for folders in (("procs", "shm", "tools"), ("tests",)):
        places: dict[str, list[Path]] = {}
        for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
            for name in re.findall(r"^[ \t]*class (\w+)[(:]", source_of(path), re.MULTILINE):
                places.setdefault(name, []).append(path)
        several = {name: set(where) for name, where in places.items() if len(where) > 1}  # some of them in texts
        twice = {name: found for name, where in several.items() if len(found := [
            relative(path) for path in sorted(where) for node in nodes_of(path)
            if isinstance(node, ast.ClassDef) and node.name == name]) > 1}
        assert not twice, "say whose it is: IoRecord, ArmRecord"
