"""Import of users' modules and classes, only in the process that runs them."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import TypeVar

T = TypeVar("T")


def module_named(name: str) -> ModuleType:
    """Import a module by the path of a .py file, or by its name; errors of its code are passed on."""
    if not name.endswith(".py"):
        return importlib.import_module(name)
    path = Path(name)
    sys.path.insert(0, str(path.parent))  # modules in the same folder can be imported, too
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def classes_in(module: ModuleType, kind: type[T]) -> list[type[T]]:
    """The subclasses of `kind` that the module itself defines."""
    return [each for each in vars(module).values() if isinstance(each, type) and issubclass(each, kind)
            and each.__module__ == module.__name__]


def class_named(name: str, kind: type[T], base: str) -> type[T]:
    """The class named module:Class, a subclass of `kind`; otherwise ImportError with the reason.

    `base`: name of the base class for users.
    """
    module, _, what = name.rpartition(":")
    try:
        there = module_named(module)
    except Exception as error:
        raise ImportError(f"{module}: {type(error).__name__}: {error}") from error
    found = vars(there).get(what)
    if not (isinstance(found, type) and issubclass(found, kind)):
        own = [each.__name__ for each in classes_in(there, kind)]
        raise ImportError(f"{module} has no class {what} that is derived from {base}; "  # noqa: TRY004  # like the other two
                          f"it has: {', '.join(own) or 'none'}")
    return found
