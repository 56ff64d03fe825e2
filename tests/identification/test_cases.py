"""Small data sets that an independent integrator made, each with one thing that is hard.

The integrator is ``cases/make.py`` of the shared data, which knows nothing of this program.
"""

import re
import runpy
from dataclasses import replace
from functools import cache
from pathlib import Path

import numba
import numpy as np
import pytest
import yaml

import butterfly as bf
from butterfly.api.verbs import identify
from butterfly.errors import IdentifiabilityError
from butterfly.identification.data import DataSet, read_data_set
from butterfly.identification.estimators import OutputError, WeakForm
from butterfly.identification.physical import physical_parameters
from butterfly.identification.trust import FindingKind
from butterfly.logs.log import Intersample
from butterfly.logs.manifest import read_manifest
from butterfly.progress import counted
from butterfly.verdict import Level
from tests.record.cases import write_servo

PLAIN = OutputError(terms=(), workers=1)
_MAKE = Path(__file__).parents[3] / "shared/data/cases/make.py"


SECONDS = {"torque_steps": 2.5, "p_law_steps": 4.0, "fast_motor": 2.0}
SECONDS |= {"constant_velocity": 1.0, "known_mass": 2.0}
"""How much of each case is made."""


@pytest.fixture(scope="session")
def cases(tmp_path_factory):
    """Return the folder of a case, made when it is asked for, the integrator's step compiled."""
    if not _MAKE.is_file():
        pytest.skip(f"the cases are made by a script that is not there: {_MAKE}")
    folder = tmp_path_factory.mktemp("cases")
    make = runpy.run_path(str(_MAKE))
    globals_ = make["run"].__globals__
    globals_["step"] = numba.njit(globals_["step"])
    run = globals_["run"]

    @cache
    def made(maker, most):
        globals_["run"] = lambda seconds, *more, **joint: run(min(seconds, most), *more, **joint)
        make[maker](folder / f"{most}")
        return folder / f"{most}"

    def case(name, seconds=None):
        maker = next(each for each in SECONDS if name.replace("-", "_").startswith(each))
        return made(maker, seconds or SECONDS[maker]) / name

    return case


def _identified(folder: Path, *method):
    return identify(read_data_set(read_manifest(folder / "manifest.yaml")), *method)


def _fifth(name: str) -> Path:
    """Return the folder of a recorded case that was answered wrongly."""
    folder = Path(__file__).parents[3] / "shared/data/cases/fifth" / name
    if not folder.is_dir():
        pytest.skip(f"the case is not there: {folder}")
    return folder


def _holds(estimate, truth: dict[str, float]) -> None:
    """Assert that the intervals hold true values."""
    limits = zip(estimate.names, estimate.lower, estimate.upper, strict=True)
    held = {name: (lower, upper) for name, lower, upper in limits}
    for name, true in truth.items():
        assert held[name][0] <= true <= held[name][1], name


def _truth(folder: Path) -> dict[str, float]:
    return {
        name: float(each)
        for name, each in yaml.safe_load((folder / "truth.yaml").read_text()).items()
    }


def test_one_known_mass_on_a_balanced_rotor_sets_the_scale(cases):
    folder = cases("known-mass-balanced")
    found = _identified(folder, PLAIN)
    assert found.judged.level is Level.GOOD
    values = {row.name: row.value for row in found.estimate.table()}
    for name, true in _truth(folder).items():
        assert values[name] == pytest.approx(true, rel=2e-3, abs=1e-12), name


@pytest.mark.parametrize("case", ["torque-steps", "p-law-steps", "constant-velocity-0"])
def test_values_are_within_their_intervals_whatever_tells_no_delay(cases, case):
    """Nor does a start at rest need a velocity of its own: the spin-up tells of the inertia."""
    terms = ("bias",) if case == "constant-velocity-0" else ()
    found = _identified(cases(case), replace(PLAIN, terms=terms))
    assert found.judged.level is Level.GOOD
    rows = {row.name: row for row in found.estimate.table()}
    for name, true in _truth(cases(case)).items():
        assert rows[name].value == pytest.approx(true, rel=0.04), name
        least, most = rows[name].lower, rows[name].upper
        rounding = 1e-4 * abs(true)  # the encoder's, beside which these logs have no noise
        assert least - rounding <= true <= most + rounding, name
    assert 0 <= rows["delay"].value < 5e-4  # half a step of the clock
    if "steps" in case:
        closed = WeakForm()(found.data).parameters
        for name, true in _truth(cases(case)).items():
            assert getattr(closed, name) == pytest.approx(true, rel=5e-3), name


def test_one_level_of_torque_is_one_number_and_no_wrong_unit(cases):
    with pytest.raises(IdentifiabilityError) as refused:
        _identified(cases("torque-steps-one-level"))
    assert "p1 and coulomb cannot be identified separately" in str(refused.value)
    assert not re.search("degrees|counts|delay", str(refused.value))
    told = re.search(r"p1 \+ (\S+) coulomb is (\S+), p1 at most that", str(refused.value))
    truth, torque = 8.6e-4, 0.05 - 2.1e-3  # N m left over at that level, and the slope of both
    assert float(told[1]) == pytest.approx(truth / torque, rel=0.01)
    assert float(told[2]) == pytest.approx(truth / torque * 0.05, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("ripple", ["0.0002", "0.0006"])
def test_what_only_the_ripple_of_a_constant_velocity_tells_is_not_good(cases, ripple):
    found = _identified(cases(f"constant-velocity-{ripple}", 12.0))
    assert found.velocity_fit.median < 50
    assert found.judged.level is not Level.GOOD


def test_a_motor_faster_than_its_clock_has_the_damping_known_and_its_inertia_about(cases):
    folder = cases("fast-motor")
    found = _identified(folder)
    true, estimate = _truth(folder), found.estimate
    assert found.judged.level.usable
    assert estimate.parameters.p2 == pytest.approx(true["p2"], rel=1e-3)
    # That integrator's own steps, of an eighth of the time constant, shorten it by 6 %.
    assert 0 < estimate.parameters.p1 == pytest.approx(true["p1"], rel=0.1)
    assert found.separated()["speed_gain"].value == pytest.approx(1 / true["p2"], rel=1e-3)


@pytest.mark.parametrize("ripple", ["0.0002", "0.0006"])
def test_where_ripple_outweighs_inertia_the_interval_holds_the_truth(cases, ripple):
    folder = cases(f"constant-velocity-{ripple}")
    estimate = WeakForm()(read_data_set(read_manifest(folder / "manifest.yaml")))
    k = estimate.names.index("p1")
    assert estimate.lower[k] < _truth(folder)["p1"] < estimate.upper[k]


@pytest.fixture
def strangers() -> Path:
    """The folder of other people's joints."""
    folder = _MAKE.parents[1] / "strangers"
    if not folder.is_dir():
        pytest.skip(f"the joints of others are not there: no folder {folder}")
    return folder


def test_a_bare_motor_has_its_speed_per_volt_though_not_its_inertia(strangers, tmp_path):
    names = [f"chirp{k}.csv" for k in range(1, 6)]
    for name in names:
        rows = np.genfromtxt(
            strangers / "odrive" / name, delimiter=",", comments="%", usecols=(0, 1, 2)
        )
        rows = rows[np.isfinite(rows).all(axis=1)]
        ahead = np.flatnonzero(np.diff(rows[:, 0]) < 0)  # zeros stand behind each recording
        rows = rows[: ahead[0] + 1 if ahead.size else None] * [1 / 8000, 1, 2 * np.pi]
        np.savetxt(tmp_path / name, rows, delimiter=",", header="time,input,angle", comments="")
    listed = "".join(f"  - {{file: {name}}}\n" for name in names)
    manifest = tmp_path / "manifest.yaml"
    manifest.write_text(
        f"name: bare\ninput: voltage\ngravity: 0\nknown: {{p4: 1}}\nlogs:\n{listed}"
    )
    data = read_data_set(read_manifest(manifest))
    estimate = WeakForm(terms=())(data)
    found = physical_parameters(estimate, data.known, data.input_kind, data.logs[0].added_mass)
    gain = found["speed_gain"]
    assert abs(gain.value - 117.5) < gain.half_width < 12  # of a fit to its steps, by others
    k = estimate.names.index("p1")
    assert estimate.lower[k] < 0 < estimate.upper[k]


def test_a_servo_that_the_model_does_not_follow_to_the_noise_is_not_good(strangers, tmp_path):
    write_servo(strangers / "xl330", tmp_path / "xl330")
    found = identify(read_data_set(read_manifest(tmp_path / "xl330/manifest.yaml")).take([0, 5]))
    assert found.judged.level is not Level.GOOD
    assert found.residuals.times > 2
    assert "bias" not in found.residuals.missing.terms
    assert min(found.fits.values()) > 50  # no log is given up for the sake of the others' weights


PENDULUM = {"p1": (0.1775, 0.0014), "p2": (0.0008, 0.0048), "p3": (3.517, 0.031)}
PENDULUM |= {"coulomb": (0.170, 0.015)}
"""Values and standard errors by SciPy's fit of the independent integrator to segments of 1 s, each
from a start of its own: it shared nothing with the program."""


def test_a_weight_on_a_rod_is_the_one_that_its_drawings_show(strangers, tmp_path):
    """Though not the one whose inertia and moment are published with its logs."""
    listed = "".join(
        f"  - {{file: {each}.csv}}\n" for each in ("ddp", "direct_collocation", "ilqr")
    )
    (tmp_path / "manifest.yaml").write_text(
        f"name: pendulum\nroot: {strangers / 'dfki'}\ninput: torque\nknown: {{p4: 1.0}}\n"
        f"columns: {{time: time, input: torque, angle: position}}\nlogs:\n{listed}"
    )
    found = _identified(tmp_path, PLAIN)
    rows = {row.name: row for row in found.estimate.table()}
    for name, (value, error) in PENDULUM.items():
        assert rows[name].lower - 2 * error <= value <= rows[name].upper + 2 * error, name
    p1, p3 = rows["p1"].value, rows["p3"].value
    # segments of .2 to 2 s give p1 of .1755 to .186, of which the interval tells
    assert (p1, p3) == pytest.approx((PENDULUM["p1"][0], PENDULUM["p3"][0]), rel=0.04)
    assert p3 / p1 == pytest.approx(9.81 / 0.5, rel=0.01)  # a weight at 0.5 m, as it is drawn
    assert found.fit.median > 98.0


def _film(data, noise: float = 0.0):
    """Return the slow film with more noise in rad."""
    (log,), rng = data.logs, np.random.default_rng(1)
    noisy = log.angle + noise * rng.standard_normal(log.angle.size)
    return replace(data, logs=(replace(log, angle=noisy),))


def _slow_film():
    told = {"input": "none", "columns": {"time": "t", "angle": "angle"}, "known": {"p1": 1.0}}
    return bf.read(_fifth("slow_noisy_film") / "swing.csv", **told)


def test_a_noisy_velocity_refuses_no_film_that_is_followed_to_its_noise():
    """Twenty seconds of a slow swing at ten frames a second, in windows of its own time."""
    found = identify(_slow_film(), WeakForm(half_width=2.0))
    (run,) = found.runs
    assert run.velocity_fit < 50
    assert run.followed > 80
    assert found.estimate.parameters.p3 == pytest.approx(0.49, rel=0.03)
    assert found.estimate.level.usable
    hidden = identify(_film(_slow_film(), 0.05))
    (run,) = hidden.runs
    assert run.velocity_fit < 50
    assert run.followed > 80
    assert hidden.estimate.level.usable


def test_a_slow_film_is_seen_in_windows_of_its_own_time():
    """Nor is its clock called wrong, though a swing takes nine seconds."""
    estimate = identify(_slow_film()).estimate
    _holds(estimate, {"p2": 0.168, "p3": 0.490})
    assert estimate.parameters.p3 == pytest.approx(0.490, rel=0.03)
    assert estimate.level is Level.GOOD


def test_a_run_of_half_a_second_is_answered_as_least_squares_on_its_rows():
    told = {"joint": "slide", "input": "torque", "known": {"p4": 1.0}}
    columns = {"time": "t", "input": "F", "velocity": "v"}
    data = bf.read(_fifth("short_run") / "push.csv", columns=columns, **told)
    estimate = identify(data).estimate
    _holds(estimate, {"p2": 40.0, "coulomb": 17.0})
    assert estimate.parameters.p1 == pytest.approx(24.0, rel=1e-3)
    assert estimate.level is Level.GOOD
    with pytest.raises(
        IdentifiabilityError, match=r"0\.54 s contain 3 windows of 0\.5 s"
    ) as refused:
        identify(data, WeakForm(half_width=0.25))
    assert "cannot be identified" not in str(refused.value)


def test_a_start_is_known_no_better_than_one_sample_and_costs_no_precision():
    estimate = _identified(_fifth("start_from_one_sample")).estimate
    true = {"p1": 0.00335562, "p2": 0.00092987, "p3": 0.10788159, "p4": 0.30839955}
    _holds(estimate, true | {"coulomb": 0.00097634, "delay": 2.979e-3})
    assert estimate.level is Level.GOOD
    assert estimate.relative_half_widths["p1"] < 6e-5
    explained = next(each for each in estimate.findings if each.kind is FindingKind.NO_MISFIT)
    assert explained.number < 1.1  # times the noise


def test_a_start_where_a_term_vanishes_is_no_end_and_the_input_goes_as_the_motion_says():
    """With held set-points the joint seems to have no friction, and no delay that is left."""
    estimate = _identified(_fifth("servo_stribeck_at_zero")).estimate
    _holds(estimate, {"p1": 0.05, "p2": 0.15, "coulomb": 0.35})
    assert "stribeck" not in estimate.names
    assert estimate.relative_half_widths["p1"] < 0.01
    kinds = {each.kind for each in estimate.findings}
    assert FindingKind.STRAIGHT in kinds
    assert FindingKind.POOR_FIT not in kinds


def test_where_few_terms_follow_no_log_the_choice_begins_anew_with_all():
    estimate = _identified(_fifth("balanced_with_bias")).estimate
    true = {"p1": 0.00279531, "p2": 0.00342083, "p3": 0.00104657, "p4": 0.04994313}
    _holds(estimate, true | {"coulomb": 0.00157214, "bias": -0.00021551, "delay": 3.99e-3})
    assert estimate.level is Level.GOOD
    assert estimate.relative_half_widths["p1"] < 2e-4


def test_friction_that_is_smooth_costs_no_long_trial():
    """Nor with held inputs, where a base explains the misfit, ever stiffer: no end is sought."""
    manifest = read_manifest(_fifth("smooth_friction") / "manifest.yaml")
    rng, smooth = np.random.default_rng(1), read_data_set(manifest)
    with counted() as search:
        found = identify(smooth)
    assert found.judged.level is Level.GOOD
    sharp = [
        replace(run.log, angle=run.simulated + 2e-5 * rng.standard_normal(run.log.time.size))
        for run in found.runs
    ]
    known = manifest.model_copy(update={"intersample": Intersample.ZERO_ORDER_HOLD})
    with counted() as quick:
        identify(DataSet.of(sharp, known=smooth.given))
    assert search.steps < 3 * quick.steps
    with counted() as held:
        estimate = identify(read_data_set(known)).estimate
    assert "base_compliance" not in estimate.names
    assert held.simulations < 40
