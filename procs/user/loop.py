"""A user's process: runs the class or function in the module that the system file names."""

from __future__ import annotations

import contextlib
import faulthandler
import logging
import sys
from types import ModuleType

from trocar.procs.document.system import SystemConfig
from trocar.procs.node.life import SETUP_FAILED, arguments, cause_of, document_of, lived
from trocar.procs.tables.manifest import FILTERS
from trocar.procs.user.classes import classes_in, module_named
from trocar.procs.user.filters import FiltersLoop
from trocar.procs.user.process import UserNode
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.control_page import ControlPage


class FunctionLoop(UserNode):
    """A user's process that is a function `main` instead of a class."""

    module: ModuleType

    def check_commands(self) -> None:
        """See UserNode; no check, because the function itself makes the handlers."""

    def main(self) -> None:
        """Call the function."""
        self.module.main(self)


def class_in(module: ModuleType) -> type[UserNode]:
    """The module's subclass of Process, or one that runs its function `main`; ImportError if there is not just one."""
    classes = classes_in(module, UserNode)
    if len(classes) == 1:
        return classes[0]
    if not classes and callable(getattr(module, "main", None)):
        return type("UserLoop", (FunctionLoop,), {"module": module})
    raise ImportError(f"{module.__name__} has {len(classes)} subclasses of trocar.Process; there must be one, or a "
                      "function main(process)")


def found(document: SystemConfig, name: str) -> type[UserNode]:
    """The class of the process with this name, by the system file."""
    if document.process(name).kind == FILTERS:
        return FiltersLoop
    declared = document.user(name)
    return UserNode if declared is None else class_in(module_named(declared.module))


def live(kind: str, own: type[UserNode] | None = None) -> None:
    """Run a user's process. Exit code 0: ended on request or by itself, 3: setup failed, 4: main failed.

    `own`: a class of ours to run instead.
    """
    faulthandler.enable()  # its log shows where it was when the supervisor ends it (SIGABRT), or C code crashes
    chosen = arguments(kind)
    log = logging.getLogger(chosen.name)
    ACTING.confine(chosen.system)  # no operator has started it: it acts only on operators' commands to its system
    try:
        process = (own or found(document_of(chosen.system), chosen.name))(chosen.system, chosen.name)
    except SegmentError as error:  # no such instance, or it is taken
        log.error("%s", error)
        sys.exit(SETUP_FAILED)
    except (Exception, SystemExit) as error:  # in the user's module, or its row
        log.exception("%s cannot be used", chosen.name)
        with contextlib.suppress(SegmentError), contextlib.closing(
                ControlPage(chosen.system, chosen.name, write=True)) as page:
            page.show("FAILED", cause_of(error))
        sys.exit(SETUP_FAILED)
    with lived(process.own, traces=own is None):  # which line of the user's it was
        process.run()
    process.close()


def main() -> None:
    """Run a user's process."""
    live("user")


if __name__ == "__main__":
    main()
