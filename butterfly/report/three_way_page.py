"""The report of MuJoCo against grey box against log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

import numpy as np
from plotly.graph_objects import Figure
from plotly.subplots import make_subplots

from butterfly.arrays import Samples
from butterfly.comparison.three_way import ThreeWay
from butterfly.identification.data import DataSet
from butterfly.identification.diagnostics.residuals import Residuals
from butterfly.model.parameters import AddedMass, JointKind
from butterfly.report.figures import (
    PALETTE,
    add,
    grams,
    logs_panel,
    mass_looks,
    middle,
    panel,
    panels,
    seen_samples,
)
from butterfly.report.log_figures import correlation_figure, correlation_series, first_stretch
from butterfly.report.page import Fact, Page, PageTable, Section, Series
from butterfly.report.residual import residual_table
from butterfly.result import Result

_SIMULATORS = {"MuJoCo": ("-open", 12), "grey box": ("", 5)}  # symbol and size of their marks
_LINES = {  # the later ones above, and thinner, so that all are seen
    "MuJoCo": {"color": PALETTE[1], "width": 8},
    "grey box": {"color": PALETTE[2], "width": 5},
    "measured": {"color": PALETTE[0], "width": 1.8},
}
_STEP = 0.02  # s between drawn points
_MOST = 4000  # points of a curve
_PERIODS = 4  # of the drawn motion in the phase plane
_DOTS = 800  # of a residual torque


def three_way_page(
    data: DataSet, compared: Sequence[ThreeWay], residuals: Residuals, result: Result
) -> Page:
    """Put together the report of a comparison, with the `residuals` of the whole data set."""
    judged = {log.name: log for log in residuals.logs}
    own = [judged[each.log.name] for each in compared]
    chosen = middle([each.fits["grey box"] for each in compared])
    of_log = {"time": _time_figure, "phase": _phase_figure, "residual": _residual_figure}
    series = {name: Series.of_figures([*map(draw, compared)]) for name, draw in of_log.items()}
    stretches = [first_stretch(each.log) for each in compared]
    series["time"] = replace(series["time"], stretches=stretches)
    sections = [
        *_frequencies([each for each in compared if each.gains], data.masses),
        Section(
            title="Measured against simulated",
            text="Free run: the simulators get the recorded input and the initial angle only. The "
            "phase plane shows the end of the log.",
            series={"time": series["time"], "phase": series["phase"]},
        ),
        Section(
            title="Residuals",
            text="Correlations of the grey box's errors: sensor noise alone stays inside the "
            "bands. Below: the residual torque, averaged over short intervals.",
            series={"left-over": correlation_series(own), "residual": series["residual"]},
            tables=(residual_table(own, picks=range(len(own))),),
        ),
        Section(title="Every log", tables=(_table(compared),)),
    ]
    return Page(
        name=data.name,
        description=data.description,
        kind="comparison",
        facts=_facts(compared, len(data.logs)),
        lead=Section(
            title="FIT log by log",
            text="The worst on top. Large marks: MuJoCo; small ones: the grey box.",
            figures={"fit": _fit_figure(compared, data.masses)},
        ),
        summary=result.notes,
        sections=sections,
        logs=[f"{each.log.label} – FIT {each.fits['grey box']:.1f} %" for each in compared],
        chosen=chosen,
        pictures={name: partial(draw, compared[chosen]) for name, draw in of_log.items()}
        | {"left-over": partial(correlation_figure, own[chosen])},
        numbers=result.to_dict(),
        verdict=result.judged,
    )


def _facts(compared: Sequence[ThreeWay], count: int) -> list[Fact]:
    way = compared[0].log.added_mass.joint.way
    apart = max(each.difference for each in compared)
    medians = [
        Fact(f"FIT of {key}", f"{np.median([each.fits[key] for each in compared]):.2f} %", "median")
        for key in _SIMULATORS
    ]
    return [
        *medians,
        Fact("MuJoCo − grey box", f"{apart:.2g} {way}", "largest difference"),
        Fact("logs compared", str(len(compared)), f"of {count}"),
    ]


def _table(compared: Sequence[ThreeWay]) -> PageTable:
    rows, way = [], compared[0].log.added_mass.joint.way
    for each in compared:
        errors = [
            f"{100 * (abs(gain) - 1):+z.2f} %, {np.degrees(np.angle(gain)):+z.2f}°"
            for gain in each.gains.values()
        ] or ["–", "–"]
        fits = [f"{fit:.2f}" for fit in each.fits.values()]
        rows.append((each.log.label, *fits, *errors, f"{each.difference:.2g}"))
    headers = (
        "log",
        *(f"{name}: FIT in %" for name in _SIMULATORS),
        *(f"{name}: amplitude, phase error" for name in _SIMULATORS),
        f"simulators apart in {way}",
    )
    return PageTable(headers=headers, rows=rows, picks=range(len(rows)))


def _fit_figure(compared: Sequence[ThreeWay], masses: Sequence[AddedMass]) -> Figure:
    ranked = sorted(compared, key=lambda each: each.fits["grey box"])
    figure = logs_panel([each.log.label for each in ranked], "FIT in %")
    for mass, own, style in _by_mass(ranked, masses):
        for name, look_of in style.items():
            x, y = [ranked[k].fits[name] for k in own], own
            texts = [escape(ranked[k].log.label) for k in own]
            hover = f"%{{text}}, {name}: %{{x:.4g}} %<extra></extra>"
            label = f"{grams(mass)}, {name}"
            figure.add_scatter(x=x, y=y, text=texts, name=label, hovertemplate=hover, **look_of)
    return figure


def _by_mass(
    compared: Sequence[ThreeWay], masses: Sequence[AddedMass]
) -> Iterator[tuple[AddedMass, list[int], dict[str, dict[str, Any]]]]:
    """Yield each added mass, the numbers of its logs, and the look of each simulator's points."""
    for mass, (colour, symbol) in mass_looks(masses).items():
        own = [k for k, each in enumerate(compared) if each.log.added_mass == mass]
        if own:
            yield (
                mass,
                own,
                {
                    name: {
                        "mode": "markers",
                        "marker": {"color": colour, "symbol": symbol + mark, "size": size},
                    }
                    for name, (mark, size) in _SIMULATORS.items()
                },
            )


def _frequencies(sines: Sequence[ThreeWay], masses: Sequence[AddedMass]) -> list[Section]:
    """Show how the simulators' steady responses differ from the logs', if there are any."""
    if not sines:
        return []
    omegas = [each.log.excitation.omega for each in sines if each.log.excitation]
    gains = {name: np.array([each.gains[name] for each in sines]) for name in _SIMULATORS}
    sizes = {name: 100 * (np.abs(gain) - 1) for name, gain in gains.items()}
    phases = {name: np.degrees(np.angle(gain)) for name, gain in gains.items()}
    titles = ("amplitude error in %", "phase error in °")
    figure = panels("frequency in rad/s", titles, 480, spacing=0.06)
    for row, (values, unit) in enumerate(((sizes, " %"), (phases, "°")), start=1):
        for mass, own, style in _by_mass(sines, masses):
            for name, look_of in style.items():
                x, y = [omegas[k] for k in own], values[name][own]
                label = f"{grams(mass)}, {name}"
                more = {"legendgroup": label, "showlegend": row == 1, **look_of}
                more["hovertemplate"] = f"%{{x:.3g}} rad/s: %{{y:.4g}}{unit}"
                add(figure, row, x, y, name=label, **more)
    text = (
        "Steady response of each simulator against the log's. Large marks: MuJoCo; small ones: the "
        "grey box; one colour for each added mass."
    )
    title = "Amplitude and phase error per frequency"
    return [Section(title=title, text=text, figures={"frequency": figure})]


def _angles(each: ThreeWay) -> dict[str, Samples]:
    return {"MuJoCo": each.mujoco, "grey box": each.greybox, "measured": each.log.angle}


def _time_figure(each: ThreeWay) -> Figure:
    """Draw the three angles, and the errors of both simulators, against time."""
    columns, log = _angles(each), each.log
    every = max(1, round(_STEP / log.mean_step))
    rows = seen_samples(list(columns.values()), _MOST, every=every)
    way = log.added_mass.joint.way
    figure = panels("time in s", (f"angle in {way}", f"error in {way}"), 460, shares=(0.62, 0.38))
    x = log.time[rows]
    for name, angle in columns.items():
        style = {"mode": "lines", "name": name, "line": _LINES[name]}
        thin = _LINES[name] | {"width": 1.2}
        add(figure, 1, x, angle[rows].astype(np.float32), **style)
        if name != "measured":
            error = (angle - log.angle)[rows].astype(np.float32)
            add(figure, 2, x, error, showlegend=False, **style | {"line": thin})
    return figure


def _phase_figure(each: ThreeWay) -> Figure:
    """Draw velocity against angle over the last periods of a log."""
    time, way = each.log.time, each.log.added_mass.joint.way
    omega = each.log.excitation.omega if each.log.excitation else 3.0
    late = time > time[-1] - _PERIODS * 2 * np.pi / omega
    figure = panel(f"angle in {way}", f"velocity in {way}/s")
    grid = np.linspace(time[late][0], time[-1], 600)
    for name, angle in _angles(each).items():
        smooth = np.convolve(np.interp(grid, time, angle), np.ones(5) / 5, mode="valid")
        velocity = np.gradient(smooth, grid[1] - grid[0])
        x, y = smooth.astype(np.float32), velocity.astype(np.float32)
        figure.add_scatter(x=x, y=y, mode="lines", line=_LINES[name], name=name)
    return figure


def _residual_figure(each: ThreeWay) -> Figure:
    """Draw the residual torque against angle and velocity."""
    residual, joint = each.residual, each.log.added_mass.joint
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.04)
    way, every = joint.way, max(1, residual.torque.size // _DOTS)
    across = {f"angle in {way}": residual.angle, f"velocity in {way}/s": residual.velocity}
    for column, (title, values) in enumerate(across.items(), start=1):
        marker = {"color": PALETTE[column - 1], "size": 3}
        x, y = (part[::every].astype(np.float32) for part in (values, residual.torque))
        style = {"mode": "markers", "marker": marker, "showlegend": False}
        figure.add_scatter(x=x, y=y, row=1, col=column, **style)
        figure.update_xaxes(title=title, row=1, col=column)
    unit = "residual force in N" if joint is JointKind.SLIDE else "residual torque in N m"
    figure.update_yaxes(title=unit, row=1, col=1)
    figure.update_layout(height=360)
    return figure
