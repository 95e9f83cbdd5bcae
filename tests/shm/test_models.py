"""The protocols of shm/ as models with store buffers, every interleaving and every death searched by spin.

The models lie in models/*.pml; the macros in the tables below are theirs. Each seeded mutant must be found, by the
check that was made for it, or the model proves nothing.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

MODELS = Path(__file__).with_name("models")
PATIENCE_S = 600
BUILD = ("gcc", "-DSAFETY", "-DMEMLIM=3000", "-o", "pan", "pan.c")
DEEP = "-m100000"
INCOMPLETE = ("max search depth too small", "memory bound", "out of memory", "aborted", "Bit statespace")

RIGHT = [
    ("ring", ""),  # both readers at once: neither stores anything
    ("ring", "TO=0 RECORDS=4 LIVES=3 SIZE=5 RETRIES=2"),
    ("ring", "FROM=1 MIXED RECORDS=5 SIZE=5 RETRIES=2"),
    ("ring", "FROM=1 MIXED RECORDS=5 SIZE=5 RETRIES=2 DEPTH=3"),
    ("mailbox", ""),
    ("mailbox", "CLIENTS=1 OWNERS=3"),
    ("mailbox", "ACCEPTS COMMANDS=2"),
    ("mailbox", "CLIENTS=1 OWNERS=3 ACCEPTS COMMANDS=2 SIZE=5"),
    ("mailbox", "STOPS COMMANDS=2"),
    ("mailbox", "STOPS CLIENTS=1 OWNERS=1"),
]
TWICE_SENT, UNHEARD = "(issued[(count+1)]==0)", "( !(mine)||(begun>=(replied[mine]+"
TORN, OTHER = "(first==second)", "(first==issued["
HEAD = "((memory[0]==0)||"
UNANSWERED, TWICE, REPLY = "((outcome[number]>1)", "( !(outcome[to])", "((body==((8*id)+outcome[id]))"
MUTANTS = [  # what is wrong in them, and the check that must find it
    ("ring", "W4_FIRST TO=0", HEAD),  # head published before the payload
    ("ring", "W3_FIRST TO=0", HEAD),  # the sequence before the payload
    ("ring", "W3_FIRST FROM=1", OTHER),
    ("ring", "NO_W1 TO=0", TORN),
    ("ring", "NO_W1 FROM=1", TORN),
    ("ring", "NO_R3 TO=0", TORN),
    ("ring", "NO_R3 FROM=1", TORN),
    ("ring", "NO_V1 TO=0", "!(issued[n])"),  # a number given twice
    ("ring", "NO_DRAIN TO=0", HEAD),  # the successor begins before the dead one's stores are out
    ("ring", "SKIP_FAR FROM=1 DEPTH=3", "(tries||(headed>="),  # counted as lost, and still there
    ("mailbox", "M3_FIRST CLIENTS=1", OTHER),
    ("mailbox", "N3_FIRST CLIENTS=1", TORN),  # taken before it is copied
    ("mailbox", "N4_FIRST CLIENTS=1", "( !(ran[taken])"),  # run before it is taken
    ("mailbox", "NO_M1 CLIENTS=1", TORN),
    ("mailbox", "HEIR_FORGETS", "(issued[(count+1)]==0)"),  # the client's successor goes on from `taken`
    ("mailbox", "A3_FIRST CLIENTS=1", REPLY),
    ("mailbox", "NO_A1 CLIENTS=1", UNANSWERED),
    ("mailbox", "NO_B3 CLIENTS=1", REPLY),
    ("mailbox", "NO_V1 CLIENTS=1", TWICE),
    ("mailbox", "NO_V2 CLIENTS=1", UNANSWERED),
    ("mailbox", "V2_HALF CLIENTS=1", UNANSWERED),  # a reply cut short is taken for an answer
    ("mailbox", "NO_L1 STOPS CLIENTS=1", TWICE_SENT),
    ("mailbox", "L2_FIRST STOPS CLIENTS=1", TWICE_SENT),  # the cursors of before somebody else was there
    ("mailbox", "L3_FIRST STOPS CLIENTS=1", TWICE_SENT),
    ("mailbox", "SEEN_LATE STOPS CLIENTS=1", UNHEARD),  # the answer was there already
    ("mailbox", "V2_TAKEN CLIENTS=1 ACCEPTS COMMANDS=2", UNANSWERED),  # what was under way is forgotten
]


needs_spin = pytest.mark.skipif(
    not (shutil.which("spin") and shutil.which("gcc")), reason="spin or gcc is not there, the models were not checked; "
    "apt-get install spin gcc")


def ident(value: str) -> str:
    return value.replace(" ", ",") or "as it is"


def search(folder: Path, model: str, macros: str, *optimised: str) -> str:
    """What spin's search says of a model, its trail added when it found an error."""
    for source in MODELS.glob("*.pml"):
        shutil.copy(source, folder)
    defines = [f"-D{macro}" for macro in macros.split()]
    run(folder, "spin", *defines, "-a", f"{model}.pml")
    run(folder, *BUILD, *optimised)
    reported = run(folder, "./pan", DEEP)
    if (folder / f"{model}.pml.trail").exists():
        reported += "\n".join(run(folder, "spin", *defines, "-t", "-p", "-g", f"{model}.pml").splitlines()[-60:])
    return reported


def run(folder: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    reported = done.stdout + done.stderr
    assert done.returncode == 0, f"{' '.join(command)}: {reported}"
    return reported


def errors(reported: str) -> int:
    found = re.search(r"errors: (\d+)", reported)
    assert found is not None and "Full statespace search" in reported, reported
    return int(found[1])


@needs_spin
@pytest.mark.slow
@pytest.mark.searches
@pytest.mark.parametrize(("model", "macros"), RIGHT, ids=ident)
def test_no_interleaving_breaks_the_protocol(tmp_path: Path, model: str, macros: str) -> None:
    reported = search(tmp_path, model, macros, "-O1")
    assert errors(reported) == 0 and not [words for words in INCOMPLETE if words in reported], reported


@needs_spin
@pytest.mark.slow
@pytest.mark.searches
@pytest.mark.parametrize(("model", "macros", "check"), MUTANTS, ids=[f"{m}-{ident(x)}" for m, x, _ in MUTANTS])
def test_a_seeded_mutant_is_found(tmp_path: Path, model: str, macros: str, check: str) -> None:
    reported = search(tmp_path, model, macros)
    violated = re.search(r"pan:1: assertion violated +(.*) \(at depth", reported)
    assert errors(reported) == 1 and violated is not None, reported
    assert violated[1].startswith(check), f"found by another check: {violated[0]}"
