"""Arms of a `_DERIVED` type: a user's own class is their process. It is looked for, and not run, here."""

from __future__ import annotations

from typing import Final

from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.modules import module_of
from trocar.procs.config.loading.overrides import SECTION
from trocar.procs.config.loading.user_processes import commands_in
from trocar.procs.config.models.system_file import ArmKeys
from trocar.procs.config.models.trocar_section import TrocarSection
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document.user_process import UserCommand

DERIVED: Final = "_DERIVED"


def is_foreign(context: Context, keys: ArmKeys) -> bool:
    """Whether its component is one of the original program, which is not started; a note says so."""
    if not keys.type.endswith(DERIVED) or "." in keys.component or not keys.component:
        return False
    context.notes.append(f"not started: {keys.name} ({keys.type}): {keys.component} is a component of the original "
                         "program; name a class of Python, module.Class (docs/derived-arms.md)")
    return True


def derived_class(context: Context, source: SourceFile, key: Key, keys: ArmKeys) -> str:
    """The class that is an arm, as module:Class; "" where its type's own is."""
    module, _, name = keys.component.rpartition(".")
    if not keys.type.endswith(DERIVED) or not module:
        return ""
    if not name.isidentifier():
        context.error(source, key, "not the name of a class", "module.Class; the module is a file beside this one")
    return f"{module_of(context, source, key, module)}:{name}"


def derived_commands(context: Context, source: SourceFile, keys: ArmKeys, options: TrocarSection
                     ) -> tuple[UserCommand, ...]:
    """The commands that it carries out besides those of every arm, as `trocar.processes` declares them."""
    row = options.processes.get(keys.name)
    if row is None or not keys.type.endswith(DERIVED):
        return ()
    return commands_in(context, source, (SECTION, "processes", keys.name, "commands"), row.commands)
