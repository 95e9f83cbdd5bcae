"""Who may come in: tokens, names, origins, and programs of other users."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any

import pytest

from tests.cases import cases
from trocar.procs.gui import gate
from trocar.procs.gui.gate import Gate

TOKEN = b"0123456789abcdef"
HERE = {"host": "127.0.0.1:8080"}


class Response:
    """What became of a request."""

    def __init__(self) -> None:
        self.status, self.reason, self.body, self.headers = 0, "", b"", {}

    async def send(self, message: dict[str, Any]) -> None:
        self.status = message.get("status", 403 if message["type"] == "websocket.close" else self.status)
        self.reason = message.get("reason", self.reason)
        self.body += message.get("body", b"")
        self.headers |= {name.decode(): value.decode() for name, value in message.get("headers", ())}


async def pages(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"a page"})


def ask(headers: dict[str, str], *, token: bytes = b"", ours: bool = True, client: str = "127.0.0.1",
        kind: str = "http", method: str = "GET", path: str = "/", query: str = "", body: bytes = b"",
        is_ours: Callable[[tuple[str, int], int], bool] | None = None) -> Response:
    scope = {"type": kind, "method": method, "path": path, "query_string": query.encode(), "scheme": "http",
             "client": (client, 4000), "server": (client, 8080),
             "headers": [(name.encode(), value.encode()) for name, value in headers.items()]}

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body}

    asked = Response()
    made = Gate(pages, token, False, logging.getLogger("gate"), is_ours or (lambda peer, port: ours))
    asyncio.run(made(scope, receive, asked.send))
    return asked


def test_our_own_programs_on_this_machine_need_nothing() -> None:
    assert ask(HERE).body == b"a page"
    assert ask({"host": "localhost:8080"}).status == ask({"host": "[::1]:8080"}).status == 200


def test_where_both_kinds_of_addresses_may_come_this_machine_is_known_by_both() -> None:
    asked_for = []

    def is_ours(peer: tuple[str, int], port: int) -> bool:
        asked_for.append(peer)
        return True

    assert ask(HERE, client="::ffff:127.0.0.1", is_ours=is_ours).body == b"a page"
    assert asked_for == [("127.0.0.1", 4000)], "as the kernel lists it"
    assert ask(HERE, client="::ffff:10.0.0.7").status == 403


def test_our_own_name_needs_the_token_where_it_leads_to_this_machine_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate, "GUESS_S", 0.0)
    name = {"host": "robot.lab:8080"}  # Debian: 127.0.1.1 in /etc/hosts
    asked = ask(name, token=TOKEN, client="127.0.1.1")
    assert asked.status == 401 and b"<form" in asked.body
    link = ask(name, token=TOKEN, client="127.0.1.1", query=f"token={TOKEN.decode()}")
    cookie = link.headers["set-cookie"].split(";")[0]
    assert ask({**name, "cookie": cookie}, token=TOKEN, client="127.0.1.1").body == b"a page"
    assert "token is missing" in ask(name, token=TOKEN, client="127.0.1.1", kind="websocket").reason
    assert ask({**name, "cookie": cookie, "origin": "https://evil.example"}, token=TOKEN).status == 403
    assert ask(HERE, token=TOKEN).body == b"a page", "by its address it needs none, as before"


def test_a_name_that_cannot_be_read_is_refused() -> None:
    assert ask({"host": "[::1"}).status == 403


@cases(("headers", "words"), [
    ({"host": "evil.example:8080"}, "no name of this machine"),
    ({"host": "127.0.0.1.evil.example"}, "no name of this machine"), ({}, "no name of this machine"),
    ({**HERE, "origin": "https://evil.example"}, "not from here"),
    ({**HERE, "origin": "http://127.0.0.1:9"}, "not from here"), ({**HERE, "origin": "null"}, "not from here"),
    ({**HERE, "origin": "http://[::1"}, "not from here"),
    ({**HERE, "origin": "http://127.0.0.1:8080@evil.example"}, "not from here")])
@cases("kind", ["http", "websocket"])
def test_pages_of_others_cannot_come_through_our_browser(headers: dict[str, str], words: str, kind: str) -> None:
    asked = ask(headers, kind=kind)
    assert asked.status == 403 and words in asked.reason + asked.body.decode()


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_pages_of_others_fetch_nothing_but_a_link_opens_a_page(site: str) -> None:
    def asked(mode: str, dest: str, path: str = "/", **options: Any) -> int:
        headers = {**HERE, "sec-fetch-site": site, "sec-fetch-mode": mode, "sec-fetch-dest": dest}
        return ask(headers, path=path, **options).status

    pid = "/files/pid/IO1/PSM1.json"
    assert asked("no-cors", "image", pid) == asked("no-cors", "script") == asked("navigate", "iframe") == 403
    assert asked("navigate", "document", pid) == 403 and asked("navigate", "document", kind="websocket") == 403
    assert asked("navigate", "document") == asked("navigate", "document", "/arm/PSM1") == 200
    for own in ("same-origin", "none"):
        assert ask({**HERE, "sec-fetch-site": own, "sec-fetch-mode": "navigate"}, path=pid).status == 200
    assert ask(HERE, path=pid).status == 200, "programs say nothing of the kind"


def test_what_changes_something_has_to_come_from_our_page() -> None:
    assert ask(HERE, method="POST").status == 403
    assert ask({**HERE, "origin": "http://127.0.0.1:8080"}, method="POST").status == 200


def test_programs_of_other_users_are_refused_without_a_token() -> None:
    assert ask(HERE, ours=False).status == 403
    assert ask({"host": "10.0.0.1"}, client="10.0.0.7").status == 403


@pytest.mark.parametrize(("ours", "client"), [(False, "127.0.0.1"), (True, "10.0.0.7")])
def test_the_token_opens_the_pages(ours: bool, client: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate, "GUESS_S", 0.0)
    headers = {"host": "robot.lab:8080"}

    def asked(more: dict[str, str] | None = None, **options: Any) -> Response:
        return ask({**headers, **(more or {})}, token=TOKEN, ours=ours, client=client, **options)

    assert asked().status == 401 and b"<form" in asked().body
    wrong = asked(query="token=0123456789abcdeX")
    assert wrong.status == 401 and b"token is wrong" in wrong.body and "set-cookie" not in wrong.headers
    link = asked(query="token=0123456789abcdef")
    form = asked({"origin": "http://robot.lab:8080"}, method="POST", path="/token", body=b"token=0123456789abcdef")
    cookie = link.headers["set-cookie"].split(";")[0]
    assert form.headers["set-cookie"].split(";")[0] == cookie and "0123456789abcdef" not in cookie
    assert asked({"cookie": cookie}).body == b"a page"
    assert asked({"cookie": cookie[:-1] + "x"}).status == 401
    assert asked({"cookie": "trocar="}).status == 401
    assert asked({"cookie": cookie, "origin": "https://evil.example"}).status == 403


def test_who_guesses_has_to_wait_and_is_in_nobody_elses_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate, "GUESS_S", 3600.0)
    made = Gate(pages, TOKEN, False, logging.getLogger("gate"), lambda peer, port: False)

    async def knock(client: str, token: str) -> Response:
        heard, scope = Response(), {
            "type": "http", "method": "GET", "path": "/", "query_string": f"token={token}".encode(), "scheme": "http",
            "client": (client, 4000), "server": ("10.0.0.1", 8080), "headers": [(b"host", b"robot.lab")]}
        await made(scope, lambda: asyncio.sleep(0, {}), heard.send)
        return heard

    async def story() -> None:
        waiting = [asyncio.ensure_future(knock(client, "wrong")) for client in ("10.0.0.7", "fd00::1:0:0:0:1")]
        await asyncio.sleep(0)
        for again in ("10.0.0.7", "::ffff:10.0.0.7", "fd00::1:0:0:0:2"):
            assert (await knock(again, TOKEN.decode())).status == 429, "not even the right one"
        for other in ("10.0.0.8", "::ffff:10.0.0.9"):
            assert "set-cookie" in (await knock(other, TOKEN.decode())).headers
        waiting += [asyncio.ensure_future(knock(f"10.0.1.{i}", "wrong")) for i in range(gate.GUESSING)]
        await asyncio.sleep(0)
        assert (await knock("10.0.0.9", "wrong")).status == 429, "too many at a time"
        assert "set-cookie" in (await knock("10.0.0.9", TOKEN.decode())).headers, "who has it is kept out by nobody"
        assert not any(each.done() for each in waiting[:2])
        for each in waiting:
            each.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
        assert "set-cookie" in (await knock("10.0.0.7", TOKEN.decode())).headers

    asyncio.run(story())


def test_a_connection_needs_the_token_too() -> None:
    assert "token is missing" in ask({"host": "robot.lab"}, token=TOKEN, client="10.0.0.7", kind="websocket").reason


def test_nothing_is_fetched_from_elsewhere_and_no_page_frames_ours() -> None:
    policy = ask(HERE).headers["content-security-policy"]
    assert "default-src 'none'" in policy and "script-src 'self';" in policy and "unsafe" not in policy
    assert "http" not in policy and "frame-ancestors 'none'" in policy
