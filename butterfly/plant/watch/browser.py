"""MuJoCo's viewer for browsers, kept to this machine."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mujoco.studio import launch_web, viewer_protocol, web_viewer
from mujoco.studio.web import web_server

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import mujoco

LOOPBACK = "127.0.0.1"
"""The only address at which the viewer is served: it asks nobody who they are."""


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
    """
    config = viewer_protocol.ViewerConfig(title="butterfly", gfx="web", http_port=port)
    with _loopback_only(), launch_web.launch(config) as handle:
        handle.sync(model, data)
        while handle.is_running():
            advance()
            handle.sync()


@contextmanager
def _loopback_only() -> Iterator[None]:
    """Bind the browser's viewer to loopback; MuJoCo 4 itself binds every interface."""
    modules: list[tuple[Any, str]] = [
        (web_server, "bind_public_socket"),
        (web_viewer, "_print_url_banner"),
    ]
    originals = [getattr(module, name) for module, name in modules]

    def bind(_: str, port: int = 0) -> object:
        return originals[0](LOOPBACK, port)

    def announce(_: str, port: int) -> None:
        sys.stdout.write(f"Viewer: http://{LOOPBACK}:{port}/ (Ctrl-C to stop)\n")
        sys.stdout.flush()

    for (module, name), replacement in zip(modules, (bind, announce), strict=True):
        setattr(module, name, replacement)
    try:
        yield
    finally:
        for (module, name), original in zip(modules, originals, strict=True):
            setattr(module, name, original)
