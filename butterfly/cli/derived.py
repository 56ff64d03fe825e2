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
    (verb,) = [node for node in source if isinstance(node, ast.FunctionDef) and node.name == name]
    if "method" in {node.arg for node in ast.walk(verb.args) if isinstance(node, ast.arg)}:
        return cast(Callable[..., Any], getattr(bf, name))
    defaults = {default.id for default in verb.args.kw_defaults if isinstance(default, ast.Name)}
    values = [node for node in source if isinstance(node, ast.Assign)]
    values = [node for node in values if defaults & {ast.unparse(one) for one in node.targets}]
    verb.body, verb.returns, verb.decorator_list = verb.body[:1], None, []
    types = {node.id for node in ast.walk(verb.args) if isinstance(node, ast.Name)}
    space: dict[str, Any] = dict.fromkeys(types - vars(builtins).keys(), PathLike[str])
    space |= {**vars(abc), "Any": Any, "Literal": Literal}
    flags = __future__.annotations.compiler_flag
    exec(compile(ast.Module([*values, verb], []), name, "exec", flags), space)  # noqa: S102 - our own source
    return cast(Callable[..., Any], space[name])


def command(
    verb: Callable[..., Any], handler: Callable[..., ExitCode], without: Collection[str] = ()
) -> Callable[..., ExitCode]:
    """Return the command of a verb: it calls ``handler`` with an `Ask`, to show the answer.

    What else ``handler`` takes are options that only the command has, or in place of the verb's;
    where it has a docstring, that is the command's. Options that it is ``without`` are left out.
    """
    of_verb, hints = signature(verb).parameters, get_type_hints(verb)
    texts = texts_of(verb) | texts_of(handler)
    options = {
        name: _option(argument.replace(annotation=hints[name]), texts.get(name, ""))
        for name, argument in of_verb.items()
        if argument.kind is not Argument.VAR_KEYWORD and name not in {*_UNSAID, *without}
    }
    _, *others = signature(handler, eval_str=True).parameters.values()
    for argument in others:
        hint = argument.annotation
        if argument.name in texts and not any(getattr(part, "help", "") for part in get_args(hint)):
            more = " Repeatable." if get_origin(hint) is tuple else ""
            hint = Annotated[(hint, Parameter(help=texts[argument.name] + more))]
        options[argument.name] = argument.replace(annotation=hint)
    if "method" in of_verb:
        options["fit"] = _fit(hints["method"], of_verb["method"].default, without)
    whole = Signature(sorted(options.values(), key=lambda option: option.kind))

    def call(*given: Any, **named: Any) -> ExitCode:  # noqa: ANN401 - values of its options
        bound = whole.bind(*given, **named)
        bound.apply_defaults()
        values = bound.arguments
        mine = {argument.name: values[argument.name] for argument in others}
        keywords = {name: values[name] for name in of_verb if name in options}
        for name in keywords.keys() - mine.keys():
            if hints[name] in _LISTS:
                keywords[name] = _LISTS[hints[name]][1](keywords[name])
        if "method" in of_verb:
            keywords |= values["fit"].keywords()
        if "track" in of_verb:
            keywords["track"] = show_progress
        asked = partial(getattr(bf, verb.__name__), **keywords)
        passed = BoundArguments(signature(handler), {"ask": asked, **mine})
        return handler(*passed.args, **passed.kwargs)

    call.__doc__ = description_of(handler) or description_of(verb)
    call.__module__, call.__dict__["__signature__"] = handler.__module__, whole
    call.__annotations__ = {option.name: option.annotation for option in options.values()}
    return call


def texts_of(function: Callable[..., Any]) -> dict[str, str]:
    """Return what a docstring says of each parameter, without what is said of Python alone."""
    texts: dict[str, str] = {}
    for parameter in parse(function.__doc__ or "").params:
        whole = " ".join((parameter.description or "").split())
        like = _AS_IN.match(whole)
        there = texts_of(getattr(bf, like[1])) if like else {}
        plain = _without_python(whole)
        texts |= {name: there.get(name, plain) for name in parameter.arg_name.split(", ")}
    return texts


def description_of(function: Callable[..., Any]) -> str:
    """Return what a docstring says before its parameters, without what is said of Python alone."""
    docstring = parse(function.__doc__ or "")
    long = _without_python(" ".join((docstring.long_description or "").split()))
    return "\n\n".join(filter(None, (docstring.short_description, long)))


def _without_python(text: str) -> str:
    sentences = re.split(r"(?<=[.]) (?=[A-Z])", text)
    return " ".join(part for part in sentences if not _OF_PYTHON.search(part)).replace("``", "")


def _option(option: Argument, text: str) -> Argument:
    """Return a verb's parameter as an argument or option of its command."""
    hint, default, word = option.annotation, option.default, None
    kind = Argument.POSITIONAL_ONLY if default is Argument.empty else Argument.KEYWORD_ONLY
    if default is Argument.empty:
        hint = Path
    elif isinstance(default, Enum):
        hint, default = Literal[tuple(member.value for member in type(default))], default.value
    elif hint in _LISTS:
        hint, default, word = str | None, ",".join(default or ()) or None, _LISTS[hint][0]
        description, *rest = text.partition(" Default:")
        text = "".join([description, " Separated by commas.", *rest])
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

    several = any(get_origin(alternative) is Sequence for alternative in get_args(hint))
    kind = fit_options(default, tuple(without), several=several)
    return Argument("fit", Argument.KEYWORD_ONLY, default=kind(), annotation=kind)
