"""Who may ask for the page, and what browsers may do with what they get."""

from __future__ import annotations

import re
import secrets
from ipaddress import ip_address

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_COOKIE = "roller_view"
#: Everything is from here; what a result says never becomes code.
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
#: A result's own pages may draw, and reach nothing.
FILE_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'"
)
#: What a browser asks for: a name or an address, and perhaps a port.
_HOST = re.compile(r"(?:\[([^\[\]@]+)\]|([^:\[\]@]+))(?::\d{1,5})?")


class Access:
    """Lets in who has the token; where there is none, who asked for this machine by name.

    Parameters
    ----------
    host : str
        Address that is listened at.

    Attributes
    ----------
    token : str
        What others than this machine must have; empty where only this machine reaches the page.
    """

    def __init__(self, host: str) -> None:
        self.token = "" if _is_loopback(host) else secrets.token_urlsafe(16)
        self._hosts = {"localhost", "127.0.0.1", "::1", host}

    def guarded(self, app: ASGIApp) -> ASGIApp:
        """Refuse strangers, and have browsers run nothing but our own page."""

        async def guarded(scope: Scope, receive: Receive, send: Send) -> None:
            async def send_with_headers(message: Message) -> None:
                if message["type"] == "http.response.start":
                    headers = MutableHeaders(scope=message)
                    headers.setdefault("Content-Security-Policy", _PAGE_POLICY)
                    headers.setdefault("Cache-Control", "no-store")
                    headers["X-Content-Type-Options"] = "nosniff"
                    headers["Referrer-Policy"] = "no-referrer"
                await send(message)

            refusal = self._refusal(Request(scope)) if scope["type"] == "http" else None
            await (refusal or app)(scope, receive, send_with_headers)

        return guarded

    def remember_token(self) -> Response:
        """An answer that has the browser keep the token, away from the address it shows."""
        response = RedirectResponse("/", 303)
        response.set_cookie(_COOKIE, self.token, httponly=True, samesite="strict")
        return response

    def _refusal(self, request: Request) -> Response | None:
        if self.token:
            given = request.query_params.get("token") or request.cookies.get(_COOKIE, "")
            if not secrets.compare_digest(given.encode(), self.token.encode()):
                return PlainTextResponse("open the address that `roller view` printed", 401)
        elif _asked_host(request) not in self._hosts:
            # A page of elsewhere that had its own name point here.
            return PlainTextResponse("this address isn't served", 421)
        return None


def _asked_host(request: Request) -> str:
    """Name or address that was asked for; empty if it is neither."""
    # `request.url` puts the server's own address in place of what it can't read.
    found = _HOST.fullmatch(request.headers.get("host", ""))
    return (found[1] or found[2]).lower() if found else ""


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False
