"""Draw plotly figures with matplotlib, for PNG and SVG without a browser."""

from __future__ import annotations

import re
from html import unescape
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Still

from butterfly.files import replacing

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from plotly.graph_objects import Figure

_INCH = 100  # plotly's pixels
_WIDTH = 900  # pixels
_MARGIN = 0.1  # inches
_BAR = 0.35  # width of a bar
_DASHES = {"dot": ":", "dash": "--", "dashdot": "-."}
_MARKERS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle-up": "^",
    "triangle-down": "v",
    "star": "*",
    "pentagon": "p",
    "x": "x",
}


def write_stills(figures: Mapping[str, Figure], folder: Path) -> None:
    """Write each figure as ``folder``/NAME.png and NAME.svg.

    Line and scatter plots (with error bars), filled shapes, bars and heat maps in any grid of axes
    are drawn, which is all that the reports use.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    for name, figure in figures.items():
        still = draw(figure)
        FigureCanvasAgg(still)  # what a figure is measured on
        edges = still.get_tightbbox().padded(_MARGIN)
        for canvas, suffix in ((FigureCanvasAgg, "png"), (FigureCanvasSVG, "svg")):
            with replacing(folder / f"{name}.{suffix}") as draft:
                canvas(still).print_figure(draft, format=suffix, bbox_inches=edges)


def draw(figure: Figure) -> Still:
    """Return a matplotlib figure of a plotly one."""
    layout = figure.to_dict()["layout"]
    still = Still(figsize=(_WIDTH / _INCH, layout.get("height", 450) / _INCH), dpi=_INCH)
    panels: dict[tuple[str, str], Axes] = {}
    for trace in figure.data:
        key = (trace.xaxis or "x", trace.yaxis or "y")
        if key not in panels:
            panels[key] = _panel(still, layout, key)
        _DRAWN[trace.type](panels[key], trace)
    for note in layout.get("annotations", []):  # subplot titles
        if note.get("xref") == "paper":
            still.text(
                0.08 + 0.84 * note["x"], 0.08 + 0.84 * note["y"], _plain(note["text"]), ha="center"
            )
    for axes in panels.values():
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize="x-small", framealpha=0.6)
    return still


def _panel(still: Still, layout: dict[str, Any], key: tuple[str, str]) -> Axes:
    across, up = (layout.get(f"{name[0]}axis{name[1:]}", {}) for name in key)
    (left, right), (bottom, top) = (axis.get("domain", (0, 1)) for axis in (across, up))
    box = (0.08 + 0.84 * left, 0.08 + 0.84 * bottom, 0.84 * (right - left), 0.84 * (top - bottom))
    axes = still.add_axes(box)
    axes.grid(visible=True, alpha=0.3)
    for axis, setter, label in (
        (across, axes.set_xscale, axes.set_xlabel),
        (up, axes.set_yscale, axes.set_ylabel),
    ):
        if axis.get("type") == "log":
            setter("log")
        label(_plain((axis.get("title") or {}).get("text", "")), fontsize="small")
    axes.tick_params(
        labelbottom=across.get("showticklabels") is not False,
        labelleft=up.get("showticklabels") is not False,
    )
    return axes


def _scatter(axes: Axes, trace: Any) -> None:  # noqa: ANN401 - plotly's
    mode = trace.mode or "lines"
    line, marker = trace.line, trace.marker
    colour = line.color or (marker.color if isinstance(marker.color, str) else None)
    symbol = str(marker.symbol or "circle")
    style: dict[str, Any] = {
        "color": colour,
        "linestyle": _DASHES.get(line.dash, "-") if "lines" in mode else "none",
        "linewidth": line.width or 1.5,
        "marker": _MARKERS.get(symbol.removesuffix("-open"), "o") if "markers" in mode else None,
        "markersize": 0.7 * (marker.size if isinstance(marker.size, int | float) else 6),
        "markerfacecolor": "none" if symbol.endswith("-open") else colour,
        "label": _label(trace),
    }
    x, y = (np.asarray(values) for values in (trace.x, trace.y))
    if trace.fill == "toself":
        axes.fill(x, y, color=trace.fillcolor, alpha=trace.opacity, label=_label(trace), zorder=1)
        return
    if x.dtype.kind in "UO":
        x = np.array([_lines(label) for label in x])
        axes.tick_params(axis="x", labelsize="x-small")
    if trace.error_y.array is None:
        axes.plot(x, y, **style)
    else:
        upper = np.asarray(trace.error_y.array)
        lower = upper if trace.error_y.arrayminus is None else np.asarray(trace.error_y.arrayminus)
        axes.errorbar(x, y, yerr=np.array([lower, upper]), elinewidth=1, **style)


def _bar(axes: Axes, trace: Any) -> None:  # noqa: ANN401 - plotly's
    color = trace.marker.color if isinstance(trace.marker.color, str) else None
    place = np.arange(len(trace.x)) + _BAR * len(axes.containers)
    heights = np.asarray(trace.y, dtype=float)
    axes.bar(place, heights, width=_BAR, color=color, label=_label(trace))
    axes.set_xticks(
        np.arange(len(trace.x)), [_lines(label) for label in trace.x], fontsize="x-small"
    )


def _heatmap(axes: Axes, trace: Any) -> None:  # noqa: ANN401 - plotly's
    values = np.asarray(trace.z, dtype=float)
    shown = axes.imshow(values, origin="lower", aspect="auto", cmap="cividis")
    for position, labels in ((axes.set_xticks, trace.x), (axes.set_yticks, trace.y)):
        if labels is not None:
            texts = [_lines(label) for label in labels]
            position(range(len(labels)), texts, fontsize="x-small")
    if trace.texttemplate:
        middle = (np.nanmin(values) + np.nanmax(values)) / 2
        for (row, column), value in np.ndenumerate(values):
            colour = "black" if value > middle else "white"
            axes.text(column, row, f"{value:.3g}", ha="center", va="center", color=colour)
    title = trace.colorbar.title.text
    axes.figure.colorbar(shown, ax=axes, label=_plain(title or ""))


def _label(trace: Any) -> str | None:  # noqa: ANN401 - plotly's
    return None if trace.showlegend is False or not trace.name else _plain(trace.name)


def _lines(label: object) -> str:
    return _plain(str(label).replace("<br>", "\n"))


def _plain(text: str) -> str:
    """Leave out markup; what looked like some, but was none, is text, as is a dollar."""
    return unescape(re.sub(r"<[^>]+>", " ", text)).replace("$", r"\$")


_DRAWN = {"scatter": _scatter, "bar": _bar, "heatmap": _heatmap}
