"""Methods and the options of all estimators.

Made by `make commands`: what is changed here is overwritten.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from cyclopts import Parameter

from butterfly.cli.options import FIT_IN_DETAIL, THE_FIT, FitOptions


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Tuning(FitOptions):
    """Options of estimators.

    Parameters
    ----------
    half_width
        Half width of the test functions in s; if not given, each log's own, from its duration, its
        period and its noise. Only for weak-form. Default: chosen from the data.
    cogging_periods
        Periods of the cogging torque per turn; must be known. Only for weak-form and output-error.
        Default: 1.0.
    fixed
        Parameters held at their initial values. Only for output-error. Default: none.
    per_mass
        Fitted separately for each added mass: zero (of the encoder), bias, velocity (initial). Only
        for output-error. Default: none.
    per_log
        Fitted separately for each log. Only for output-error. Default: none.
    window
        Length in s at the end of each sine log that is fitted, as a start from rest depends on how
        the joint came to rest. Only for output-error. Default: 30.0.
    horizon
        Longest segment in s that is simulated at once; 0 for whole logs. Only for output-error.
        Default: chosen from the data.
    loss
        Loss of the residuals: linear, or robust with soft_l1, huber or cauchy. Only for
        output-error. Default: linear.
    servo_loop
        How servo logs are simulated: closed, in the servo's loop from the set-point, or open, from
        the recorded or reconstructed drive alone. Only for output-error. Default: closed.
    workers
        Number of threads; 0 for one per core. Only for output-error. Default: 0.
    decimation
        Keep every n-th sample: 25 for Table 4, 5 for the input of Table 5. Only for thesis.
        Default: 25.
    """

    half_width: Annotated[
        float | None,
        Parameter(group=FIT_IN_DETAIL, metavar="s", show_default=False, show_choices=False),
    ] = None
    cogging_periods: Annotated[
        float | None,
        Parameter(group=FIT_IN_DETAIL, metavar="N", show_default=False, show_choices=False),
    ] = None
    fixed: Annotated[
        str | None,
        Parameter(group=FIT_IN_DETAIL, metavar="NAMES", show_default=False, show_choices=False),
    ] = None
    per_mass: Annotated[
        str | None,
        Parameter(group=FIT_IN_DETAIL, metavar="NAMES", show_default=False, show_choices=False),
    ] = None
    per_log: Annotated[
        str | None,
        Parameter(group=FIT_IN_DETAIL, metavar="NAMES", show_default=False, show_choices=False),
    ] = None
    window: Annotated[
        float | None,
        Parameter(group=FIT_IN_DETAIL, metavar="s", show_default=False, show_choices=False),
    ] = None
    horizon: Annotated[
        float | None,
        Parameter(group=FIT_IN_DETAIL, metavar="s", show_default=False, show_choices=False),
    ] = None
    loss: Annotated[
        Literal["linear", "soft_l1", "huber", "cauchy"] | None,
        Parameter(group=FIT_IN_DETAIL, show_default=False, show_choices=False),
    ] = None
    servo_loop: Annotated[
        Literal["closed", "open"] | None,
        Parameter(group=FIT_IN_DETAIL, show_default=False, show_choices=False),
    ] = None
    workers: Annotated[
        int | None,
        Parameter(group=FIT_IN_DETAIL, metavar="N", show_default=False, show_choices=False),
    ] = None
    decimation: Annotated[
        int | None,
        Parameter(group=FIT_IN_DETAIL, metavar="N", show_default=False, show_choices=False),
    ] = None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Terms(FitOptions):
    """Terms of the model.

    Parameters
    ----------
    terms
        Terms fitted besides p1..p4, coulomb and delay. Default: chosen by output-error, else none.
        Separated by commas, '' for none: drag, load, load_drag, mass_inertia, stribeck; 25 more,
        see docs/methods.md.
    """

    terms: Annotated[
        str | None,
        Parameter(group=THE_FIT, metavar="NAMES", show_default=False, show_choices=False),
    ] = None


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitOfOne(Tuning, Terms):
    """A method and its options.

    Parameters
    ----------
    method
        harmonic-balance: fast look at the steady responses to sines; linear: linear fit of the
        steady responses, small swings without friction; weak-form: linear fit against test
        functions, for any input; output-error: nonlinear fit of free-run simulations, for any
        input; thesis: the thesis's fit of resonances, including its mistakes; auto: the same as
        output-error.
    """

    method: Annotated[
        Literal["harmonic-balance", "linear", "weak-form", "output-error", "thesis", "auto"],
        Parameter(name=("--method", "-m"), group=THE_FIT, metavar="METHOD", show_choices=False),
    ] = "auto"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitOfTerms(Tuning):
    """The same, where terms are chosen.

    Parameters
    ----------
    method
        harmonic-balance: fast look at the steady responses to sines; linear: linear fit of the
        steady responses, small swings without friction; weak-form: linear fit against test
        functions, for any input; output-error: nonlinear fit of free-run simulations, for any
        input; thesis: the thesis's fit of resonances, including its mistakes; auto: the same as
        output-error.
    """

    method: Annotated[
        Literal["harmonic-balance", "linear", "weak-form", "output-error", "thesis", "auto"],
        Parameter(name=("--method", "-m"), group=THE_FIT, metavar="METHOD", show_choices=False),
    ] = "output-error"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FitOfSeveral(Tuning, Terms):
    """The same, or several methods.

    Parameters
    ----------
    method
        To rank several, separate them by commas. harmonic-balance: fast look at the steady
        responses to sines; linear: linear fit of the steady responses, small swings without
        friction; weak-form: linear fit against test functions, for any input; output-error:
        nonlinear fit of free-run simulations, for any input; thesis: the thesis's fit of
        resonances, including its mistakes; auto: the same as output-error.
    """

    method: Annotated[
        str, Parameter(name=("--method", "-m"), group=THE_FIT, metavar="METHOD", show_choices=False)
    ] = "auto"


FIT_OF_ONE = FitOfOne()
FIT_OF_TERMS = FitOfTerms()
FIT_OF_SEVERAL = FitOfSeveral()
