"""Loads the sections of bridges, web console and recorder: `trocar.socket`, `gui`, `foxglove`, `ros`, `recorder`."""

from __future__ import annotations

from typing import Final, Protocol

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.convert import by_name
from trocar.procs.config.loading.third_parties import is_from_ros
from trocar.procs.config.models.system_file import SystemFile
from trocar.procs.config.models.trocar_section import (
    FoxgloveKeys,
    GuiKeys,
    RosOptions,
    SocketKeys,
    TlsKeys,
    TrocarSection,
)
from trocar.procs.config.read.search import expanded
from trocar.procs.document.bridges import (
    COMMAND,
    FoxgloveServer,
    RosBridge,
    SocketBridge,
    WebConsole,
    is_here,
    is_loopback,
)
from trocar.procs.document.recorder import Recorder
from trocar.procs.machine.extras import missing
from trocar.procs.machine.interfaces import lacks_interface

MODULES: Final = {"ros": "cyclonedds", "gui": "starlette", "foxglove": "foxglove"}
"""The package that the process of a section needs."""


def load_ros(system: SystemFiles) -> RosBridge | None:
    """The ROS bridge; None without one. By default, only clients on this machine may power the robot."""
    options = system.options.ros
    if options is None:
        return None
    _check_package(system, "ros", "the ROS bridge")
    here = is_here(options.interface)
    may_power = here if options.may_power is None else options.may_power
    if not here:
        what = "see, command, power and home" if may_power else "see and command"
        system.note(f"ros: every program on the network of {options.interface} may {what} the robot")
        if lacks := lacks_interface(options.interface):
            system.warning(("trocar", "ros", "interface"), f"{options.interface}: {lacks}")
    return by_name(RosBridge, options, may_power=may_power)


def load_recorder(system: SystemFiles, usually: bool) -> Recorder | None:
    """The recorder; None without one; `usually`: the default if the file does not specify it."""
    keys = system.options.recorder
    if not (usually if keys.on is None else keys.on):
        return None
    return by_name(Recorder, keys, folder=str(expanded(keys.folder).absolute()) if keys.folder else "")


def load_socket(system: SystemFiles) -> SocketBridge | None:
    """The socket bridge; None without one. Listening to other machines without authentication is an error."""
    keys = system.options.socket
    if keys is None:
        return None
    made, outside = by_name(SocketBridge, keys, **_files(system, "socket", keys)), _outside(keys)
    if outside and not _knows_who(keys):
        system.error("trocar.socket.listen", f"anyone could connect to {', '.join(outside)}",
                     "a token_file, or tls with clients; or an address that only this machine reaches, "
                     f"{SocketKeys().listen[0]}")
    if outside:
        system.note(f"socket_bridge: listens to other machines at {', '.join(outside)}")
    if outside and made.grants == COMMAND:
        system.note(f"socket_bridge: clients at {', '.join(outside)} may command"
                    + (" and switch power" if made.may_power else ""))
    return made


def load_gui(system: SystemFiles) -> WebConsole | None:
    """The web console; None without one. If other machines can connect without configured authentication, a token is
    made at each start.
    """
    keys = system.options.gui
    if keys is None:
        return None
    _check_package(system, "gui")
    outside = _outside(keys)
    makes_token = bool(outside) and not _knows_who(keys)
    made = by_name(WebConsole, keys, makes_token=makes_token, **_files(system, "gui", keys))
    system.note(f"gui: the robot in a browser: {', '.join(made.links())}")
    if outside:
        token = "the token that is made at each start" if makes_token else "the token"
        system.note(f"gui: clients with {token} may take control at {', '.join(outside)}")
    return made


def load_foxglove(system: SystemFiles) -> FoxgloveServer | None:
    """The Foxglove server; None without one. Its clients are view only and cannot send a token; listening to other
    machines requires TLS, against eavesdropping.
    """
    keys = system.options.foxglove
    if keys is None:
        return None
    if not is_loopback(keys.listen):
        if keys.tls is None:
            system.error(("trocar", "foxglove", "listen"), f"other machines could read the data at {keys.listen}",
                          "tls with certificate and key; or an address that only this machine reaches, 127.0.0.1:8765")
        system.note(f"foxglove: every program that reaches {keys.listen} may view the robot")
    _check_package(system, "foxglove")
    return by_name(FoxgloveServer, keys, **_files(system, "foxglove", keys))


def _check_package(system: SystemFiles, section: str, purpose: str = "") -> None:
    """An error if this process cannot run here."""
    if lacks := missing(MODULES[section], purpose):
        system.error(("trocar", section), f"{lacks}; to start without it: --set {section}=null")


def _knows_who(keys: SocketKeys | GuiKeys) -> bool:
    """Whether clients must authenticate by a configured token or certificate."""
    return bool(keys.token_file or (keys.tls and keys.tls.clients))


def _outside(keys: SocketKeys | GuiKeys) -> list[str]:
    """Addresses that are not loopback."""
    return [address for address in keys.listen if not is_loopback(address)]


def _files(system: SystemFiles, section: str, keys: SocketKeys | GuiKeys | FoxgloveKeys) -> dict[str, str]:
    """Paths of the token, and of certificate, key and the clients' authorities, as the document names them."""
    named = {} if isinstance(keys, FoxgloveKeys) else {"token_file": ("token_file", keys.token_file)}
    if keys.tls is not None:
        named |= {"certificate": ("tls", keys.tls.certificate), "key": ("tls", keys.tls.key)}
    if isinstance(keys.tls, TlsKeys):
        named["authorities"] = "tls", keys.tls.clients
    found = {field: system.find(("trocar", section, key), name) if name else None
             for field, (key, name) in named.items()}
    return {field: str(path.absolute()) if path is not None else "" for field, path in found.items()}


LAST_DOMAIN: Final = 101  # the ports of higher ones lie among those that Linux gives to outgoing connections


class Free(Protocol):
    """What the programs of this machine have left; each answer is reserved until the system ends."""

    def address(self, usual: str) -> str:
        """The usual address, or the next free port there."""

    def domain(self, first: int, last: int) -> int | None:
        """The first ROS domain of these that no other system has; None: there is none."""


def at_free_defaults(context: Context, content: SystemFile, options: TrocarSection, free: Free) -> TrocarSection:
    """The section with free ports and a free ROS domain where it names none; a note for each that is not the usual."""
    changes: dict[str, object] = {}
    for name in ("gui", "socket", "foxglove"):
        keys = getattr(options, name)
        if keys is None or "listen" in keys.model_fields_set:
            continue
        several = isinstance(keys.listen, tuple)
        usual = keys.listen[0] if several else keys.listen
        address = free.address(usual)
        if address != usual:
            context.notes.append(f"{name}: listens at {address}, as {usual} is in use")
            changes[name] = keys.model_copy(update={"listen": (address,) if several else address})
    if options.ros is not None and is_here(options.ros.interface):
        domain = _domain(context, options.ros, any(is_from_ros(content, arm) for arm in content.arms), free)
        changes["ros"] = options.ros.model_copy(update={"domain": domain})
    return options.model_copy(update=changes)


def _domain(context: Context, ros: RosOptions, joins: bool, free: Free) -> int:
    """The domain of the bridge; that of a system which `joins` others, or whose file names a domain, stays."""
    usual = ros.domain
    is_chosen = joins or "domain" in ros.model_fields_set
    domain = free.domain(usual, usual if is_chosen else LAST_DOMAIN)
    if domain is None:
        context.notes.append(f"ros: another system of this machine has ROS domain {usual}, too: programs there see "
                             "both, and command both where names are the same")
    elif domain != usual:
        context.notes.append(f"ros: in domain {domain}, as another system has {usual}; its clients need "
                             f"ROS_DOMAIN_ID={domain}")
    return usual if domain is None else domain
