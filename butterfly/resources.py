"""Find the shipped models and experiments, in a checkout and in an installed wheel alike."""

from __future__ import annotations

from pathlib import Path

from butterfly.errors import InputError

_PACKAGE = Path(__file__).parent
_ROOTS = (_PACKAGE / "_shipped", _PACKAGE.parent)


def shipped(relative: str | Path) -> Path:
    """Return the path of a shipped file such as ``models/butterfly_hand/hand.xml``.

    Raises
    ------
    InputError
        If this installation ships no such file.
    """
    for root in _ROOTS:
        candidate = root / relative
        if candidate.exists():
            return candidate
    raise InputError(
        relative, "path", "no such shipped file", "a file under models/ or experiments/"
    )


def shipped_experiments() -> list[str]:
    """List the shipped experiment and data-set files, as ``experiments/.../NAME.yaml``."""
    root = shipped("experiments")
    return sorted(
        f"experiments/{path.relative_to(root).as_posix()}" for path in root.rglob("*.yaml")
    )


def locate(path: Path) -> Path:
    """Resolve what a user typed: a path as given, else a shipped file of that name.

    ``experiments/quickstart.yaml`` and plain ``quickstart`` both find the shipped file from any
    working directory; a file of the user's own always comes first.

    Raises
    ------
    InputError
        If neither exists; the message lists what is shipped.
    """
    if path.exists():
        return path
    for name in shipped_experiments():
        if str(path) in {name, Path(name).name, Path(name).stem}:
            return shipped(name)
    raise InputError(
        path,
        "path",
        "no such file or folder",
        f"an existing path, or one of {', '.join(shipped_experiments())}",
    )
