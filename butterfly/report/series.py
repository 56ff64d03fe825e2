"""Figures of which a page has one for each log, packed so that many take little room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_SEEN = 20_000  # quanta of the whole range: a pixel is ten or more


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """A figure of which there is one for each log; that of the log that is chosen is drawn.

    Parameters
    ----------
    data, layout
        Of all of them, the traces without points.
    curves
        For each log and each group of traces that share an x: that x, then the y of each, packed
        (see `packable`).
    """

    data: list[dict[str, Any]]
    layout: dict[str, Any]
    curves: list[list[list[dict[str, Any]]]]

    @classmethod
    def of(cls, figure: Figure, curves: list[list[list[dict[str, Any]]]]) -> Series:
        """Take the look of all from the figure of one."""
        common = figure.to_dict()
        traces = [{k: v for k, v in each.items() if k not in {"x", "y"}} for each in common["data"]]
        layout = {key: value for key, value in common["layout"].items() if key != "template"}
        return cls(data=traces, layout=layout, curves=curves)

    @classmethod
    def of_figures(cls, figures: Sequence[Figure]) -> Series:
        """Take the points from the figure of each log."""
        curves = [
            [[packable(np.asarray(values)) for values in (trace.x, trace.y)] for trace in each.data]
            for each in figures
        ]
        return cls.of(figures[0], curves)


def packable(values: NDArray[np.floating[Any]], *, logarithmic: bool = False) -> dict[str, Any]:
    """Return (n,) numbers as steps from each to the next, which pack into a byte or so each.

    They are ``begin``, the first number, and ``steps`` from it in units of ``quantum``, less than a
    screen shows of their range; None stands for what is no number. For a logarithmic axis it is
    their logarithms that are packed.
    """
    if logarithmic:
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.log10(values)
    there = np.isfinite(values)
    finite = np.asarray(values[there], dtype=np.float64)
    begin = float(finite[0]) if finite.size else 0.0
    quantum = float(f"{(np.ptp(finite) if finite.size else 0.0) / _SEEN:.3g}") or 1.0
    steps = np.full(values.size, None, dtype=object)
    steps[there] = np.diff(np.rint((finite - begin) / quantum), prepend=0.0).astype(np.int64)
    packed = {"begin": begin, "quantum": quantum, "steps": steps.tolist()}
    return packed | {"logarithmic": True} if logarithmic else packed
