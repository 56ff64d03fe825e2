"""The report of a choice of terms: what each structure follows, in sample and left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from butterfly.report.page import Page, Section, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from butterfly.identify.data import DataSet
    from butterfly.identify.judgement.term_selection import Structure
    from butterfly.report.verdict import SaidVerdict


def chosen_said(passed: Sequence[Structure]) -> str:
    """Say which terms were chosen, as an option of other commands."""
    terms = ",".join(passed[-1].terms)
    return f"Chosen: --terms {terms}" if terms else "Chosen: --terms '' (none of them helps)"


def structures_table(passed: Sequence[Structure]) -> Table:
    """Make a table with a row for each structure, FIT in per cent."""
    splits = tuple(passed[0].held_out)
    kinds = ("in sample", *(f"{split} left out" for split in splits))
    rows = []
    for structure in passed:
        fits = [structure.in_sample, *(structure.held_out[split] for split in splits)]
        cells = [f"{value:.1f}" for fit in fits for value in (fit.median, fit.mean)]
        rows.append((", ".join(("p1..p4, coulomb, delay", *structure.terms)), *cells))
    told = (f"{kind}: {what}" for kind in kinds for what in ("median", "mean"))
    return Table(headers=("terms", *told), rows=rows)


def selection_page(data: DataSet, passed: Sequence[Structure], verdict: SaidVerdict) -> Page:
    """Put together the report of the structures passed through, the last being the chosen one."""
    return Page(
        name=data.name,
        description=data.description,
        kind="choice of terms",
        summary=[chosen_said(passed)],
        sections=[
            Section(title="FIT in %, in sample and left out", tables=(structures_table(passed),))
        ],
        numbers=verdict.numbers()
        | {
            "chosen": list(passed[-1].terms),
            "structures": [
                {
                    "terms": list(each.terms),
                    "in_sample": each.in_sample.numbers(),
                    "left_out": {str(split): fit.numbers() for split, fit in each.held_out.items()},
                }
                for each in passed
            ],
        },
        verdict=verdict,
    )
