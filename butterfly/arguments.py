"""What several commands take: arguments, options, and values as NAME=VALUE by commas."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from butterfly.errors import InputError, nearest
from butterfly.model.parameters import LumpedParameters

ExperimentArgument = Annotated[
    Path, typer.Argument(help="An experiment file (YAML), or a shipped one's name.")
]
DataArgument = Annotated[
    Path, typer.Argument(help="A data set: its manifest, folder or shipped name.")
]
RootOption = Annotated[
    Path | None,
    typer.Option(help="Folder of the logs, if not the one the manifest names.", show_default=False),
]
ReportOption = Annotated[
    Path | None, typer.Option(help="Write an HTML report to this file.", show_default=False)
]


def parse_pairs(text: str, option: str) -> dict[str, str]:
    """Split NAME=VALUE pairs.

    Raises
    ------
    InputError
        Naming ``option``, if a pair has no ``=``.
    """
    pairs = [item.partition("=") for item in text.split(",")]
    if not all(separator for _, separator, _ in pairs):
        raise InputError(option, "value", text, "NAME=VALUE, separated by commas")
    return {name.strip(): value.strip() for name, _, value in pairs}


def parse_terms(text: str | None) -> tuple[str, ...] | None:
    """Split names separated by commas; None stays None, and an empty text gives none."""
    return None if text is None else tuple(filter(None, text.replace(" ", "").split(",")))


def parse_parameters(text: str, option: str) -> LumpedParameters:
    """Read ``p1=…,p2=…,p3=…[,p4=…][,coulomb=…][,delay=…]``; p4 is NaN if it is not given.

    Raises
    ------
    InputError
        Naming ``option`` and the part that is wrong.
    """
    known = LumpedParameters.__dataclass_fields__
    values = {"p4": float("nan")}
    for name, value in parse_pairs(text, option).items():
        if name not in known:
            raise InputError(option, name, "an unknown parameter", nearest(name, known))
        try:
            values[name] = float(value)
        except ValueError:
            raise InputError(option, name, value, "a number") from None
    missing = {"p1", "p2", "p3"} - values.keys()
    if missing:
        raise InputError(option, min(missing), "nothing", "a value")
    return LumpedParameters(**values)
