"""Where an arm stands: the `base_frame` of a system file."""

from __future__ import annotations

from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.system_file import ArmKeys
from trocar.procs.config.read.matrices import check_rigid
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document import system as document


def base_frame_of(context: Context, source: SourceFile, key: Key, keys: ArmKeys) -> document.Matrix | None:
    """A fixed base frame; None without one, or when another component gives it."""
    frame = keys.base_frame
    if frame is None:
        return None
    where = (*key, "base_frame")
    fixed = (frame.reference_frame is not None, frame.transform is not None)
    driven = (frame.component is not None, frame.interface is not None)
    forms = "either reference_frame and transform, or component and interface"
    if any(fixed) == any(driven) or any(fixed) != all(fixed) or any(driven) != all(driven):
        context.error(source, where, "both forms or half a form", forms)
        return None
    if frame.transform is None:  # `carts.py` looks who gives it
        return None
    return frame.transform if check_rigid(context, source, (*where, "transform"), frame.transform) else None
