"""MuJoCo's viewer for browsers, kept to this machine and to who was given its address."""

from __future__ import annotations

import logging
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
from mujoco.studio import launch_web, messages, plugin, viewer_protocol, web_viewer
from mujoco.studio.dear_imgui import dear_imgui
from mujoco.studio.web import web_server

from butterfly.errors import InputError
from butterfly.plant.watch.caption import told
from butterfly.plant.watch.guard import LOOPBACK, Guard


def serve(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    advance: Callable[[], None],
    port: int = 0,
) -> None:
    """Show a simulation to a browser until it is stopped.

    Parameters
    ----------
    model, data
        The simulation.
    advance
        Steps them on by a frame.
    port
        To serve at; 0 picks a free one.

    Raises
    ------
    InputError
        If the port is taken.
    """
    config = viewer_protocol.ViewerConfig(title="butterfly", gfx="web", http_port=port)
    with _guarded(_bound(port)), launch_web.launch(config, plugins=[Front()]) as handle:
        handle.sync(model, data)
        while handle.is_running():
            advance()
            handle.sync()


class _Viewer(web_viewer.WebViewer):  # type: ignore[misc] # MuJoCo's, without types
    """MuJoCo's, which says nothing of its own."""

    @messages.handler(priority=messages.Priority.INTERNAL)  # type: ignore[untyped-decorator]
    def _on_post_model(self, event: messages.PostModelEvent) -> None:  # noqa: ARG002 - MuJoCo's
        self._update_model()


class Front(plugin.ViewerPlugin):  # type: ignore[misc] # MuJoCo's, without types
    """Looks at the hand from the front, and tells time and angle."""

    @messages.handler(priority=messages.Priority.INTERNAL)  # type: ignore[untyped-decorator]
    def look(self, event: messages.PostModelEvent) -> None:
        """Put the camera where the model says."""
        mujoco.mjv_defaultFreeCamera(event.model, self.viewer.camera)

    @messages.handler(priority=messages.Priority.INTERNAL)  # type: ignore[untyped-decorator]
    def tell(self, event: messages.BuildGuiEvent) -> None:  # noqa: ARG002 - MuJoCo's
        """Write time and angle into a window of their own."""
        data = self.viewer.data
        if data.qpos.size:
            dear_imgui.Begin("Hand", None, int(dear_imgui.WindowFlags.AlwaysAutoResize))
            dear_imgui.Text(told(data.time, data.qpos[0], "angle"))
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
        found, expected = f"{port} ({error.strerror})", "a free one, or 0 to pick one"
        raise InputError("butterfly show", "--port", found, expected) from None
    return bound


@contextmanager
def _guarded(bound: socket.socket) -> Iterator[None]:
    """Have MuJoCo 4 serve at a socket and ask who comes; it binds all interfaces, and asks nobody.

    Parameters
    ----------
    bound
        Closed in the end.
    """
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
