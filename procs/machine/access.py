"""Access control for servers: tokens, certificates, and programs of our user on this machine."""

from __future__ import annotations

import os
import ssl
import stat
from pathlib import Path
from typing import Final, Protocol

from trocar.procs.machine.port_holders import client_user

SHORTEST: Final = 16


class AccessError(Exception):
    """A token or certificate cannot be used; the message has its file and the reason."""


def token_in(path: str) -> bytes:
    """The token in a file, empty without a path; AccessError if other users could read the file."""
    if not path:
        return b""
    try:
        with Path(path).open("rb") as file:
            status, token = os.fstat(file.fileno()), file.read(4096).strip()
    except OSError as error:
        raise AccessError(f"{path}: {error.strerror}") from None
    if stat.S_IMODE(status.st_mode) & 0o077 or status.st_uid not in (os.getuid(), 0):
        raise AccessError(f"{path}: other users may read it; chmod 600 {path}")
    if len(token) < SHORTEST:
        raise AccessError(f"{path}: a token has {SHORTEST} characters at least: openssl rand -hex 16 > {path}")
    return token


class TlsFiles(Protocol):
    """PEM files of a server: its certificate and key, and the authorities for clients' certificates."""

    @property
    def certificate(self) -> str: ...
    @property
    def key(self) -> str: ...
    @property
    def authorities(self) -> str: ...


def tls_of(bridge: TlsFiles) -> ssl.SSLContext | None:
    """The TLS context of a server, None without a certificate; AccessError if a file is not usable."""
    if not bridge.certificate:
        return None
    try:
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=bridge.authorities or None)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        if bridge.authorities:
            context.verify_mode = ssl.CERT_REQUIRED
        context.load_cert_chain(bridge.certificate, bridge.key)
    except (OSError, ValueError) as error:
        raise AccessError(f"{bridge.certificate}, {bridge.key}: {error}") from None
    return context


def is_ours(peer: tuple[str, int], local_port: int) -> bool:
    """Whether the client of a connection on this machine is a program of our user, or of root."""
    return client_user(*peer, local_port) in (os.getuid(), 0)
