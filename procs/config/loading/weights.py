"""What gravity compensation of an arm goes by: links with masses, or what was measured on a master."""

from __future__ import annotations

from trocar.procs.config.loading.chains import load_chain
from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.arm_file import ArmFile, MtmFile
from trocar.procs.config.models.gravity_file import load_master_gravity
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import system as document
from trocar.procs.document.gravity_parameters import MasterGravityParameters
from trocar.procs.tables.arm_types import ARM_TYPES


def weighing_links(context: Context, source: SourceFile, content: ArmFile, family: str) -> document.Chain | None:
    """The links of an arm with their masses; None: it needs none, or with errors."""
    row = ARM_TYPES[family]
    search = context.search.first(source.path.parent)
    name = content.kinematic_gc or row.physical.get(content.generation, "")
    if not name or not row.physical_links:
        return None
    path = context.find(source, ("kinematic_gc",), (name,), search)
    chain = load_chain(context, path) if path is not None else None
    if chain is None or len(chain.links) in row.physical_links:
        return chain
    allowed = f"{' or '.join(map(str, row.physical_links))} rows for gravity compensation of this arm"
    context.error(source, ("kinematic_gc",), f"chain of {len(chain.links)} rows", allowed)
    return None


def measured_weight(context: Context, source: SourceFile, content: MtmFile) -> MasterGravityParameters | None:
    """What a master's gravity-compensation file says; None: it names none, or with errors."""
    name, search = content.gravity_compensation, context.search.first(source.path.parent)
    if not name:
        return None
    path = context.find(source, ("gravity_compensation",), (name,), search)
    return load_master_gravity(context, path) if path is not None else None
