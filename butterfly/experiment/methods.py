"""All estimators by the names of their methods, and the options that each has."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields

from butterfly.errors import InputError, nearest
from butterfly.identification.estimators import Estimator, HarmonicBalance, Suitable
from butterfly.thesis.method import Thesis  # noqa: F401 - its being read makes it one of them

ESTIMATORS: dict[str, type[Estimator]] = {each.method: each for each in Estimator.__subclasses__()}
"""All estimators by the name of their method."""

DEFAULT_METHOD = Suitable.method
"""The estimator of logs where none is named."""

DEFAULT_OF_EXPERIMENTS = HarmonicBalance.method
"""The estimator of an experiment that names none."""


def options_of(kind: type[Estimator]) -> list[str]:
    """Return the names of an estimator's options."""
    return [each.name for each in fields(kind) if each.name != "method"]


def kind_of(
    method: str, told: Iterable[str] = (), *, written: Callable[[str], str] = str
) -> type[Estimator]:
    """Return the estimator of a name, and refuse options that are not its own.

    Parameters
    ----------
    method
        Its name.
    told
        Names of options that it was told.
    written
        How the name of an option is written where the user wrote it.

    Raises
    ------
    InputError
        Naming the methods that there are, or the options that it has.
    """
    if method not in ESTIMATORS:
        raise InputError("estimator", written("method"), method, nearest(method, ESTIMATORS))
    kind = ESTIMATORS[method]
    own = [written(name) for name in options_of(kind)]
    for name in map(written, told):
        if name not in own:
            expected = nearest(name, own) if own else "no option"
            raise InputError(
                f"{written('method')} {method}", name, "an option it has not", expected
            )
    return kind
