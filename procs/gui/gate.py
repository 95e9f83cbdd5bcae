"""Access control: every request and every connection of a browser passes here first.

A browser on this machine, run by the system's user, needs no credentials; all others need the token (or a certificate).
Pages of other sites cannot misuse a browser's access: foreign host names, foreign origins, and requests from foreign
pages without an origin are refused; a link from elsewhere may open a page.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import hmac
import logging
from collections.abc import Callable, Iterable
from http.cookies import CookieError, SimpleCookie
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from trocar.procs.machine.access import is_ours

COOKIE: Final = "trocar"
GUESS_S: Final = 1.0
"""Delay after a wrong token; meanwhile further tries from that address are refused."""
GUESSING: Final = 32
"""Addresses delayed at a time; wrong tokens from further ones are refused at once: no valid user is locked out."""
MAX_FORM: Final = 4096
FILES: Final = "/files/"
"""Below this path are files that are expensive to make: links from elsewhere do not reach them."""
FORM_STYLE: Final = ("body{font:16px sans-serif;max-width:26rem;margin:20vh auto;padding:0 1rem}p{color:#a00}"
                     "input,button{font:inherit;padding:.5rem;width:100%;box-sizing:border-box;margin:.4rem 0}")
FORM: Final = f"""<!doctype html><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Trocar</title><style>{FORM_STYLE}</style><h1>Trocar</h1><form method="post" action="/token">
<label>Token of this system
<input name="token" type="password" autofocus autocomplete="off"></label><button>Enter</button></form><p>WHY</p>"""
HEADERS: Final = (
    # Only this server's own files are ever fetched, whatever a library requests: labs are offline. No text in a page is
    # ever run as a script.
    (b"content-security-policy", b"default-src 'none'; script-src 'self'; connect-src 'self'; img-src 'self' data:; "
                                 b"style-src 'self' 'sha256-%b'; frame-ancestors 'none'; form-action 'self'; "
                                 b"base-uri 'none'" % base64.b64encode(hashlib.sha256(FORM_STYLE.encode()).digest())),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
)


class Gate:
    """In front of all pages."""

    def __init__(self, app: ASGIApp, token: bytes, has_certificates: bool, log: logging.Logger,
                 is_ours: Callable[[tuple[str, int], int], bool] = is_ours) -> None:
        """`has_certificates`: clients have shown a certificate."""
        self._app, self._token, self._log = app, token, log
        self._has_certificates, self._is_ours = has_certificates, is_ours
        self._guessing: set[str] = set()
        self._cookie = hmac.new(token, b"trocar gui", hashlib.sha256).hexdigest() if token else ""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request, or one connection."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        is_here = self._is_here(scope)
        if is_here and self._token and not _is_loopback(_name(headers)):
            is_here = False  # may be our own name, or another's that resolves to us: the token decides
        why = refusal(headers, scope, is_here)
        if why:
            self._log.warning("%s: refused: %s", scope["client"], why)
            await _answer(scope, send, 403, why)
        elif is_here or self._has_certificates or self._has_cookie(headers):
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "http":
            await self._ask(scope, receive, send)
        else:
            await _answer(scope, send, 401, "the token is missing")

    def _is_here(self, scope: Scope) -> bool:
        client, server = scope.get("client"), scope.get("server")
        if not client or not server or server[1] is None:
            return False
        address = _address(client[0])
        return address.is_loopback and self._is_ours((str(address), client[1]), server[1])

    def _has_cookie(self, headers: dict[str, str]) -> bool:
        try:
            shown = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        return bool(self._cookie) and shown is not None and hmac.compare_digest(shown.value.encode(),
                                                                                self._cookie.encode())

    async def _ask(self, scope: Scope, receive: Receive, send: Send) -> None:
        """For the token: of the link that `trocar up` prints, or of the form."""
        if not self._token:
            await _answer(scope, send, 403, "programs of other users need a token (trocar.gui.token_file)")
            return
        form = await _body(receive) if scope["method"] == "POST" else scope["query_string"]
        given = parse_qs(form.decode("latin-1")).get("token", [""])[0]
        who = _network(scope)
        if given and who in self._guessing:
            await self._refuse_for_now(scope, send)
            return
        if given and hmac.compare_digest(given.encode("latin-1", "replace"), self._token):
            secure = "; Secure" if scope.get("scheme") == "https" else ""
            cookie = f"{COOKIE}={self._cookie}; HttpOnly; SameSite=Strict; Path=/{secure}"
            to = "/" if scope["path"] == "/token" else scope["path"]
            # A page instead of a redirection: such cookies are not sent if a link from elsewhere led here.
            text = f'<!doctype html><meta http-equiv="refresh" content="0;url={_path(to)}">'
            await _answer(scope, send, 200, text, [(b"set-cookie", cookie.encode())], b"text/html")
            return
        if given and len(self._guessing) >= GUESSING:
            await self._refuse_for_now(scope, send)
            return
        if given:
            self._log.warning("%s: a wrong token", scope["client"])
            self._guessing.add(who)
            try:
                await asyncio.sleep(GUESS_S)
            finally:
                self._guessing.discard(who)
        await _answer(scope, send, 401, FORM.replace("WHY", "This token is wrong." if given else ""), (), b"text/html")


    async def _refuse_for_now(self, scope: Scope, send: Send) -> None:
        await _answer(scope, send, 429, FORM.replace("WHY", "One try at a time: wait a second."), (), b"text/html")


def refusal(headers: dict[str, str], scope: Scope, is_here: bool) -> str:
    """Why a request is not meant for us, or not from our own page; empty: it is acceptable."""
    host, origin = headers.get("host", ""), headers.get("origin")
    name = _name(headers)
    if is_here and not _is_loopback(name):  # a foreign name that resolves to us would make its page count as ours
        return f"{name[:80]} is no name of this machine; take 127.0.0.1 or localhost"
    if origin is not None and origin.partition("://")[2] != host:
        return "that page is not from here"
    if headers.get("sec-fetch-site") in ("cross-site", "same-site") and not _opens_page(headers, scope):
        return "that page is not from here"  # pictures and scripts of other sites: browsers send no origin with those
    if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD") and origin is None:
        return "that is from no page"
    return ""


def _opens_page(headers: dict[str, str], scope: Scope) -> bool:
    """Whether a person opens a page of ours in a tab: by a link from elsewhere, for one."""
    is_document = headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
    return (is_document and scope["type"] == "http" and scope["method"] == "GET"
            and not str(scope["path"]).startswith(FILES))


def _name(headers: dict[str, str]) -> str:
    """The host name that the browser requested."""
    try:
        return urlsplit(f"//{headers.get('host', '')}").hostname or ""
    except ValueError:  # [ without ]
        return ""


def _address(text: str) -> IPv4Address | IPv6Address:
    """Of a client; the old kind as such where we listen for both."""
    found = ip_address(text)
    return (found.ipv4_mapped if isinstance(found, IPv6Address) else None) or found


def _network(scope: Scope) -> str:
    """Client identity: an IPv4 address, or the IPv6 network of one household."""
    client = _address(scope["client"][0])
    return str(client) if client.version == 4 else str(client.exploded[:19])


def _is_loopback(name: str) -> bool:
    try:
        return name == "localhost" or ip_address(name).is_loopback
    except ValueError:
        return False


def _path(path: str) -> str:
    """A path that is safe in a page."""
    return path if path.replace("/", "").replace("-", "").replace("_", "").isalnum() else "/"


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
        await send(message)

    return sent


async def _body(receive: Receive) -> bytes:
    found = b""
    while len(found) <= MAX_FORM:
        message = await receive()
        found += bytes(message.get("body", b""))
        if not message.get("more_body"):
            return found
    return b""


async def _answer(scope: Scope, send: Send, status: int, text: str, headers: Iterable[tuple[bytes, bytes]] = (),
                  kind: bytes = b"text/plain") -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008, "reason": text[:100]})
        return
    start: dict[str, Any] = {"type": "http.response.start", "status": status, "headers": [
        (b"content-type", kind + b"; charset=utf-8"), (b"cache-control", b"no-store"), *HEADERS, *headers]}
    await send(start)
    await send({"type": "http.response.body", "body": text.encode()})
