"""Where users' own code is: found when the system file is read, and run by nobody there."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

from trocar.procs.config.loading.context import Context
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.search import expanded
from trocar.procs.config.read.source import SourceFile


def _check_syntax(context: Context, source: SourceFile, key: Key, path: Path) -> None:
    """That Python can read it; nothing of it is run."""
    try:
        ast.parse(path.read_bytes(), str(path))
    except SyntaxError as wrong:
        context.error(source, key, f"{path} line {wrong.lineno}: {wrong.msg}", "Python without syntax errors")
    except (OSError, ValueError) as wrong:
        context.error(source, key, f"{path}: {wrong}", "a file with Python that can be read")


def module_of(context: Context, source: SourceFile, key: Key, name: str) -> str:
    """A file beside the system file, or in the working folder, as an absolute path; else an installed module's name."""
    folder = source.path.resolve().parent
    file = expanded(name if name.endswith(".py") else f"{name.replace('.', '/')}.py")
    for path in (folder / file, Path.cwd() / file):
        if path.is_file():
            _check_syntax(context, source, key, path)
            return str(path)
    if name.endswith(".py"):
        context.error(source, key, "no such file", f"a file; relative paths are meant from {folder}")
    elif not all(part.isidentifier() for part in name.split(".")):
        context.error(source, key, "not the name of a module", "a path that ends in .py, or a name like my_lab.damping")
    elif importlib.util.find_spec(name.split(".")[0]) is None:  # the first part alone: nothing is imported for it
        context.error(source, key, "no such module", f"a file in {folder}, or an installed module")
    return name
