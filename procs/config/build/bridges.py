"""The socket bridge of a system, of `trocar.socket`."""

from __future__ import annotations

from typing import Final

from procs.config.build.context import Context
from procs.config.models.bridge_section import SocketKeys
from procs.config.read.source import SourceFile
from procs.document.bridges import SocketBridge, is_loopback

_KEY: Final = ("trocar", "socket")


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
        _file(context, source, "token_file", keys.token_file),
        _file(context, source, "tls", tls.certificate) if tls else "",
        _file(context, source, "tls", tls.key) if tls else "",
        _file(context, source, "tls", tls.clients) if tls else "",
        keys.grants, keys.may_power, keys.max_clients)


def _file(context: Context, source: SourceFile, key: str, name: str) -> str:
    """The path of a file on the search path; empty without a name."""
    found = context.find(source, (*_KEY, key), (name,)) if name else None
    return str(found.absolute()) if found is not None else ""
