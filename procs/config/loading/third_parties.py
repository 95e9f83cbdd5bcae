"""Places for third-party programs: arms of a `_GENERIC` type, and other components with buttons for consoles.

Arms from ROS are such arms with our program: a component with `from: ros`, or one of the library `dvrk_arm_from_ros`.
The components of `component_manager`, which the original software loads into its program, are not used here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final, NamedTuple

from trocar.procs.config.loading.arms import base_frame_of, reference_of
from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.context import Opened
from trocar.procs.config.loading.overrides import PROCESSES
from trocar.procs.config.models.system_file import RESERVED, ArmKeys, InterfaceKeys, SystemFile
from trocar.procs.config.read.sections import is_name
from trocar.procs.document.arms import ThirdParty
from trocar.procs.document.bridges import RosArm, RosBridge, is_here
from trocar.procs.document.user_process import UserProcess
from trocar.procs.machine.extras import missing

KEY: Final = ("component_manager",)
FROM_ROS: Final = "from_ros"
_THIRD_PARTY: Final = "docs/third-party-masters.md"
# Parts of the name of a component's class or library, in lower case, and our substitute.
_INSTEAD: Final = (
    (("forcedimension", "sensable", "phantom", "novint", "falcon", "haply", "psmove"),
     f"your own program in place of an arm of type MTM_GENERIC ({_THIRD_PARTY})"),
    ((FROM_ROS,), "an arm of a _GENERIC type with this component (docs/ros.md)"),
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


# -- component_manager -------------------------------------------------------------------------------------------------


def warn_of_components(system: Opened[SystemFile]) -> None:
    """Add one warning with all components of the file, which are not started, and their substitutes."""
    manager = system.content.component_manager
    if not manager:
        return
    jobs: dict[str, list[str]] = {}
    used = {arm.component.name for arm in system.content.arms if arm.type.endswith("_GENERIC")} & from_ros(manager)
    rows = _components(manager)
    for row in rows:
        if row.name not in used:
            jobs.setdefault(_instead_of(row.words), []).append(row.kind)
    if rows and not jobs:
        return
    names = [name for group in jobs.values() for name in group]
    left_out = ", ".join(names) if names else "all its components"
    allowed = "; ".join(f"for {', '.join(group)}: {job}" for job, group in jobs.items()) or _OTHERS
    system.warning(KEY, f"not started: {left_out}; everything else is started", allowed)


def from_ros(manager: object) -> frozenset[str]:
    """Names of the components that take an arm from ROS: such a name is also the namespace of the arm there."""
    return frozenset(row.name for row in _components(manager) if row.name and FROM_ROS in row.words)


class Component(NamedTuple):
    """A listed component: its own name, the name of its class or library, and the words that identify its kind."""

    name: str
    kind: str
    words: str


def _instead_of(words: str) -> str:
    return next((job for marks, job in _INSTEAD if any(mark in words for mark in marks)), _OTHERS)


def _components(manager: object) -> list[Component]:
    """All components, each once. Entries of another form are skipped."""
    listed = manager.get("components") if isinstance(manager, dict) else manager
    found = []
    for row in listed if isinstance(listed, list) else ():
        if not isinstance(row, dict):
            continue
        kind, library = (next((str(row[key]) for key in keys if key in row), "")
                         for keys in (("class-name", "class_name"), ("shared-library", "shared_library")))
        given = row.get("constructor-arg", row.get("constructor_arg"))
        name = given.get("Name", given.get("name", "")) if isinstance(given, dict) else ""
        found.append(Component(str(name) if FROM_ROS in f"{kind} {library}".lower() else "",
                               kind or library or "a component without a class", f"{kind} {library}".lower()))
    return list(dict.fromkeys(found))


# -- places ------------------------------------------------------------------------------------------------------------

GENERIC: Final = "_GENERIC"
COMPONENTS: Final = "COMPONENTS"
BUTTONS: Final = ("clutch", "camera", "operator_present")
_MAX_BUTTON: Final = 24  # size of the field in an event
MODULE: Final = "trocar.tools.from_ros.arm"
PERIOD_S: Final = 0.005


def load_third_parties(system: SystemFiles) -> tuple[ThirdParty, ...]:
    """Generic arms, then other components with inputs of consoles, each with its required buttons."""
    content, found = system.content, {}
    parts = [part for part in system.each("arms", content.arms) if part.content.type.endswith(GENERIC)]
    for part in parts:
        keys = part.content
        found[keys.name] = ThirdParty(keys.name, keys.type, (), base_frame_of(part), reference_of(keys),
                                      ros_arm_of(system, part))
    for part in parts:
        if part.content.base_frame is not None and part.content.base_frame.transform is None:
            part.warning("base_frame", "the program that provides this arm has to apply it itself",
                         "reference_frame and transform")
    for console in system.each("consoles", content.consoles):
        for button in BUTTONS if console.content.input_type == COMPONENTS else ():
            keys_of_button = getattr(console.content, button)
            if keys_of_button is not None and keys_of_button.component not in [row.name for row in content.IOs]:
                _add_button(content, console.at(button, keys_of_button), found)
    return tuple(found.values())


def place_of(content: SystemFile, button: InterfaceKeys) -> str:
    """The process or place of a button: a generic arm may be named by its component, too.

    Of several arms of one component, the one whose interface begins the button's (`MTMR/A`); "" if there is none.
    """
    arms = _arms_of(content, button)
    if len(arms) > 1:
        return next((row.name for row in arms if button.interface.startswith(f"{row.interface or row.name}/")), "")
    return arms[0].name if arms else button.component


def _arms_of(content: SystemFile, button: InterfaceKeys) -> list[ArmKeys]:
    return [row for row in content.arms if row.type.endswith(GENERIC) and row.component.name == button.component]


def _add_button(content: SystemFile, part: Opened[InterfaceKeys], found: dict[str, ThirdParty]) -> None:
    """Add the button of one console input to a third-party program."""
    keys, name = part.content, place_of(content, part.content)
    if not name:
        arms = _arms_of(content, keys)
        part.error("interface", f"{keys.component} provides {', '.join(row.name for row in arms)}: which arm's button "
                   "is it?", " or ".join(f"{row.interface or row.name}/{keys.interface}" for row in arms)
                   + ", or the name of the arm as component")
        return
    if name not in found:
        is_taken = name in _taken(content)
        if is_taken or not is_name(name):
            text = "used by a component without buttons" if is_taken else "not a name for a place in the system"
            part.error("component", text, "an IO, an arm of a _GENERIC type, or a unique name of letters, digits, _ "
                       "and -, at most 40, for your own program")
            return
        found[name] = ThirdParty(name, "")
    if not 0 < len(keys.interface.encode()) <= _MAX_BUTTON:
        part.error("interface", "not a name for a button", f"1 to {_MAX_BUTTON} bytes")
    elif found[name].ros is not None:
        part.error("component", f"{name} is an arm from ROS, which has no buttons",
                   "an IO, or a unique name for your own program")
    elif keys.interface not in found[name].inputs:
        found[name] = dataclasses.replace(found[name], inputs=(*found[name].inputs, keys.interface))


def _taken(content: SystemFile) -> set[str]:
    """Names of everything in a file but its buses."""
    names = RESERVED | {row.name for rows in (content.arms, content.consoles) for row in rows}
    for console in content.consoles:
        names |= {f"{row.MTM}_{row.PSM}" for row in console.teleop_PSMs}
        names |= {f"{row.MTML}_{row.MTMR}_{row.ECM}" for row in console.teleop_ECMs}
    return set(names)


# -- arms from ROS -----------------------------------------------------------------------------------------------------


def is_from_ros(content: SystemFile, keys: ArmKeys) -> bool:
    """Whether an arm is taken from ROS, in one of both forms."""
    return keys.component.source is not None or keys.component.name in from_ros(content.component_manager)


def ros_arm_of(system: SystemFiles, part: Opened[ArmKeys]) -> RosArm | None:
    """Where an arm is on ROS; None: it is a third-party program's."""
    keys, given, bridge = part.content, part.content.component, system.options.ros
    if not is_from_ros(system.content, keys):
        return None
    usual = RosBridge() if bridge is None else bridge
    namespace = f"/{(given.namespace or given.name or keys.name).strip('/')}"
    domain = usual.domain if given.domain is None else given.domain
    interface = usual.interface if given.interface is None else given.interface
    row = RosArm(namespace, domain, interface, given.check_names)
    if lacks := missing("cyclonedds", "an arm from ROS"):
        part.error("component", lacks)
    if bridge is not None and (bridge.domain, bridge.interface) == (domain, interface):
        ours = {f"/{bridge.namespace}/{arm.name}".replace("//", "/") for arm in system.content.arms}
        if namespace in ours - {f"/{bridge.namespace}/{keys.name}".replace("//", "/")}:
            part.error("component", f"{namespace} is an arm of this system: its own ROS bridge publishes it",
                       "the namespace of an arm of another system, or another domain")
    if not is_here(interface):
        system.note(f"{keys.name} is {row.where}: every program on that network can publish as this arm")
    return row


def check_components(system: SystemFiles) -> None:
    """Check that only arms of a _GENERIC type have a component from ROS, and that other components have no such keys.
    """
    for part in system.each("arms", system.content.arms):
        keys, given = part.content, part.content.component
        if given.source is not None and not keys.type.endswith(GENERIC):
            part.error("component.from", f"{keys.name} is of type {keys.type}, which Trocar drives itself",
                       f"{keys.type.split('_')[0]}_GENERIC as its type")
        for name in ("namespace", "domain", "interface"):
            if given.source is None and getattr(given, name) is not None:
                part.error(("component", name), "it belongs to an arm from ROS", "from: ros beside it")


def programs_of(system: SystemFiles, third_parties: Sequence[ThirdParty]) -> tuple[UserProcess, ...]:
    """Our program in the place of each arm from ROS."""
    found = []
    for row in third_parties:
        if row.ros is None:
            continue
        own = system.own(row.name)
        if own.module is not None:
            system.error((*PROCESSES, row.name, "module"), f"{row.name} is {row.ros.where}", "no module")
        found.append(UserProcess(row.name, MODULE, own.period_s or PERIOD_S))
    return tuple(found)
