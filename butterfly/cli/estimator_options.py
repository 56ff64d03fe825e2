"""The estimators' options on the command line."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, make_dataclass
from enum import Enum
from functools import cache
from typing import Annotated, Any, Literal, get_type_hints

from cyclopts import Parameter
from docstring_parser import parse

from butterfly.cli.options import FIT_IN_DETAIL, THE_FIT, parse_names
from butterfly.experiment.methods import ESTIMATORS, METHODS, kind_of, make_estimator, options_of
from butterfly.identification.estimators import DEFAULT_METHOD, Estimator
from butterfly.model.terms import offered

_FEW = 2  # methods that are named beside an option of theirs
_WORDS = {
    **dict.fromkeys(("terms", "fixed", "per_mass", "per_log"), "NAMES"),
    **dict.fromkeys(("cogging_periods", "decimation", "workers"), "N"),
    **dict.fromkeys(("half_width", "horizon", "window"), "s"),
}


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """A method and its options."""

    method: str = DEFAULT_METHOD

    @property
    def given(self) -> dict[str, Any]:
        """The given options, with lists of names split at commas."""
        values = {option.name: getattr(self, option.name) for option in fields(self)[1:]}
        return {
            name: parse_names(value.replace(" ", "")) if _WORDS.get(name) == "NAMES" else value
            for name, value in values.items()
            if value is not None
        }

    def estimator(self) -> Estimator:
        """Return the estimator; an unknown option raises InputError, which lists the known ones."""
        kind_of(self.method, self.given, written=lambda name: f"--{name.replace('_', '-')}")
        return make_estimator(self.method, self.given)

    def keywords(self) -> dict[str, Any]:
        """Return the given method and options, checked, as a verb takes them."""
        several = parse_names(self.method)
        if len(several) > 1:
            return {"method": several, **self.given}
        self.estimator()
        default = self.method == type(self)().method
        return self.given if default else {"method": self.method, **self.given}


@cache
def fit_options(
    default: str | None = None, without: tuple[str, ...] = (), *, several: bool = False
) -> type[FitOptions]:
    """Return a dataclass of the options of all estimators, ``without`` some, and of a method."""
    listing = "; ".join(
        f"{method}: {estimator.summary}" for method, estimator in ESTIMATORS.items()
    )
    listing += f"; {DEFAULT_METHOD}: the same as {kind_of(DEFAULT_METHOD).method}"
    rank = "To rank several, separate them by commas. " if several else ""
    names = Parameter(
        name=("--method", "-m"),
        group=THE_FIT,
        help=f"{rank}{listing}.",
        metavar="METHOD",
        show_choices=False,
    )
    kind: Any = str if several else Literal[METHODS]
    method = ("method", Annotated[kind, names], field(default=default or DEFAULT_METHOD))
    owners: dict[str, list[str]] = {}
    for name, estimator in ESTIMATORS.items():
        for option in options_of(estimator):
            owners.setdefault(option, []).append(name)
    options = [
        _option(option, methods) for option, methods in owners.items() if option not in without
    ]
    made = make_dataclass(
        "Fit",
        [method, *options],
        bases=(FitOptions,),
        namespace={"__module__": __name__},  # of a module of Python's own, cyclopts shows no fields
        frozen=True,
        kw_only=True,
    )
    return Parameter(name="*")(made)


def _option(name: str, owners: list[str]) -> tuple[str, Any, None]:
    kind = ESTIMATORS[owners[0]]
    (described,) = [
        parameter for parameter in parse(kind.__doc__ or "").params if parameter.arg_name == name
    ]
    text, _, _ = " ".join((described.description or "").split()).partition(". ")
    text = text.rstrip(".") + "."
    if len(owners) <= _FEW:
        text += f" Only for {' and '.join(owners)}."
    if name == "terms":
        text += f" Separated by commas, '' for none: {_offers(owners)}."
    else:
        text += f" Default: {_default_text(name, owners)}."
    declared = Parameter(
        help=text,
        group=THE_FIT if name == "terms" else FIT_IN_DETAIL,
        metavar=_WORDS.get(name),
        show_default=False,
        show_choices=False,
    )
    hint = get_type_hints(kind)[name]
    if isinstance(hint, type) and issubclass(hint, Enum):
        hint = Literal[tuple(member.value for member in hint)]
    elif _WORDS.get(name) == "NAMES":
        hint = str
    return name, Annotated[hint | None, declared], None


def _offers(methods: list[str]) -> str:
    """List the terms that all methods offer, and count the others."""
    offers = [set(offered(method)) for method in methods if offered(method)]
    shared, some = set.intersection(*offers), set.union(*offers)
    names = [name for name in offered(methods[0]) if name in shared]
    return f"{', '.join(names)}; {len(some - shared)} more, see docs/methods.md"


def _default_text(name: str, owners: list[str]) -> str:
    """Return the default, of each estimator if they differ."""
    defaults = {}
    for method in owners:
        value = getattr(ESTIMATORS[method], name)  # a field's default is an attribute of the class
        if isinstance(value, tuple):
            value = ",".join(value) or "none"
        defaults[method] = "chosen from the data" if value is None else str(value)
    if len(set(defaults.values())) == 1:
        return next(iter(defaults.values()))
    return "; ".join(f"{method}: {value}" for method, value in defaults.items())
