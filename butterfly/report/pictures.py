"""Draw plotly figures with matplotlib, for PNG and SVG without a browser."""

from __future__ import annotations

import io
import re
from base64 import b64encode
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Still
from matplotlib.ticker import LogFormatterSciNotation, MultipleLocator
from numpy.typing import NDArray

from butterfly.errors import visible
from butterfly.files import replacing
from butterfly.outputs import mark_of
from butterfly.report.figures import GREY, SYMBOLS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from plotly.graph_objects import Figure

_INCH = 100  # plotly's pixels
_WIDTH = 900  # pixels
_DOTS = 80  # per inch, of a picture in a notebook
_MARGIN = 0.1  # inches
_ACROSS = 4  # names in a line of the legend
_SHADE = 0.22  # of a band, from clear to opaque
_FEW_NOUGHTS = 1e-3  # a number from which no power of ten is needed to read it
_PALE = 0.6  # size from which a cell between -1 and 1 is dark
_DASHES = {"dot": ":", "dash": "--", "dashdot": "-."}
_MARKERS = dict(zip((*SYMBOLS, "x"), "osD^v*px", strict=True))


class _PlainPowers(LogFormatterSciNotation):
    """Marks of a logarithmic axis, without powers where none are needed."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = super().__call__(x, pos)
        return f"{x:g}" if text and _FEW_NOUGHTS <= x <= 1 / _FEW_NOUGHTS else text


def write_pictures(figures: Mapping[str, Figure], folder: Path) -> None:
    """Write each figure as ``folder``/NAME.png and NAME.svg: all that the reports use is drawn."""
    metadata = {"png": {"Software": "butterfly.figure"}, "svg": {"Title": "butterfly.figure"}}
    for name, figure in figures.items():
        still = draw(figure)
        FigureCanvasAgg(still)  # what a figure is measured on
        edges = still.get_tightbbox().padded(_MARGIN)
        for canvas, suffix in ((FigureCanvasAgg, "png"), (FigureCanvasSVG, "svg")):
            path = folder / f"{name}.{suffix}"
            with replacing(path, mark_of(path, "figure")) as draft:
                canvas(still).print_figure(
                    draft, format=suffix, bbox_inches=edges, metadata=metadata[suffix]
                )


def png_text(figure: Figure) -> str:
    """Return a figure as a PNG in text, as small as a notebook's cell wants it."""
    still, file = draw(figure), io.BytesIO()
    FigureCanvasAgg(still).print_figure(file, format="png", dpi=_DOTS, bbox_inches="tight")
    return b64encode(file.getvalue()).decode("ascii")


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
    for note in layout.get("annotations", []):
        if note.get("xref") == "paper":
            at, style = (_within(note["x"]), _within(note["y"])), note.get("font", {})
            colour, bold = style.get("color", "black"), note["text"].startswith("<b>")
            look: dict[str, Any] = {"color": colour, "weight": "bold" if bold else "normal"}
            still.text(*at, _plain(note["text"]).strip(), ha="center", va="center", **look)
    if (axes := panels.get(("x", "y"))) is not None:
        for shape in layout.get("shapes", []):
            line, dash = shape["line"], _DASHES.get(shape["line"].get("dash"), "-")
            style = {"color": line["color"], "linewidth": line["width"], "linestyle": dash}
            axes.axvline(shape["x0"], zorder=1, **style)  # as plotly's add_vline draws
        for note in layout.get("annotations", []):
            if note.get("xref", "x") == "x":
                axes.text(note["x"], note["y"], f" {_plain(note['text'])}", fontsize="x-small")
    _explain(list(panels.values()))
    return still


def _explain(panels: list[Axes]) -> None:
    """Put one legend above all panels."""
    named: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    if named:
        top = max(panels, key=lambda axes: axes.get_position().y1)
        place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "ncols": _ACROSS}
        top.legend(named.values(), named.keys(), fontsize="x-small", frameon=False, **place)


def _within(place: float) -> float:
    """Return where a place of plotly's paper is in a picture."""
    return 0.08 + 0.84 * place


def _panel(still: Still, layout: dict[str, Any], key: tuple[str, str]) -> Axes:
    across, up = (layout.get(f"{name[0]}axis{name[1:]}", {}) for name in key)
    (start, stop), (bottom, top) = (axis.get("domain", (0, 1)) for axis in (across, up))
    begin, below = _within(start), _within(bottom)
    box = (begin, below, _within(stop) - begin, _within(top) - below)
    axes = still.add_axes(box)
    axes.grid(visible=True, alpha=0.3)
    axes.ticklabel_format(useOffset=False)
    for name, axis, ticks in (("x", across, axes.xaxis), ("y", up, axes.yaxis)):
        if axis.get("type") == "log":
            axes.set(**{f"{name}scale": "log"})
            ticks.set_major_formatter(_PlainPowers())
            ticks.set_minor_formatter(_PlainPowers())
        elif axis.get("dtick"):
            ticks.set_major_locator(MultipleLocator(axis["dtick"]))
        ticks.set_label_text(_plain((axis.get("title") or {}).get("text", "")), fontsize="small")
        if axis.get("ticktext"):
            ticks.set_ticks(axis["tickvals"], [*map(_lines, axis["ticktext"])], fontsize="x-small")
        if ends := axis.get("range"):  # of a logarithmic axis plotly has exponents
            limits = [10.0**end for end in ends] if axis.get("type") == "log" else ends
            axes.set(**{f"{name}lim": limits})
    if up.get("visible") is False:
        axes.yaxis.set_visible(False)
    axes.tick_params(
        which="both",
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
        "linewidth": 1.5 if line.width is None else line.width,
        "alpha": trace.opacity,
        "marker": _MARKERS.get(symbol.removesuffix("-open"), "o") if "markers" in mode else None,
        "markersize": 0.7 * (marker.size if isinstance(marker.size, int | float) else 6),
        "markerfacecolor": "none" if symbol.endswith("-open") else colour,
        "label": _label(trace),
    }
    x, y = (np.asarray(values) for values in (trace.x, trace.y))
    if trace.fill == "toself":
        axes.fill(x, y, color=trace.fillcolor, alpha=trace.opacity, label=_label(trace), zorder=1)
        return
    if trace.fill == "tonexty":
        before = axes.lines[-1]
        shade: dict[str, Any] = {"color": GREY, "alpha": _SHADE, "linewidth": 0, "zorder": 1}
        axes.fill_between(x, before.get_ydata(), y, label=_label(trace), **shade)
        style["label"] = None
    if x.dtype.kind in "UO":
        x = np.array([_lines(label) for label in x])
        axes.tick_params(axis="x", labelsize="x-small")
    across, up = _errors(trace.error_x), _errors(trace.error_y)
    if across is None and up is None:
        axes.plot(x, y, **style)
    else:
        axes.errorbar(x, y, xerr=across, yerr=up, elinewidth=1, **style)


def _errors(error: Any) -> NDArray[Any] | None:  # noqa: ANN401 - plotly's
    """Return (2, n) lengths of error bars, downwards and upwards; None without any."""
    if error.array is None:
        return None
    return np.array([error.array if error.arrayminus is None else error.arrayminus, error.array])


def _heatmap(axes: Axes, trace: Any) -> None:  # noqa: ANN401 - plotly's
    values = np.asarray(trace.z, dtype=float)
    diverging = trace.zmin is not None
    style: dict[str, Any] = {"origin": "lower", "aspect": "auto", "vmin": trace.zmin}
    style |= {"vmax": trace.zmax, "cmap": "RdBu" if diverging else "cividis"}
    shown = axes.imshow(values, **style)
    axes.grid(visible=False)
    for position, labels in ((axes.set_xticks, trace.x), (axes.set_yticks, trace.y)):
        if labels is not None:
            position(range(len(labels)), [*map(_lines, labels)], fontsize="x-small")
    if trace.texttemplate:
        middle = (np.nanmin(values) + np.nanmax(values)) / 2
        for (row, column), value in np.ndenumerate(values):
            light = abs(value) < _PALE if diverging else value > middle
            text = f"{value:.2f}" if diverging else f"{value:.3g}"
            colour = "black" if light else "white"
            axes.text(column, row, text, ha="center", va="center", color=colour, fontsize="small")
    if trace.showscale is False:
        return
    axes.figure.colorbar(shown, ax=axes, label=_plain(trace.colorbar.title.text or ""))


def _label(trace: Any) -> str | None:  # noqa: ANN401 - plotly's
    return None if trace.showlegend is False or not trace.name else _plain(trace.name)


def _lines(label: object) -> str:
    """Return a label with its line breaks."""
    return _plain(str(label).replace("<br>", "\n"))


def _plain(text: str) -> str:
    """Leave out markup; what looked like some, but was none, is text, as is a dollar."""
    return visible(unescape(re.sub(r"<[^>]+>", " ", text))).replace("$", r"\$")


_DRAWN = {"scatter": _scatter, "heatmap": _heatmap}
