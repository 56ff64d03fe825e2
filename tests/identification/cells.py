"""Equations of linear problems, for the tests of what is inferred from them."""

import numpy as np

from butterfly.identification.equations import CellEquations


def cells(names, rows, residuals, **more):
    """Equations about 0 without bounds, each cell a log of its own but where more is said."""
    told = {"values": np.zeros(len(names)), "lower": np.full(len(names), -np.inf)}
    told |= {"on_bound": np.zeros(len(names), dtype=bool), "log": np.arange(len(rows))}
    return CellEquations(names=names, rows=rows, residuals=residuals, **told | more)
