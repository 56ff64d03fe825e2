"""Who may see and steer what is served to a browser: whoever was given its address, here alone.

Other pages that the same browser shows, and other names that lead to this machine, may not: the
first send an `Origin`, the second a `Host`, that is not the server's own (RFC 6455, 10.2; "DNS
rebinding").
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

LOOPBACK = "127.0.0.1"
"""The only address at which anything is served."""

_NAMES = (LOOPBACK, "localhost")
_TOKEN = "token"  # noqa: S105 - its name, in the address
_COOKIE = "butterfly-viewer"


@dataclass(frozen=True)
class Guard:
    """Admits requests to a server of this machine.

    Parameters
    ----------
    port
        At which it serves.
    token
        What its address says; nobody else knows it.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))

    @property
    def url(self) -> str:
        """The address to open."""
        return f"http://{LOOPBACK}:{self.port}/?{_TOKEN}={self.token}"

    @property
    def cookie(self) -> str:
        """What a browser that was given the address sends from then on."""
        return f"{self._name}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    @property
    def _name(self) -> str:
        """Of the cookie: browsers keep one of a name for all ports."""
        return f"{_COOKIE}-{self.port}"

    def refusal(self, path: str, headers: Mapping[str, str]) -> str | None:
        """Return why a request is not answered; None if it is.

        Parameters
        ----------
        path
            With its query.
        headers
            Of the request, by names of any case.
        """
        own = {f"{name}:{self.port}" for name in _NAMES}
        if headers.get("Host") not in own:
            return "asked for under another name than this machine's own"
        if headers.get("Origin", f"http://{LOOPBACK}:{self.port}") not in {
            f"http://{name}" for name in own
        }:
            return "asked for by another page"
        if not self.knows(path) and not self._is_own(headers.get("Cookie", "")):
            return "the address that the program printed has a token, which is missing here"
        return None

    def knows(self, path: str) -> bool:
        """Whether an address has the token."""
        told = parse_qs(path.partition("?")[2]).get(_TOKEN, [""])[0]
        return secrets.compare_digest(told.encode(), self.token.encode())

    def _is_own(self, cookies: str) -> bool:
        try:
            sent = SimpleCookie(cookies).get(self._name)
        except CookieError:
            return False
        told = "" if sent is None else sent.value
        return secrets.compare_digest(told.encode(), self.token.encode())
