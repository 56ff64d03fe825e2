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
    Report,
    Split,
    parse_names,
    parse_numbers,
    parse_pairs,
)
from butterfly.cli.output import ExitCode, asked, show, show_progress
from butterfly.cli.written import SAVED
from butterfly.errors import InputError
from butterfly.experiment.methods import kind_of
from butterfly.model.terms import COMMON
from butterfly.report.summary import next_step


def identify(
    data: Data,
    /,
    *more: Annotated[Path, Parameter(show=False)],
    fit: Fit = Fit(),  # noqa: B008 - frozen
    options: DataOptions = SILENT,
    holdout: Holdout = None,
    against: tuple[Annotated[str, Parameter(metavar="PAIRS")], ...] = (),
    save: Annotated[Path | None, Parameter(group=WRITTEN, metavar="FILE"), SAVED] = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Identify the joint from logs.

    Prints the verdict, and the parameters with 95 % intervals.

    Examples: butterfly identify real-logs --report report.html --save result.json; butterfly
    identify a.csv b.csv --columns time=t,input=tau,angle=q --input torque

    Parameters
    ----------
    data
        Logs, a folder of logs, a manifest, a saved result, or a shipped data set's name.
    against
        Compare with p1=0.003,p2=0.001,p3=0.05. Default of p4: best-fitting. Repeatable.
    save
        Save the result (.json) for other commands.
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
    ended = show(found, report=page.report, figures=page.figures, save=save)
    if not asked.silent:  # whole, however long: to be pasted
        print(f"Next: {next_step(found, asked.words, [data, *more], save)}")
    return ended


def select(
    data: Data,
    /,
    *,
    fit: SelectFit = SelectFit(),  # noqa: B008
    candidates: Annotated[str, Parameter(metavar="NAMES")] = ",".join(COMMON),
    nested: bool = False,
    holdout: Holdout = None,
    page: Report = NO_REPORT,
) -> ExitCode:
    """Choose terms as identify does, and show what each choice predicts.

    Each round adds the term that predicts held-out logs best, or takes one away that does not help.
    Every set of terms has its FIT in sample and on held-out added masses (or logs).

    Example: butterfly select real-logs --candidates drag,stribeck

    Parameters
    ----------
    data
        A manifest, a folder of logs, a saved result, or a shipped data set's name.
    candidates
        Terms to choose from.
    nested
        Nested cross-validation: repeats the choice without each held-out part (slow).
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
    """Cross-validate an estimator on held-out logs, or rank several.

    With several methods or data sets, ranks the methods by their median FIT on held-out logs.

    Examples: butterfly validate real-logs --split mass; butterfly validate real-logs
    --method harmonic-balance,output-error

    Parameters
    ----------
    data
        Manifests, folders of logs, saved results, or shipped data sets' names.
    split
        What to hold out at a time: an added mass (mass), sine frequencies (frequency), logs (log),
        a section of every log (time), or the first of these that the data allow (auto).
    folds
        Number of parts for frequency, log and time. Default: 5, or fewer if the data require it.
    bootstrap
        Number of bootstrap samples of the logs for 95 % intervals.
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
                expected = "no such option with several methods or data sets"
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
    page: Report = NO_REPORT,
) -> ExitCode:
    """Analyse the residuals, and name the terms that the model is missing.

    Compares each log's free-run error with the sensor noise, and tests its correlations.

    Example: butterfly residual result.json --log 2 --report residual.html

    Parameters
    ----------
    data
        A saved result; or a manifest, a folder of logs or a shipped data set's name, to identify
        first.
    """
    found = bf.residual(
        data, _method(data, fit), logs=parse_numbers(log), holdout=parse_names(holdout)
    )
    return show(found, report=page.report, figures=page.figures)


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
    """Compare two saved results; or MuJoCo, the model and the logs.

    Two saved results: tests which parameters have changed (5 % significance, all tests together).
    One data set: simulates every log in MuJoCo and with the model, and prints FIT, amplitude and
    phase errors. Two runs of a sweep: lists their settings and estimates.

    Examples: butterfly compare spring.json autumn.json; butterfly compare real-logs --report
    compare.html; butterfly compare results/large-sweep/0 results/large-sweep/1

    Parameters
    ----------
    data
        The earlier saved result; a run of a sweep, such as results/NAME/0; or one data set.
    other
        The later saved result, or the other run.
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

    for option, value in {"--log": log, "--holdout": holdout, "--method": fit.given}.items():
        if value:
            raise InputError("butterfly compare", option, value, "no such option with two results")
    if is_run(data) and is_run(other):
        if page.report is not None:
            expected = "no report: two runs of sweeps have none"
            raise InputError("butterfly compare", "--report", page.report, expected)
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
    """Rank next experiments by how much they would shrink the standard errors.

    Candidates: sines, multisines and free decays, with each added mass and without. Each one is
    simulated with the identified parameters.

    Example: butterfly design result.json --swing 0.5

    Parameters
    ----------
    data
        A saved result; or a manifest, a folder of logs or a shipped data set's name, to identify
        first.
    swing
        Largest allowed swing (m on a slide). Default: 1; on a slide or servo, the logs' largest.
    limit
        Number of candidates to print.
    """
    found = bf.design(
        data, _method(data, fit), swing=swing, holdout=parse_names(holdout), track=show_progress
    )
    return show(found, report=page.report, figures=page.figures, rows=limit)


def _method(data: Path, fit: Fit) -> bf.Estimator | None:
    """Return the estimator; None for a saved result without options of a fit."""
    return fit.unless_default() if names_result(data) else fit.estimator()
