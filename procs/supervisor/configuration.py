"""The configuration, read and checked in a process of its own: its libraries and files take 20 MB, and are needed once.

The process is forked off the supervisor before that has opened anything. It reports problems itself, and sends the
document and the descriptors that reserve ports and ROS domains.
"""

from __future__ import annotations

import argparse
import logging
import os
import socket
import sys
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NoReturn

from trocar.procs.document.system import SystemConfig, from_json, to_json
from trocar.procs.machine.imports import many_imports
from trocar.procs.machine.verb_lines import default_system
from trocar.procs.node.realtime import cores
from trocar.procs.node.setup_error import SetupError
from trocar.procs.supervisor.template import die_with, end, traced
from trocar.shm.system import loglines

if TYPE_CHECKING:
    from trocar.procs.supervisor.addresses import Reservations

RECORDER: Final = "TROCAR_RECORDER"
"""Environment variable; 0: no recorder unless the system file has one, for programs that start hundreds of systems."""
MAX_MARKS: Final = 250
BLOCK: Final = 1 << 16
REPORTED: Final = 1
"""Exit code when the problems were logged."""
log = logging.getLogger("supervisor")


class Configuration:
    """A process that reads the configuration of a command line, from now until `document`."""

    def __init__(self, chosen: argparse.Namespace) -> None:
        """Fork it."""
        self._ours, theirs = socket.socketpair()
        supervisor = os.getpid()
        with theirs:
            if not (pid := os.fork()):
                self._ours.close()
                _run(theirs, chosen, supervisor)
        self._pid = pid

    def document(self, held: ExitStack) -> SystemConfig | None:
        """The document, whose ports and ROS domains `held` reserves; None after problems, which are logged."""
        with self._ours:
            _, marks, _, _ = socket.recv_fds(self._ours, 1, MAX_MARKS)
            for mark in marks:
                held.callback(os.close, mark)
            text = bytearray()
            while part := self._ours.recv(BLOCK):
                text += part
        code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        if code and code != REPORTED:
            log.error("the process that read the configuration has ended with exit code %d", code)
        return None if code else from_json(bytes(text))


def _run(answers: socket.socket, chosen: argparse.Namespace, supervisor: int) -> NoReturn:
    die_with(supervisor)
    end(traced(lambda: _answer(answers, chosen)))


def _answer(answers: socket.socket, chosen: argparse.Namespace) -> int:
    with many_imports():
        from trocar.procs.supervisor.addresses import Reservations
    loglines.begin(sys.stderr)
    with answers, Reservations() as reservations:
        if (system := _load(chosen, reservations)) is None:
            return REPORTED
        socket.send_fds(answers, [b"d"], [mark.fileno() for mark in reservations.marks])
        answers.sendall(to_json(system))
    return 0


def _load(chosen: argparse.Namespace, reservations: Reservations) -> SystemConfig | None:
    """The document of the command line; None after problems, which are logged."""
    from trocar.procs.config import Machine, load_system
    from trocar.procs.supervisor.addresses import at_free_addresses, free_address

    name = chosen.system or default_system()
    if chosen.document:
        try:
            return at_free_addresses(replace(from_json(chosen.file.read_bytes()), name=name))
        except (SetupError, OSError, ValueError) as error:
            log.error("%s: %s", chosen.file, error)
            return None
    try:
        loaded = load_system(chosen.file, search=chosen.path, boards=chosen.boards, sets=chosen.sets, name=name,
                             machine=Machine(free_address(name), reservations, cores()),
                             records=os.environ.get(RECORDER) != "0")
    except SetupError as error:
        log.error("%s", error)
        return None
    for problem in (*loaded.errors, *loaded.warnings):  # errors first
        log.log(logging.ERROR if problem in loaded.errors else logging.WARNING, "%s", problem)
    if loaded.errors or loaded.system is None:
        log.error("nothing was started")
        return None
    return loaded.system
