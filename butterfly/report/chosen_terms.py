"""The report of a choice of terms: what each structure follows, in sample and left out."""

from __future__ import annotations

from collections.abc import Sequence

from plotly.graph_objects import Figure, Scatter

from butterfly.document import Told
from butterfly.identification.data import DataSet
from butterfly.identification.validate import Structure
from butterfly.report.figures import look
from butterfly.report.format import fit_text
from butterfly.report.page import Page, Section, Table


def structures_table(passed: Sequence[Structure]) -> Table:
    """Make a table with a row for each structure, FIT in per cent."""
    splits = tuple(passed[0].held_out)
    kinds = ("in sample", *(f"{split} left out" for split in splits))
    rows = []
    for structure in passed:
        fits = [structure.in_sample, *(structure.held_out[split] for split in splits)]
        cells = [fit_text(value) for fit in fits for value in (fit.median, fit.mean)]
        rows.append((", ".join(("p1..p4, coulomb, delay", *structure.terms)), *cells))
    told = (f"{kind}: {what}" for kind in kinds for what in ("median", "mean"))
    return Table(headers=("terms", *told), rows=rows)


def selection_page(data: DataSet, passed: Sequence[Structure], told: Told) -> Page:
    """Put together the report of the structures passed through, the last being the chosen one.

    Parameters
    ----------
    data
        The logs.
    passed
        The structures, in order.
    told
        All this for programs (see `told_selection`).
    """
    return Page(
        name=data.name,
        description=data.description,
        kind="choice of terms",
        summary=told.summary[1:],
        lead=Section(
            title="FIT by what is fitted",
            text="Median FIT in %, in sample and of what was left out, which decides.",
            figures={"fit": _figure(passed)},
        ),
        sections=[
            Section(title="FIT in %, in sample and left out", tables=(structures_table(passed),))
        ],
        numbers=told.document(),
        verdict=told.verdict,
    )


def _figure(passed: Sequence[Structure]) -> Figure:
    figure = Figure()
    names = ["p1..p4, coulomb, delay", *(f"+ {each.terms[-1]}" for each in passed[1:])]
    fits = {"in sample": [each.in_sample.median for each in passed]}
    for split in passed[0].held_out:
        fits[f"{split} left out"] = [each.held_out[split].median for each in passed]
    for number, (name, values) in enumerate(fits.items()):
        colour, symbol = look(number)
        marker = {"color": colour, "symbol": symbol, "size": 9}
        figure.add_trace(Scatter(x=names, y=values, mode="lines+markers", name=name, marker=marker))
    figure.update_yaxes(title="median FIT in %")
    figure.update_layout(height=340)
    return figure
