"""Access control of the server: the Host header, the origin of writes, the token, and the content security policy.

A page of another site cannot read answers of this server (no CORS header is ever sent). It could still send writes, or
read as the same site by a name that resolves to this address (DNS rebinding): Origin and Host are checked for that.
"""

from __future__ import annotations

import ipaddress
import json
import os
import secrets
import socket
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "lacet"
"""Beginning of the cookie's name; the port follows, as browsers send a host's cookies to all its ports."""
POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self'; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'"
)
"""Content security policy of the page: nothing from elsewhere. Styles set by script through the style object are
allowed."""
FIXED = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


def new_token() -> str:
    """A random token."""
    return secrets.token_urlsafe(24)


def user_token() -> str:
    """This user's token on this machine, kept in a file only they can read: a page that is open outlives a restart.

    Where it cannot be kept, a new one.
    """
    file = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "lacet" / "ui-token"
    try:
        if file.is_file() and not file.stat().st_mode & 0o077 and len(found := file.read_text(encoding="ascii")) >= 32:
            return found
        file.parent.mkdir(parents=True, exist_ok=True)
        file.unlink(missing_ok=True)
        found = new_token()
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as out:
            out.write(found)
        return found
    except (OSError, ValueError):
        return new_token()


def cookie_name(host: str) -> str:
    """Name of the cookie of a server under a Host header, by its port."""
    try:
        port = urlsplit(f"//{host}").port
    except ValueError:
        port = None
    return f"{COOKIE}-{port or 80}"


class Guard:
    """Middleware that admits or refuses requests.

    `hosts` are names of the server; with a `token` numerical addresses too, which no other site can make resolve here.
    `token` is required once as ``?token=…``, and afterwards as the cookie then set.
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str] = (), token: str | None = None):
        self.app, self.token = app, token
        self.hosts = {name.lower() for name in (*_LOOPBACK, *hosts)}
        if token:
            self.hosts.add(socket.gethostname().lower())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with a refusal."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        if why := self._refused(scope, headers):
            await _answer(send, 403, {"error": why})
            return
        if self.token and not self._known(headers):
            given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
            if not secrets.compare_digest(given.encode(), self.token.encode()):
                says = "open the address that lacet ui printed, with its token"
                await _answer(send, 401, {"error": f"this page needs a token: {says}"})
                return
            name = cookie_name(headers.get("host", ""))
            cookie = f"{name}={self.token}; HttpOnly; SameSite=Strict; Path=/"
            await _answer(send, 303, {}, {"Location": scope["path"] or "/", "Set-Cookie": cookie})
            return

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                out = MutableHeaders(scope=message)
                for name, value in FIXED.items():
                    out.setdefault(name, value)
                out.setdefault("Content-Security-Policy", POLICY)
                out.setdefault("Cache-Control", "no-store" if scope["path"].startswith("/api/") else "no-cache")
            await send(message)

        await self.app(scope, receive, sent)

    def _refused(self, scope: Scope, headers: Headers) -> str:
        host = _host(headers.get("host", ""))
        if host not in self.hosts and not (self.token and _is_address(host)):
            return f"this server is not '{host}': open it under the address that lacet ui printed"
        if scope["method"] not in ("GET", "HEAD"):
            origin = headers.get("origin")
            if origin is not None and urlsplit(origin).netloc.lower() != headers.get("host", "").lower():
                return "a page of another site may not write here"
            if origin is None and headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
                return "a page of another site may not write here"
        return ""

    def _known(self, headers: Headers) -> bool:
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(cookie_name(headers.get("host", "")))
        except CookieError:
            return False
        return found is not None and secrets.compare_digest(found.value.encode(), (self.token or "").encode())


def _host(text: str) -> str:
    """The host of a Host header, without its port."""
    try:
        return (urlsplit(f"//{text}").hostname or "").lower()
    except ValueError:
        return ""


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


async def _answer(send: Send, status: int, body: dict[str, str], extra: dict[str, str] | None = None) -> None:
    text = json.dumps(body).encode()
    pairs = {"Content-Type": "application/json", "Content-Length": str(len(text)), **FIXED, **(extra or {})}
    headers = [(k.lower().encode(), v.encode("latin-1")) for k, v in pairs.items()]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": text})
