"""Commands that estimate: identify, select, validate, residual, compare, design."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import butterfly as bf
from butterfly.api.sources import names_result
from butterfly.api.verbs import rank
from butterfly.cli.estimator_options import Fit, SelectFit, ValidateFit
from butterfly.cli.options import (
    NO_REPORT,
    SILENT,
    WRITTEN,
    Data,
    DataOptions,
    Holdout,
    Limit,
    LogNumbers,
    Page,
    Report,
    Split,
    parse_names,
    parse_numbers,
    parse_pairs,
)
from butterfly.cli.output import ExitCode, say, show, show_progress
from butterfly.errors import InputError
from butterfly.experiment.methods import kind_of
from butterfly.identification.inference.term_choice import CANDIDATES


def identify(
    data: Data,
    /,
    *more: Annotated[Path, Parameter(show=False)],
    fit: Fit = Fit(),  # noqa: B008 - frozen
    options: DataOptions = SILENT,
    holdout: Holdout = None,
    against: tuple[Annotated[str, Parameter(metavar="PAIRS")], ...] = (),
    save: Annotated[Path | None, Parameter(group=WRITTEN, metavar="FILE")] = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Identify the robot from a data set.

    Prints the verdict, how well a free-run simulation follows the logs (FIT), and the parameters
    with standard errors and intervals. A folder without manifest.yaml needs --arm, and files named
    like Data_120_5__3_5__0015.mat (120.5 g, 3.5 rad/s, amplitude 0.015).

    Example: butterfly identify real-logs --report report.html

    Parameters
    ----------
    data
        A manifest, a folder of logs, logs, a saved result or a shipped data set's name.
    against
        Other parameters to simulate the same logs with: p1=…,p2=…,p3=…; without p4 the best. May be
        repeated.
    save
        Save the identification (.json) for other commands.
    """
    others = {text: parse_pairs(text, "--against") for text in against}
    source = [data, *more] if more else data
    found = bf.identify(
        bf.read(source, root=options.root, track=show_progress, **options.description()),
        fit.estimator(),
        against=others,
        holdout=parse_names(holdout),
        track=show_progress,
    )
    return show(found, report=page.report, figures=page.figures, save=save)


def select(
    data: Data,
    /,
    *,
    fit: SelectFit = SelectFit(),  # noqa: B008
    candidates: Annotated[str, Parameter(metavar="NAMES")] = ",".join(CANDIDATES),
    nested: bool = False,
    holdout: Holdout = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Choose friction terms by how well they predict what was left out.

    Left out are added masses, or logs. Terms are added one by one, the most helpful first, until
    none helps by more than the standard error of its gain. The verdict is on the estimate
    with the terms chosen.

    Parameters
    ----------
    data
        A manifest, a folder of logs, a saved result or a shipped data set's name.
    candidates
        Terms to choose from, by commas.
    nested
        Choose anew without each part too, which tells what choosing predicts; takes as long again
        for each part.
    """
    found = bf.select(
        data,
        fit.estimator(),
        candidates=parse_names(candidates),
        nested=nested,
        holdout=parse_names(holdout),
        track=show_progress,
    )
    return show(found, report=page.report, figures=page.figures)


def validate(
    data: Data,
    /,
    *more: Annotated[Path, Parameter(show=False)],
    fit: ValidateFit = ValidateFit(),  # noqa: B008
    split: Split = "auto",
    folds: Annotated[int | None, Parameter(metavar="N")] = None,
    holdout: Holdout = None,
    bootstrap: Annotated[int, Parameter(metavar="N")] = 0,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Predict logs that an estimator has not seen; of several estimators, rank them.

    Of several (-m harmonic-balance,output-error), and of several data sets, the estimator comes
    first that predicts best what it has not seen.

    Example: butterfly validate results/quickstart --method output-error

    Parameters
    ----------
    data
        Manifests, folders of logs, saved results or shipped data sets' names.
    split
        What is left out together: one added mass (mass), some of the sines' frequencies
        (frequency), some logs (log), a stretch of every log (time), or the first of these that
        suits.
    folds
        Parts, of frequency, log and time; 5 if not given, or as many as can be.
    bootstrap
        Also estimate so often from logs drawn with replacement.
    """
    methods, left_out = parse_names(fit.method), parse_names(holdout)
    if len(methods) == 1 and not more:
        found: bf.Result = bf.validate(
            data,
            fit.estimator(),
            split=split,
            folds=folds,
            holdout=left_out,
            bootstrap=bootstrap,
            track=show_progress,
        )
    else:
        for method in methods:
            kind_of(method, written=lambda name: f"--{name}")
        for name, value in {"folds": folds, "bootstrap": bootstrap or None, **fit.given}.items():
            if value is not None:
                expected = "none beside several methods or data sets"
                raise InputError("butterfly validate", f"--{name}", value, expected)
        found = rank([data, *more], methods, split=split, holdout=left_out, track=show_progress)
    return show(found, report=page.report, figures=page.figures)


def residual(
    data: Data,
    /,
    *,
    fit: Fit = Fit(),  # noqa: B008
    log: LogNumbers = None,
    holdout: Holdout = None,
    plot: Page = None,
) -> ExitCode:
    """Show the residuals of the identified model, and the terms that it lacks.

    Errors of the free runs, beside what encoder and noise explain; whether their correlations stay
    inside the bands that such sensors allow; which terms the model lacks. With --log only of those
    logs; --plot draws the residual torque of the one that is followed worst.

    Example: butterfly residual results/quickstart --log 2 --plot residual.html

    Parameters
    ----------
    data
        A manifest, a folder of logs, a saved result (whose estimate it is) or a shipped data set's
        name.
    plot
        Draw the log with the largest error to this file (HTML).
    """
    found = bf.residual(
        data, _method(data, fit), logs=parse_numbers(log), holdout=parse_names(holdout)
    )
    ended = show(found)
    if plot is not None:
        found.plot(plot)
        say(f"Plot: {plot}")
    return ended


def compare(
    data: Data,
    other: Annotated[Path | None, Parameter(name="OTHER")] = None,
    /,
    *,
    fit: Fit = Fit(),  # noqa: B008
    log: LogNumbers = None,
    holdout: Holdout = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Compare MuJoCo, grey-box model and logs; or two saved results.

    The robot is identified from the data set; both simulators get its parameters and each log's
    input. Prints FIT, amplitude and phase error of each, and the residuals.

    Of two saved identifications it tells whether the robot has changed: each parameter is tested,
    and all of them together; at most one comparison in twenty of a robot that has not changed says
    that it has. Of two runs of a sweep: what they set, and what they found.

    Examples: butterfly compare real-logs --report compare.html; butterfly compare spring.json
    autumn.json; butterfly compare results/large-sweep/0 results/large-sweep/1

    Parameters
    ----------
    data
        A manifest, a folder of logs, a saved result (whose estimate it is) or a shipped data set's
        name; or the first of two results.
    other
        A later saved identification; or another run of a sweep, as results/NAME/NUMBER.
    """
    if other is None:
        found: bf.Result = bf.compare(
            data,
            _method(data, fit),
            logs=parse_numbers(log),
            holdout=parse_names(holdout),
            track=show_progress,
        )
        return show(found, report=page.report, figures=page.figures)
    from butterfly.cli.results import compare_runs, is_run  # noqa: PLC0415 - slow to import

    of_logs = {"--log": log, "--holdout": holdout, "--method": fit.given}
    for option, value in of_logs.items():
        if value:
            raise InputError("butterfly compare", option, value, "none beside two results")
    if is_run(data) and is_run(other):
        if page.report is not None:
            raise InputError("butterfly compare", "--report", page.report, "none of two runs")
        return compare_runs(data, other)
    for path in (data, other):
        if not names_result(path):
            expected = "a saved identification (.json), or two runs of sweeps (results/NAME/NUMBER)"
            field = "DATA" if path is data else "OTHER"
            raise InputError("butterfly compare", field, path, expected)
    return show(bf.changed(data, other), report=page.report, figures=page.figures)


def design(
    data: Data,
    /,
    *,
    fit: Fit = Fit(),  # noqa: B008
    swing: Annotated[float | None, Parameter(metavar="rad")] = None,
    limit: Limit = 12,
    holdout: Holdout = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Rank candidate next experiments by how much they would tell.

    Sines, multisines and free decays with each added mass of the data set and with none, of a servo
    as set-points in its loop; each is simulated with the estimate, of which the verdict stands
    first. Values that no joint has are refused.

    Parameters
    ----------
    data
        A manifest, a folder of logs, a saved result (whose estimate it is) or a shipped data set's
        name.
    swing
        Largest swing allowed (on a slide in m); 1, or what logs of a slide or servo have shown, if
        not given.
    limit
        Candidates to print, at most.
    """
    found = bf.design(
        data, _method(data, fit), swing=swing, holdout=parse_names(holdout), track=show_progress
    )
    return show(found, report=page.report, figures=page.figures, rows=limit)


def _method(data: Path, fit: Fit) -> bf.Estimator | None:
    """Return the estimator; None for a saved result, if nothing was said of any."""
    return fit.unless_default() if names_result(data) else fit.estimator()
