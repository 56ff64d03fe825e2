"""Commands made of verbs: options, defaults and help are said once, by signature and docstring.

A list is given with commas, an enumeration by its values; the word for a number is its unit. Help
is the sentences of the docstring that name nothing of Python in `backticks`; "As in `identify`" is
looked up there.
"""

from __future__ import annotations
import __future__

import ast
import builtins
import re
from collections import abc
from collections.abc import Callable, Collection, Sequence
from enum import Enum
from functools import partial
from inspect import BoundArguments, Signature, signature
from inspect import Parameter as Argument
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, cast, get_args, get_origin, get_type_hints

from cyclopts import Parameter
from docstring_parser import parse

import butterfly as bf
from butterfly.cli.options import (
    OUT,
    THE_DATA,
    WRITTEN,
    parse_floats,
    parse_names,
    parse_numbers,
    source_of,
)
from butterfly.cli.output import ExitCode, show_progress
from butterfly.cli.written import FOLDER

Ask: TypeAlias = partial[Any]
"""A verb with the values of its options, its ``keywords``; a call of it may replace some."""

_UNSAID = {"method", "track", "overwrite"}
"""Parameters of verbs that are no options here: see `_fit`; a bar; an option of all commands."""

_DECLARED: dict[str, tuple[object, ...]] = {
    "source": (Parameter(name="DATA"),),
    "logs": (Parameter(name="--log"),),
    "holdout": (Parameter(group=THE_DATA),),
    "out": (OUT, FOLDER),
    "figures": (Parameter(group=WRITTEN),),
    "only": (Parameter(metavar="NUMBERS"),),
    "scheduler": (Parameter(metavar="ADDRESS"),),
}
"""What is declared of an option besides its type, default and help."""

_LISTS: dict[Any, tuple[str, Callable[[Any], Any]]] = {
    Sequence[str]: ("NAMES", parse_names),
    Collection[str]: ("NAMES", parse_names),
    Sequence[int] | None: ("NUMBERS", parse_numbers),
    Sequence[float] | None: ("NUMBERS", parse_floats),
}
_UNIT = re.compile(r" in (rad|kg|m|s)\b")
_OF_PYTHON = re.compile(r"(?<!`)`[\w.]+`(?!`)")
_AS_IN = re.compile(r"As in `(\w+)`")


def verb_named(name: str) -> Callable[..., Any]:
    """Return a verb, or without a slow import its signature and docstring, types as paths."""
    source = ast.parse(source_of(name)).body
    (verb,) = [each for each in source if isinstance(each, ast.FunctionDef) and each.name == name]
    if "method" in {each.arg for each in ast.walk(verb.args) if isinstance(each, ast.arg)}:
        return cast(Callable[..., Any], getattr(bf, name))
    defaults = {each.id for each in verb.args.kw_defaults if isinstance(each, ast.Name)}
    imports = [each for each in source if isinstance(each, ast.ImportFrom)]
    imports = [each for each in imports if defaults & {one.name for one in each.names}]
    verb.body, verb.returns, verb.decorator_list = verb.body[:1], None, []
    types = {each.id for each in ast.walk(verb.args) if isinstance(each, ast.Name)}
    space: dict[str, Any] = dict.fromkeys(types - vars(builtins).keys(), PathLike[str])
    space |= {**vars(abc), "Any": Any, "Literal": Literal}
    flags = __future__.annotations.compiler_flag
    exec(compile(ast.Module([*imports, verb], []), name, "exec", flags), space)  # noqa: S102 - our own source
    return cast(Callable[..., Any], space[name])


def command(
    verb: Callable[..., Any], own: Callable[..., ExitCode], without: Collection[str] = ()
) -> Callable[..., ExitCode]:
    """Return the command of a verb: it calls ``own`` with an `Ask`, to show the answer.

    What else ``own`` takes are options that only the command has, or in place of the verb's; where
    it has a docstring, that is the command's. Options that it is ``without`` are left out.
    """
    of_verb, hints = signature(verb).parameters, get_type_hints(verb)
    said = texts_of(verb) | texts_of(own)
    options = {
        name: _option(each.replace(annotation=hints[name]), said.get(name, ""))
        for name, each in of_verb.items()
        if each.kind is not Argument.VAR_KEYWORD and name not in {*_UNSAID, *without}
    }
    _, *others = signature(own, eval_str=True).parameters.values()
    for each in others:
        hint = each.annotation
        if each.name in said and not any(getattr(part, "help", "") for part in get_args(hint)):
            more = " Repeatable." if get_origin(hint) is tuple else ""
            hint = Annotated[(hint, Parameter(help=said[each.name] + more))]
        options[each.name] = each.replace(annotation=hint)
    if "method" in of_verb:
        options["fit"] = _fit(hints["method"], of_verb["method"].default, without)
    whole = Signature(sorted(options.values(), key=lambda each: each.kind))

    def call(*given: Any, **named: Any) -> ExitCode:  # noqa: ANN401 - values of its options
        bound = whole.bind(*given, **named)
        bound.apply_defaults()
        values = bound.arguments
        mine = {each.name: values[each.name] for each in others}
        keywords = {name: values[name] for name in of_verb if name in options}
        for name in keywords.keys() - mine.keys():
            if hints[name] in _LISTS:
                keywords[name] = _LISTS[hints[name]][1](keywords[name])
        if "method" in of_verb:
            keywords |= values["fit"].keywords()
        if "track" in of_verb:
            keywords["track"] = show_progress
        asked = partial(getattr(bf, verb.__name__), **keywords)
        passed = BoundArguments(signature(own), {"ask": asked, **mine})
        return own(*passed.args, **passed.kwargs)

    call.__doc__ = description_of(own) or description_of(verb)
    call.__module__, call.__dict__["__signature__"] = own.__module__, whole
    call.__annotations__ = {each.name: each.annotation for each in options.values()}
    return call


def texts_of(function: Callable[..., Any]) -> dict[str, str]:
    """Return what a docstring says of each parameter, without what is said of Python alone."""
    texts: dict[str, str] = {}
    for each in parse(function.__doc__ or "").params:
        whole = " ".join((each.description or "").split())
        like = _AS_IN.match(whole)
        there = texts_of(getattr(bf, like[1])) if like else {}
        plain = _without_python(whole)
        texts |= {name: there.get(name, plain) for name in each.arg_name.split(", ")}
    return texts


def description_of(function: Callable[..., Any]) -> str:
    """Return what a docstring says before its parameters, without what is said of Python alone."""
    said = parse(function.__doc__ or "")
    long = _without_python(" ".join((said.long_description or "").split()))
    return "\n\n".join(filter(None, (said.short_description, long)))


def _without_python(text: str) -> str:
    sentences = re.split(r"(?<=[.]) (?=[A-Z])", text)
    return " ".join(each for each in sentences if not _OF_PYTHON.search(each)).replace("``", "")


def _option(option: Argument, text: str) -> Argument:
    """Return a verb's parameter as an argument or option of its command."""
    hint, default, word = option.annotation, option.default, None
    kind = Argument.POSITIONAL_ONLY if default is Argument.empty else Argument.KEYWORD_ONLY
    if default is Argument.empty:
        hint = Path
    elif isinstance(default, Enum):
        hint, default = Literal[tuple(each.value for each in type(default))], default.value
    elif hint in _LISTS:
        hint, default, word = str | None, ",".join(default or ()) or None, _LISTS[hint][0]
        said, *rest = text.partition(" Default:")
        text = "".join([said, " Separated by commas.", *rest])
    elif PathLike[str] in get_args(hint):
        hint = Path | None
    elif int in {hint, *get_args(hint)}:
        word = "N"
    elif unit := _UNIT.search(text):
        word = unit[1]
    about = Parameter(help=text, metavar=word), *_DECLARED.get(option.name, ())
    return Argument(option.name, kind, default=default, annotation=Annotated[(hint, *about)])


def _fit(hint: Any, default: str | None, without: Collection[str]) -> Argument:  # noqa: ANN401
    """Return the option of a method, of several if the verb takes them, and their own options."""
    from butterfly.cli.estimator_options import fit_options  # noqa: PLC0415 - slow to import

    several = any(get_origin(each) is Sequence for each in get_args(hint))
    kind = fit_options(default, tuple(without), several=several)
    return Argument("fit", Argument.KEYWORD_ONLY, default=kind(), annotation=kind)
