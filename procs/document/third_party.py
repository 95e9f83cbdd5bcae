"""Places that third-party programs take: an arm that is not ours, or the pedals of a console."""

from __future__ import annotations

from dataclasses import dataclass

from trocar.procs.document.arms import Matrix


@dataclass(frozen=True, slots=True)
class ThirdParty:
    """One place; what the program has to say there is the record `state` of the kind `third_party`.

    `inputs` are the buttons that consoles take from it.
    """

    name: str
    type: str  # MTM_GENERIC, PSM_GENERIC or ECM_GENERIC; "": no arm, buttons alone
    inputs: tuple[str, ...] = ()
    base_frame: Matrix | None = None  # of the arm's base in the reference frame
    reference_frame: str = ""
