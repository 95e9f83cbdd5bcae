"""The life of a process of a user's own: its class is found, made and run, with an exit code on every path."""

from __future__ import annotations

import contextlib
import faulthandler
import logging
import sys
from collections.abc import Callable
from types import ModuleType

from trocar.procs.document.system import SystemConfig, from_json
from trocar.procs.node import runtime
from trocar.procs.node.setup_error import exit_code, explains_itself
from trocar.procs.user.process import UserNode
from trocar.shm.mailbox.origins import ACTING, NOBODY
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.control_page import ControlPage


def classes_in(module: ModuleType) -> list[type[UserNode]]:
    """The subclasses of Process that a module defines."""
    return [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, UserNode)
            and kind.__module__ == module.__name__]


def live(kind: str, find: Callable[[SystemConfig, str], type[UserNode]]) -> None:
    """Exit code 0: ended as asked, or by itself, 3: setup failed, 4: its main did. `find` gives an instance's class."""
    faulthandler.enable()  # its log shows where it was when the supervisor ends it (SIGABRT), or C code crashes
    chosen = runtime.arguments(kind)
    log = logging.getLogger(chosen.name)
    ACTING.origin = NOBODY  # it was started by nobody: what it does is what persons ask it for
    try:
        made = find(from_json(directory.document(chosen.system)), chosen.name)
        process = made(chosen.system, chosen.name)
    except SegmentError as error:  # there is no place, or somebody else has it
        log.error("%s", error)
        sys.exit(runtime.SETUP_FAILED)
    except (Exception, SystemExit) as error:  # of the user's module, or its row
        log.exception("%s cannot be used", chosen.name)
        with contextlib.suppress(SegmentError), contextlib.closing(
                ControlPage(chosen.system, chosen.name, write=True)) as page:
            page.show("FAILED", runtime.cause_of(error))
        sys.exit(runtime.SETUP_FAILED)
    runtime.on_stop(process.stop)
    shown, why = process.own.page, ""
    try:
        process.run()
    except (Exception, SystemExit) as error:
        why = runtime.cause_of(error)
        if not isinstance(error, SystemExit) or error.code:
            running = shown.state == "RUNNING"
            log.error("ended by an error: %s", error, exc_info=not explains_itself(error))
            shown.show("FAILED", why)
            sys.exit(exit_code(error, runtime.LOOP_FAILED if running else runtime.SETUP_FAILED))
    why = why or process.stop_reason or "its main has returned"
    shown.show("STOPPED", why)
    log.info("ended: %s", why)
    process.close()
