"""MuJoCo's viewer for browsers, only on this machine and with the printed address."""

from __future__ import annotations

import logging
import secrets
import socket
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

import mujoco
from mujoco.studio import launch_web, messages, plugin, viewer_protocol, web_viewer
from mujoco.studio.dear_imgui import dear_imgui
from mujoco.studio.web import web_server

from butterfly.errors import InputError
from butterfly.plant.watch.picture import caption_text

LOOPBACK = "127.0.0.1"
"""The only address served."""

_NAMES = (LOOPBACK, "localhost")
_TOKEN = "token"  # noqa: S105 - its name, in the address
_COOKIE = "butterfly-viewer"


def serve(
    model: mujoco.MjModel, data: mujoco.MjData, advance: Callable[[], None], port: int = 0
) -> None:
    """Show a simulation in a browser until stopped; ``advance`` steps it by a frame."""
    config = viewer_protocol.ViewerConfig(title="butterfly", gfx="web", http_port=port)
    with _guarded(_bound(port)), launch_web.launch(config, plugins=[Front()]) as handle:
        handle.sync(model, data)
        while handle.is_running():
            advance()
            handle.sync()


@dataclass(frozen=True)
class Guard:
    """Access control of a port: only with its address, and only from this machine.

    The address contains a secret token. Other pages in the same browser, and other names of this
    machine, are refused: the first send another `Origin`, the second another `Host` (RFC 6455,
    10.2; "DNS rebinding").
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(16))

    @property
    def url(self) -> str:
        """The address to open."""
        return f"http://{LOOPBACK}:{self.port}/?{_TOKEN}={self.token}"

    @property
    def cookie(self) -> str:
        """The cookie that a browser sends after opening the address."""
        return f"{self._name}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    @property
    def _name(self) -> str:
        """Name of the cookie: browsers share cookies between ports."""
        return f"{_COOKIE}-{self.port}"

    def refusal(self, path: str, headers: Mapping[str, str]) -> str | None:
        """Return why a request for a path, with its query, is refused; None if it is not."""
        hosts = {f"{name}:{self.port}" for name in _NAMES}
        if headers.get("Host") not in hosts:
            return "requested under another host name"
        if headers.get("Origin", f"http://{LOOPBACK}:{self.port}") not in {
            f"http://{name}" for name in hosts
        }:
            return "requested by another page"
        if not self.knows(path) and not self._is_own(headers.get("Cookie", "")):
            return "the token of the printed address is missing"
        return None

    def knows(self, path: str) -> bool:
        """Whether an address has the token."""
        token = parse_qs(path.partition("?")[2]).get(_TOKEN, [""])[0]
        return secrets.compare_digest(token.encode(), self.token.encode())

    def _is_own(self, cookies: str) -> bool:
        try:
            cookie = SimpleCookie(cookies).get(self._name)
        except CookieError:
            return False
        sent = "" if cookie is None else cookie.value
        return secrets.compare_digest(sent.encode(), self.token.encode())


class _Viewer(web_viewer.WebViewer):  # type: ignore[misc] # MuJoCo's, without types
    """MuJoCo's viewer, without its messages."""

    @messages.handler(priority=messages.Priority.INTERNAL)  # type: ignore[untyped-decorator]
    def _on_post_model(self, event: messages.PostModelEvent) -> None:  # noqa: ARG002 - MuJoCo's
        self._update_model()


class Front(plugin.ViewerPlugin):  # type: ignore[misc] # MuJoCo's, without types
    """Views the joint from the front, and shows time and angle."""

    @messages.handler(priority=messages.Priority.INTERNAL)  # type: ignore[untyped-decorator]
    def look(self, event: messages.PostModelEvent) -> None:
        """Use the camera of the model."""
        mujoco.mjv_defaultFreeCamera(event.model, self.viewer.camera)

    @messages.handler(priority=messages.Priority.INTERNAL)  # type: ignore[untyped-decorator]
    def tell(self, event: messages.BuildGuiEvent) -> None:  # noqa: ARG002 - MuJoCo's
        """Show time and angle in their own window."""
        data = self.viewer.data
        if data.qpos.size:
            dear_imgui.Begin("Hand", None, int(dear_imgui.WindowFlags.AlwaysAutoResize))
            dear_imgui.Text(caption_text(data.time, data.joint("hinge").qpos[0], "angle"))
            dear_imgui.End()


def _bound(port: int) -> socket.socket:
    """Return a socket bound to loopback."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform != "win32":  # where it would let another program take the port
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((LOOPBACK, port))
    except OSError as error:
        bound.close()
        problem, expected = f"{port} ({error.strerror})", "a free port, or 0 to choose one"
        raise InputError("butterfly show", "--port", problem, expected) from None
    return bound


@contextmanager
def _guarded(bound: socket.socket) -> Iterator[None]:
    """Make MuJoCo 4 serve at a socket, not at all interfaces, with access control."""
    guard = Guard(bound.getsockname()[1])
    serve_all = web_server.serve

    def bind(host: str, port: int = 0) -> socket.socket:  # noqa: ARG001 - in MuJoCo's place
        return bound

    def announce(host: str, port: int) -> None:  # noqa: ARG001 - in MuJoCo's place
        sys.stdout.write(f"Viewer: {guard.url} (Ctrl-C to stop)\n")
        sys.stdout.flush()

    def serve_known(handler: Any, *, process_request: Any, **others: Any) -> Any:  # noqa: ANN401 - websockets'
        def process(connection: Any, request: Any) -> Any:  # noqa: ANN401
            refused = guard.refusal(request.path, request.headers)
            if refused is not None:
                return connection.respond(403, f"{refused}\n")
            response = process_request(connection, request)
            if response is not None and guard.knows(request.path):
                response.headers["Set-Cookie"] = guard.cookie
            return response

        return serve_all(handler, process_request=process, **others)

    replacements = (
        (web_server, "bind_public_socket", bind),
        (web_server, "serve", serve_known),
        (web_viewer, "_print_url_banner", announce),
        (web_viewer, "WebViewer", _Viewer),
    )
    originals = [(module, name, getattr(module, name)) for module, name, _ in replacements]
    for module, name, replacement in replacements:
        setattr(module, name, replacement)
    log = logging.getLogger("WebServer")  # of who comes and goes
    level = log.level
    log.setLevel(logging.WARNING)
    try:
        yield
    finally:
        log.setLevel(level)
        for module, name, original in originals:
            setattr(module, name, original)
        bound.close()
