"""The socket bridge and the Foxglove server of a system, of `trocar.socket` and `trocar.foxglove`."""

from __future__ import annotations

from typing import Final

from procs.config.build.context import Context
from procs.config.models.bridge_section import FoxgloveKeys, SocketKeys
from procs.config.read.source import SourceFile
from procs.document.bridges import FoxgloveServer, SocketBridge, is_loopback

_KEY: Final = ("trocar", "socket")
_FOXGLOVE: Final = ("trocar", "foxglove")


def load_socket(context: Context, source: SourceFile, keys: SocketKeys | None) -> SocketBridge | None:
    """None without one. Who listens to other machines has to know who comes: an error when nothing says so."""
    if keys is None:
        return None
    outside = [address for address in keys.listen if not is_loopback(address)]
    if outside and not keys.token_file and not (keys.tls and keys.tls.clients):
        context.error(source, (*_KEY, "listen"), f"anybody could come to {', '.join(outside)}",
                      "a token_file, or tls with clients; or an address of this machine alone, 127.0.0.1:7380")
    if outside:
        context.notes.append(f"socket_bridge: listens to other machines at {', '.join(outside)}")
    if outside and keys.grants == "command":
        context.notes.append(f"socket_bridge: clients at {', '.join(outside)} may command"
                             + (", and power" if keys.may_power else ""))
    tls = keys.tls
    return SocketBridge(
        keys.listen,
        _file(context, source, (*_KEY, "token_file"), keys.token_file),
        _file(context, source, (*_KEY, "tls"), tls.certificate) if tls else "",
        _file(context, source, (*_KEY, "tls"), tls.key) if tls else "",
        _file(context, source, (*_KEY, "tls"), tls.clients) if tls else "",
        keys.grants, keys.may_power, keys.max_clients)


def load_foxglove(context: Context, source: SourceFile, keys: FoxgloveKeys | None) -> FoxgloveServer | None:
    """None without one. Its clients cannot show a token, and only look; elsewhere at least nobody else listens."""
    if keys is None:
        return None
    tls = keys.tls
    if not is_loopback(keys.listen):
        if tls is None:
            context.error(source, (*_FOXGLOVE, "listen"), f"the network could read along at {keys.listen}",
                          "tls with certificate and key; or an address of this machine alone, 127.0.0.1:8765")
        context.notes.append(f"foxglove: whoever comes to {keys.listen} may look")
    return FoxgloveServer(
        keys.listen, keys.rate_hz,
        _file(context, source, (*_FOXGLOVE, "tls"), tls.certificate) if tls else "",
        _file(context, source, (*_FOXGLOVE, "tls"), tls.key) if tls else "")


def _file(context: Context, source: SourceFile, key: tuple[str, ...], name: str) -> str:
    """The path of a file on the search path; empty without a name."""
    found = context.find(source, key, (name,)) if name else None
    return str(found.absolute()) if found is not None else ""
