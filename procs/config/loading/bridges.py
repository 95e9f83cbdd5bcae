"""Loads the sections of bridges, web console and recorder: `trocar.socket`, `gui`, `foxglove`, `ros`, `recorder`."""

from __future__ import annotations

from importlib.util import find_spec

from trocar.procs.config.loading.buses import SystemFiles
from trocar.procs.config.loading.convert import by_name
from trocar.procs.config.models.bridge_section import CertificateKeys, GuiKeys, SocketKeys, TlsKeys
from trocar.procs.config.read.search import expanded
from trocar.procs.document.bridges import NO_FOXGLOVE, FoxgloveServer, RosBridge, SocketBridge, WebConsole, is_loopback
from trocar.procs.document.recorder import Recorder
from trocar.procs.machine.interfaces import lacks_interface


def load_ros(system: SystemFiles) -> RosBridge | None:
    """The ROS bridge; None without one. By default, only clients on this machine may power the robot."""
    options = system.options.ros
    if options is None:
        return None
    here = options.interface == "lo" or options.interface.startswith("127.")
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
    outside = _outside(system, keys)
    if outside:
        system.note(f"socket_bridge: listens to other machines at {', '.join(outside)}")
    if outside and keys.grants == "command":
        system.note(f"socket_bridge: clients at {', '.join(outside)} may command"
                             + (", and power" if keys.may_power else ""))
    token_file = _file(system, "socket", "token_file", keys.token_file)
    certificate, key, authorities = _tls(system, "socket", keys.tls)
    return by_name(SocketBridge, keys, token_file=token_file, certificate=certificate, key=key, authorities=authorities)


def load_gui(system: SystemFiles) -> WebConsole | None:
    """The web console; None without one. If other machines can connect without configured authentication, a token is
    made at each start.
    """
    keys = system.options.gui
    if keys is None:
        return None
    outside = [address for address in keys.listen if not is_loopback(address)]
    makes_token = bool(outside) and not _knows_who(keys)
    token_file = _file(system, "gui", "token_file", keys.token_file)
    certificate, key, authorities = _tls(system, "gui", keys.tls)
    made = by_name(WebConsole, keys, token_file=token_file, certificate=certificate, key=key, authorities=authorities,
                   makes_token=makes_token)
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
    if find_spec("foxglove") is None:
        system.warning(("trocar", "foxglove"), NO_FOXGLOVE)
    certificate, key, _ = _tls(system, "foxglove", keys.tls)
    return by_name(FoxgloveServer, keys, certificate=certificate, key=key)


def _knows_who(keys: SocketKeys | GuiKeys) -> bool:
    """Whether clients must authenticate by a configured token or certificate."""
    return bool(keys.token_file or (keys.tls and keys.tls.clients))


def _outside(system: SystemFiles, keys: SocketKeys) -> list[str]:
    """Addresses that are not loopback; an error if clients need not authenticate there."""
    outside = [address for address in keys.listen if not is_loopback(address)]
    if outside and not _knows_who(keys):
        system.error(("trocar", "socket", "listen"), f"anyone could connect to {', '.join(outside)}",
                      "a token_file, or tls with clients; or an address that only this machine reaches, "
                      f"{type(keys)().listen[0]}")
    return outside


def _tls(system: SystemFiles, section: str, keys: TlsKeys | CertificateKeys | None) -> tuple[str, str, str]:
    """Paths of certificate and key, and of the clients' authorities; empty if not configured."""
    if keys is None:
        return "", "", ""
    clients = keys.clients if isinstance(keys, TlsKeys) else ""
    certificate, key, authorities = (_file(system, section, "tls", name)
                                     for name in (keys.certificate, keys.key, clients))
    return certificate, key, authorities


def _file(system: SystemFiles, section: str, key: str, name: str) -> str:
    """The path of a file on the search path; empty without a name."""
    found = system.find(("trocar", section, key), name) if name else None
    return str(found.absolute()) if found is not None else ""
