"""A process of a user's own: finds the class or function in the module that the system file names, and runs it."""

from __future__ import annotations

from types import ModuleType

from trocar.procs.document.system import SystemConfig
from trocar.procs.user.classes import module_named
from trocar.procs.user.life import classes_in, live
from trocar.procs.user.process import UserNode


class FunctionLoop(UserNode):
    """A function with a loop in the place of a class."""

    module: ModuleType

    def check_commands(self) -> None:
        """See UserNode; its handlers, if any, are made in that function."""

    def main(self) -> None:
        """That function."""
        self.module.main(self)


def class_in(module: ModuleType) -> type[UserNode]:
    """The subclass of Process, or one around its function `main`; ImportError when there is not one of them."""
    classes = classes_in(module)
    if len(classes) == 1:
        return classes[0]
    if not classes and callable(getattr(module, "main", None)):
        return type("UserLoop", (FunctionLoop,), {"module": module})
    raise ImportError(f"{module.__name__} has {len(classes)} subclasses of trocar.Process; there must be one, or a "
                      "function main(process)")


def find(document: SystemConfig, name: str) -> type[UserNode]:
    """What the process of this name is."""
    declared = document.user(name)
    return UserNode if declared is None else class_in(module_named(declared.module))


def main() -> None:
    """Run it to its end."""
    live("user", find)


if __name__ == "__main__":
    main()
