"""Access control of the studio's server, as middleware around the application.

Every request needs the token, in a cookie that the printed link sets. The Host header must name the server's
own address, which stops names that were rebound to it; the Origin header, where there is one, must be the
page's own, which stops pages of other sites. Only GET and HEAD are served, without a body.
"""

from __future__ import annotations

import hmac
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from typing import Final
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_MESSAGE: Final = 4_000_000
"""Largest message of a client, bytes."""
MAX_QUERY: Final = 4_000
"""Longest query of an address, bytes."""

NO_TOKEN: Final = "This page needs the link that `picktree studio` printed: open that one.\n"

_OWN: Final = frozenset({"same-origin", "none"})


def page_policy(host: str) -> str:
    """Return the content security policy of the page: its own scripts and pictures, and its own socket."""
    return (
        "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data: blob:; media-src 'self'; connect-src 'self' ws://{host}; worker-src 'self'; "
        "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


SANDBOXED: Final = "sandbox allow-scripts; frame-ancestors 'self'"
"""Policy of pages that were made from runs: they have an origin of their own, and reach nothing of ours."""


class Guard:
    """Middleware that refuses requests without the token, of foreign names, and of foreign pages."""

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app = app
        self._token = token
        self._cookie = f"picktree_studio_{port}"  # cookies are shared by all ports of a host
        self._hosts = frozenset(f"{name}:{port}" for name in ("127.0.0.1", "localhost"))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        socket = scope["type"] == "websocket"
        refusal = self._refusal(scope, headers, socket=socket)
        if refusal is None:
            await self._app(scope, receive, _with_headers(send, headers["host"]))
        elif socket:
            await send({"type": "websocket.close", "code": 1008, "reason": "refused"})
        else:
            await refusal(scope, receive, _with_headers(send, "127.0.0.1"))

    def _refusal(self, scope: Scope, headers: Headers, *, socket: bool) -> Response | None:
        """Return the answer to a request that is refused; None: it is let through."""
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return PlainTextResponse("The studio answers to its own address only.\n", 421)
        if any(origin != f"http://{hosts[0]}" for origin in origins) or (socket and len(origins) != 1):
            return PlainTextResponse("The studio answers its own page only.\n", 403)
        if not socket and scope["method"] not in ("GET", "HEAD"):
            return PlainTextResponse("Only GET and HEAD.\n", 405)
        if headers.get("content-length", "0") != "0" or "transfer-encoding" in headers:
            return PlainTextResponse("A request has no body here.\n", 413)
        if len(scope["query_string"]) > MAX_QUERY:
            return PlainTextResponse("The address is too long.\n", 414)
        tokens = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        if tokens and not socket and scope["path"] == "/":
            return self._entered(tokens)
        foreign = headers.get("sec-fetch-site", "none") not in _OWN
        if foreign and headers.get("sec-fetch-dest") != "document":
            return PlainTextResponse("The studio answers its own page only.\n", 403)
        return None if self._is_known(headers.getlist("cookie")) else PlainTextResponse(NO_TOKEN, 403)

    def _entered(self, tokens: Iterable[str]) -> Response:
        if not all(self._is_token(token) for token in tokens):
            return PlainTextResponse(NO_TOKEN, 403)
        response = RedirectResponse("/", 303)
        response.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", path="/")
        return response

    def _is_known(self, cookies: Iterable[str]) -> bool:
        for text in cookies:
            try:
                found = SimpleCookie(text).get(self._cookie)
            except CookieError:
                continue
            if found is not None and self._is_token(found.value):
                return True
        return False

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), self._token.encode())


def _with_headers(send: Send, host: str) -> Send:
    """Return `send` with the headers of every answer. A response may have a policy of its own."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.setdefault("content-security-policy", page_policy(host))
            headers["x-content-type-options"] = "nosniff"
            headers["referrer-policy"] = "no-referrer"
            headers["cross-origin-opener-policy"] = "same-origin"
            headers["cross-origin-resource-policy"] = "same-origin"
            headers["cache-control"] = "no-cache"
        await send(message)

    return sending
