"""`component_manager`: components that the original software loads into its program; they are not used here."""

from __future__ import annotations

from typing import Final

from trocar.procs.config.loading.context import Opened
from trocar.procs.config.models.system_file import SystemFile

KEY: Final = ("component_manager",)
_THIRD_PARTY: Final = "docs/third-party-masters.md"
# Parts of the name of a component's class or library, in lower case, and our substitute.
_INSTEAD: Final = (
    (("forcedimension", "sensable", "phantom", "novint", "falcon", "haply", "psmove"),
     f"your own program in place of an arm of type MTM_GENERIC ({_THIRD_PARTY})"),
    (("from_ros",), f"your own program in place of an arm of a _GENERIC type ({_THIRD_PARTY})"),
    (("keyboard", "joystick", "3dconnexion", "footpedal", "gamepad"),
     "emulate_clutch, emulate_camera and emulate_operator_present of a console, or a program with buttons "
     f"({_THIRD_PARTY})"),
    (("ros",), "the ROS bridge, `trocar: {ros: {}}` (docs/ros.md)"),
    (("collector",), "`trocar echo TOPIC --json`"),
    (("igtl", "socket", "udp"), "shared memory, readable from every language (docs/shared-memory.md)"),
    (("teleop",), "TELEOP_PSM and TELEOP_ECM; for your own, write a script (docs/python.md)"),
    (("researchkitpsm", "researchkitmtm", "researchkitecm", "controllerspid"), "Trocar's arms and joint controllers; "
     "your own code between reading and writing attaches to io (docs/in-cycle.md)"),
)
_OTHERS: Final = f"your own process: a script (docs/python.md), or a program in an arm's place ({_THIRD_PARTY})"


def warn_of_components(system: Opened[SystemFile]) -> None:
    """Add one warning with all components of the file, which are not started, and their substitutes."""
    manager = system.content.component_manager
    if not manager:
        return
    jobs: dict[str, list[str]] = {}
    for name, words in _components(manager):
        jobs.setdefault(_instead_of(words), []).append(name)
    names = [name for group in jobs.values() for name in group]
    left_out = ", ".join(names) if names else "all it loads"
    allowed = "; ".join(f"for {', '.join(group)}: {job}" for job, group in jobs.items()) or _OTHERS
    system.warning(KEY, f"left out, everything else is started: {left_out}", allowed)


def _instead_of(words: str) -> str:
    return next((job for marks, job in _INSTEAD if any(mark in words for mark in marks)), _OTHERS)


def _components(manager: object) -> list[tuple[str, str]]:
    """All components: a name, and the words that identify the kind. Entries of another form are skipped."""
    listed = manager.get("components") if isinstance(manager, dict) else manager
    found = []
    for row in listed if isinstance(listed, list) else ():
        if not isinstance(row, dict):
            continue
        kind, library = (next((str(row[key]) for key in keys if key in row), "")
                         for keys in (("class-name", "class_name"), ("shared-library", "shared_library")))
        found.append((kind or library or "a component without a class", f"{kind} {library}".lower()))
    return list(dict.fromkeys(found))
