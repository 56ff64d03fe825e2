"""`butterfly predict`: what is to come, and how far that is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import butterfly as bf
from butterfly.cli.options import NO_REPORT, Data, Out, Report, parse_pairs
from butterfly.cli.output import ExitCode, say, show
from butterfly.cli.progress import show_progress
from butterfly.errors import InputError


def predict(
    data: Data,
    /,
    *,
    given: Annotated[str, Parameter(name="--with", metavar="RESULT")],
    bands: bool = False,
    draws: Annotated[int, Parameter(metavar="N")] = 200,
    seed: Annotated[int, Parameter(metavar="N")] = 0,
    out: Out = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Predict logs, or an experiment that nobody has done, with given parameters.

    Identifies nothing: simulates each log from its first sample and its input alone, and says
    whether these parameters move like this robot. With --bands it says of each instant where the
    angle is with 95 %: of the model, with whatever parameters the estimate leaves open; and of a
    new log, with what the model misses besides, as seen on the logs that the estimate was made
    from.

    Examples: butterfly predict quickstart --with result.json --bands --report prediction.html;
    butterfly predict results/quickstart --with p1=0.0033,p2=0.0014,p3=0.05

    Parameters
    ----------
    data
        What is predicted: a manifest, a folder of logs, a log, a saved result or a shipped data
        set's name; or an experiment, of which the inputs count.
    given
        An identification that was saved (butterfly identify --save FILE); or parameters, p1=…,p3=…
        and whatever else is not 0 (p2, p4, coulomb, delay, …) and not known of the data; without p4
        the best one is taken, without zero=… the encoder's is read off the logs.
    bands
        Say how far the prediction is known; a report always does.
    draws
        Sets of parameters drawn, for bands and --out.
    seed
        Fixes everything random.
    out
        Write the parameters drawn to this file (CSV), as for domain randomisation.
    """
    pairs = "=" in given and not Path(given).exists()
    result = parse_pairs(given, "--with") if pairs else Path(given)
    if out is not None and pairs:
        raise InputError("butterfly predict", "--out", out, "an identification to draw from")
    found = bf.predict(
        data,
        result,
        bands=bands or (page.report is not None and not pairs),
        draws=draws,
        seed=seed,
        track=show_progress,
    )
    ended = show(found, report=page.report, figures=page.figures)
    if out is not None and isinstance(result, Path):
        drawn = found.drawn or bf.draws(result, draws, seed, track=show_progress)
        drawn.write_csv(out)
        say(f"Draws: {out}")
    return ended
