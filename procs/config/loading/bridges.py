"""What a system serves elsewhere: `trocar.socket`, `trocar.gui` and `trocar.foxglove`."""

from __future__ import annotations

from trocar.procs.config.loading.context import Context
from trocar.procs.config.models.bridge_section import CertificateKeys, FoxgloveKeys, GuiKeys, SocketKeys, TlsKeys
from trocar.procs.config.read.source import SourceFile
from trocar.procs.document.bridges import FoxgloveServer, SocketBridge, WebConsole, is_loopback


def load_socket(context: Context, source: SourceFile, keys: SocketKeys | None) -> SocketBridge | None:
    """None without one. Who listens to other machines has to know who comes: an error when nothing says so."""
    if keys is None:
        return None
    outside = _outside(context, source, keys)
    if outside:
        context.notes.append(f"socket_bridge: listens to other machines at {', '.join(outside)}")
    if outside and keys.grants == "command":
        context.notes.append(f"socket_bridge: clients at {', '.join(outside)} may command"
                             + (", and power" if keys.may_power else ""))
    return SocketBridge(keys.listen, _file(context, source, ("socket", "token_file"), keys.token_file),
                        *_tls(context, source, "socket", keys.tls), keys.grants, keys.may_power, keys.max_clients)


def load_gui(context: Context, source: SourceFile, keys: GuiKeys | None) -> WebConsole | None:
    """None without one. Where nothing says who may come from other machines, a token is made at each start."""
    if keys is None:
        return None
    outside = [address for address in keys.listen if not is_loopback(address)]
    makes_token = bool(outside) and not _knows_who(keys)
    made = WebConsole(keys.listen, _file(context, source, ("gui", "token_file"), keys.token_file),
                      *_tls(context, source, "gui", keys.tls), keys.max_clients, makes_token)
    context.notes.append(f"gui: the robot in a browser: {', '.join(made.links())}")
    if outside:
        token = "the token that is made at each start" if makes_token else "the token"
        context.notes.append(f"gui: who has {token} may take control at {', '.join(outside)}")
    return made


def load_foxglove(context: Context, source: SourceFile, keys: FoxgloveKeys | None) -> FoxgloveServer | None:
    """None without one. Its clients cannot show a token, and only look; elsewhere at least nobody else listens."""
    if keys is None:
        return None
    if not is_loopback(keys.listen):
        if keys.tls is None:
            context.error(source, ("trocar", "foxglove", "listen"), f"the network could read along at {keys.listen}",
                          "tls with certificate and key; or an address of this machine alone, 127.0.0.1:8765")
        context.notes.append(f"foxglove: whoever comes to {keys.listen} may look")
    certificate, key, _ = _tls(context, source, "foxglove", keys.tls)
    return FoxgloveServer(keys.listen, keys.rate_hz, certificate, key)


def _knows_who(keys: SocketKeys | GuiKeys) -> bool:
    """Whether clients have to show something that was stated."""
    return bool(keys.token_file or (keys.tls and keys.tls.clients))


def _outside(context: Context, source: SourceFile, keys: SocketKeys) -> list[str]:
    """Addresses that are not loopback."""
    outside = [address for address in keys.listen if not is_loopback(address)]
    if outside and not _knows_who(keys):
        context.error(source, ("trocar", "socket", "listen"), f"anybody could come to {', '.join(outside)}",
                      "a token_file, or tls with clients; or an address of this machine alone, "
                      f"{type(keys)().listen[0]}")
    return outside


def _tls(context: Context, source: SourceFile, section: str,
         keys: TlsKeys | CertificateKeys | None) -> tuple[str, str, str]:
    """Paths of certificate and key, and of the clients' authorities; empty where there is none."""
    if keys is None:
        return "", "", ""
    at = section, "tls"
    clients = keys.clients if isinstance(keys, TlsKeys) else ""
    return (_file(context, source, at, keys.certificate), _file(context, source, at, keys.key),
            _file(context, source, at, clients))


def _file(context: Context, source: SourceFile, key: tuple[str, ...], name: str) -> str:
    """The path of a file on the search path; empty without a name."""
    found = context.find(source, ("trocar", *key), (name,)) if name else None
    return str(found.absolute()) if found is not None else ""
