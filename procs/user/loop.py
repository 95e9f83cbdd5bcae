"""A process of a user's own: finds the class or function in the module that the system file names, and runs it."""

from __future__ import annotations

import contextlib
import logging
import sys
from types import ModuleType

from procs import runtime
from procs.document.system import from_json
from procs.user_code import module_named
from procs.user_process import OwnProcess
from shm import directory
from shm.control_page import ControlPage
from shm.origins import ACTING, NOBODY
from shm.segment import SegmentError


class FunctionLoop(OwnProcess):
    """A function with a loop in the place of a class."""

    module: ModuleType

    def main(self) -> None:
        """That function."""
        self.module.main(self)


def class_in(module: ModuleType) -> type[OwnProcess]:
    """The subclass of Process, or one around its function `main`; ImportError when there is not one of them."""
    classes = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, OwnProcess)
               and kind.__module__ == module.__name__]
    if len(classes) == 1:
        return classes[0]
    if not classes and callable(getattr(module, "main", None)):
        return type("UserLoop", (FunctionLoop,), {"module": module})
    raise ImportError(f"{module.__name__} has {len(classes)} subclasses of trocar.Process; there must be one, or a "
                      "function main(process)")


def main() -> None:
    """Exit code 0: ended as asked, 3: setup failed, 4: its main did."""
    chosen = runtime.arguments("user")
    log = logging.getLogger(chosen.name)
    ACTING.origin = NOBODY  # it was started by nobody: what it does is what persons ask it for
    try:
        declared = from_json(directory.document(chosen.system)).user(chosen.name)
        made = class_in(module_named(declared.module)) if declared is not None else OwnProcess
        process = made(chosen.system, chosen.name)
    except (SegmentError, ValueError) as error:
        log.error("%s", error)
        sys.exit(runtime.SETUP_FAILED)
    except Exception as error:  # of the user's module
        log.exception("%s cannot be used", chosen.name)
        with contextlib.closing(ControlPage(chosen.system, chosen.name, write=True)) as page:
            page.show("FAILED", f"{type(error).__name__}: {error}")
        sys.exit(runtime.SETUP_FAILED)
    runtime.on_stop(process.stop)
    shown = process.own.page
    try:
        process.run()
    except Exception as error:
        running = shown.state == "RUNNING"
        log.exception("ended by an error")
        shown.show("FAILED", f"{type(error).__name__}: {error}")
        sys.exit(runtime.LOOP_FAILED if running else runtime.SETUP_FAILED)
    shown.show("STOPPED", process.stop_reason)
    log.info("ended: %s", process.stop_reason or "its main has ended")
    process.close()


if __name__ == "__main__":
    main()
