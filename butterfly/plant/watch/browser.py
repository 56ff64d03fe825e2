"""MuJoCo's viewer for browsers, kept to this machine and to who was given its address."""

from __future__ import annotations

import socket
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mujoco.studio import launch_web, viewer_protocol, web_viewer
from mujoco.studio.web import web_server

from butterfly.errors import InputError
from butterfly.plant.watch.guard import LOOPBACK, Guard

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import mujoco


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
    with _guarded(_bound(port)), launch_web.launch(config) as handle:
        handle.sync(model, data)
        while handle.is_running():
            advance()
            handle.sync()


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
        raise InputError("butterfly view", "--port", found, expected) from None
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
    )
    originals = [(module, name, getattr(module, name)) for module, name, _ in replacements]
    for module, name, replacement in replacements:
        setattr(module, name, replacement)
    try:
        yield
    finally:
        for module, name, original in originals:
            setattr(module, name, original)
        bound.close()
