"""Options and texts of commands, derived from the verbs: `make commands` writes them to modules.

What an option is called, its type, its default and its help are said once, by the signature and
the docstring of a verb or of an estimator. A list is given with commas, an enumeration by its
values; the word for a number is its unit. Help is the sentences of the docstring that name nothing
of Python in `backticks`; "As in `identify`" is looked up there.
"""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from inspect import Parameter as Argument
from inspect import signature
from os import PathLike
from pathlib import Path
from typing import Any, get_args, get_type_hints

from docstring_parser import parse

import butterfly as bf
from butterfly.cli.options import NAMES_OF_FIT
from butterfly.experiment.methods import ESTIMATORS, METHODS, kind_of, options_of
from butterfly.identification.estimators import DEFAULT_METHOD
from butterfly.logs.manifest import LogEntry, Manifest
from butterfly.model.terms import offered


@dataclass(frozen=True)
class _Verb:
    """Parameters of a verb that are no options here, and whose text its command has."""

    by_command: tuple[str, ...]  # declared by the command, with the verb's text
    without: tuple[str, ...] = ()
    described: bool = True  # by the verb, not by the docstring of the command's function


_VERBS = {
    "inspect": _Verb(("source",), without=("hand_mass",)),
    "identify": _Verb(("data", "against")),
    "select": _Verb(("data",)),
    "design": _Verb(("data",)),
    "validate": _Verb(("data",), without=("others",)),
    "residual": _Verb(("data",)),
    "predict": _Verb(("data", "result"), without=("bands",)),
    "compare": _Verb((), without=("data", "hand_mass"), described=False),
    "run": _Verb(("experiment",), described=False),
    "simulate": _Verb(("experiment", "out")),
    "campaign": _Verb(("robot",), without=("callbacks", "change", "known", "pose", "step")),
}
_UNSAID = {"method", "track", "overwrite"}
"""Parameters of verbs that are no options here: one of a fit; a bar; an option of all commands."""

_DECLARED = {
    "logs": 'name="--log"',
    "holdout": "group=THE_DATA",
    "figures": "group=WRITTEN",
    "only": 'metavar="NUMBERS"',
    "goal": 'metavar="SHARE"',
    "command": 'metavar="VALUE"',
    "scheduler": 'metavar="ADDRESS"',
}
"""What is declared of an option besides its type, default and help."""

_LISTS: dict[object, tuple[str, str, str]] = {
    Sequence[str]: ("Sequence[str]", "NAMES", "parse_names"),
    Collection[str]: ("Sequence[str]", "NAMES", "parse_names"),
    Sequence[int] | None: ("Sequence[int] | None", "NUMBERS", "parse_numbers"),
    Sequence[float] | None: ("Sequence[float] | None", "NUMBERS", "parse_floats"),
}
"""Lists: their type, the word for them, and what reads them."""

_WORDS = {
    **dict.fromkeys(NAMES_OF_FIT, "NAMES"),
    **dict.fromkeys(("cogging_periods", "decimation", "workers"), "N"),
    **dict.fromkeys(("half_width", "horizon", "window"), "s"),
}
"""Words for the values of estimators' options."""

_FEW = 2  # methods that are named beside an option of theirs
_UNIT = re.compile(r" in (rad/s|rad|kg|m|s|A)\b")
_OF_PYTHON = re.compile(r"(?<!`)`[\w.]+`(?!`)")
_AS_IN = re.compile(r"As in `(\w+)`")
_MADE = "Made by `make commands`: what is changed here is overwritten."


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


def texts_module() -> str:
    """Return the source of `command_texts`."""
    from butterfly.cli.app import COMMANDS  # noqa: PLC0415 - made of the other modules

    verbs = {name: getattr(bf, name) for name in _VERBS}
    descriptions = {
        name: description_of(verb) for name, verb in verbs.items() if _VERBS[name].described
    }
    summaries = {
        words: descriptions.get(words, description_of(command.functions()[words])).split("\n")[0]
        for words, command in COMMANDS.items()
    }
    arguments = {
        f"{name}.{argument}": texts_of(verb)[argument]
        for name, verb in verbs.items()
        for argument in _VERBS[name].by_command
    }
    fields = LogEntry.model_fields | Manifest.model_fields
    facts = {
        name: " ".join(field.description.replace("``", "").split()).partition(". ")[0].rstrip(".")
        for name, field in fields.items()
        if field.description
    }
    tables = (
        ("SUMMARIES", summaries, "First lines of commands."),
        ("DESCRIPTIONS", descriptions, "What verbs say before their parameters."),
        ("ARGUMENTS", arguments, "What verbs say of parameters that their commands declare."),
        ("FACTS", facts, "First sentences on the fields of a manifest."),
    )
    return "\n".join(
        [f'"""Texts of commands, by their names.\n\n{_MADE}\n"""\n']
        + [f'{name} = {_mapping(texts)}\n"""{about}"""\n' for name, texts, about in tables]
    )


def verbs_module() -> str:
    """Return the source of `verb_options`."""
    imports = """
        from __future__ import annotations

        from collections.abc import Sequence
        from dataclasses import dataclass
        from pathlib import Path
        from typing import Annotated, Literal, TypedDict

        from cyclopts import Parameter

        from butterfly.cli.options import (
            OUT, THE_DATA, WRITTEN, parse_floats, parse_names, parse_numbers
        )
        from butterfly.cli.output import FOLDER
    """
    options = {name: _options_of_verb(name) for name in _VERBS}
    classes = [_class_of_verb(*entry) for entry in options.items() if entry[1]]
    head = f'"""Options of the verbs, as their commands take them.\n\n{_MADE}\n"""\n'
    return "\n".join([head, textwrap.dedent(imports), *classes])


def fits_module() -> str:
    """Return the source of `estimator_options`."""
    imports = """
        from __future__ import annotations

        from dataclasses import dataclass
        from typing import Annotated, Literal

        from cyclopts import Parameter

        from butterfly.cli.options import FIT_IN_DETAIL, THE_FIT, FitOptions
    """
    owners: dict[str, list[str]] = {}
    for method, estimator in ESTIMATORS.items():
        for option in options_of(estimator):
            owners.setdefault(option, []).append(method)
    options = {name: _option_of_fit(name, methods) for name, methods in owners.items()}
    terms = options.pop("terms")
    one, several = _method(DEFAULT_METHOD), _method(DEFAULT_METHOD, several=True)
    chosen = _method(str(signature(bf.select).parameters["method"].default))
    return "\n".join(
        [
            f'"""Methods and the options of all estimators.\n\n{_MADE}\n"""\n',
            textwrap.dedent(imports),
            _class("Tuning", "FitOptions", "Options of estimators.", [*options.values()]),
            _class("Terms", "FitOptions", "Terms of the model.", [terms]),
            _class("FitOfOne", "Tuning, Terms", "A method and its options.", [one]),
            _class("FitOfTerms", "Tuning", "The same, where terms are chosen.", [chosen]),
            _class("FitOfSeveral", "Tuning, Terms", "The same, or several methods.", [several]),
            *(f"{name} = {kind}()" for name, kind in _CONSTANTS.items()),
        ]
    )


_CONSTANTS = {
    "FIT_OF_ONE": "FitOfOne",
    "FIT_OF_TERMS": "FitOfTerms",
    "FIT_OF_SEVERAL": "FitOfSeveral",
}


@dataclass(frozen=True)
class _Option:
    """The source of an option, and of what a verb is given for it."""

    name: str
    hint: str
    default: object
    text: str
    declared: tuple[str, ...]  # arguments of its `Parameter`
    more: tuple[str, ...] = ()  # after that, in its `Annotated`
    value: str = ""
    taken: str = ""  # type of that value

    @property
    def field(self) -> str:
        """The field of a dataclass."""
        about = [f"Parameter({', '.join(self.declared)})"] if self.declared else []
        parts = [self.hint, *about, *self.more]
        hint = f"Annotated[{', '.join(parts)}]" if len(parts) > 1 else self.hint
        return f"{self.name}: {hint} = {_text(self.default)}"


def _options_of_verb(name: str) -> list[_Option]:
    verb, omitted = getattr(bf, name), {*_UNSAID, *_VERBS[name].without, *_VERBS[name].by_command}
    texts, hints = texts_of(verb), get_type_hints(verb)
    return [
        _option(argument.replace(annotation=hints[argument.name]), texts[argument.name])
        for argument in signature(verb).parameters.values()
        if argument.kind is not Argument.VAR_KEYWORD and argument.name not in omitted
    ]


def _option(argument: Argument, text: str) -> _Option:
    """Return a verb's parameter as an option of its command."""
    name, hint, default = argument.name, argument.annotation, argument.default
    source, value, taken, word = _hint(hint), f"self.{name}", "", None
    if isinstance(default, Enum):
        source = _hint_of_values(type(default))
        default, taken = default.value, "str"
    elif hint in _LISTS:
        taken, word, reader = _LISTS[hint]
        source, value, default = "str | None", f"{reader}({value})", ",".join(default or ()) or None
        description, *rest = text.partition(" Default:")
        text = "".join([description, " Separated by commas.", *rest])
    elif PathLike[str] in get_args(hint):
        source = "Path | None"
    elif int in {hint, *get_args(hint)}:
        word = "N"
    elif unit := _UNIT.search(text):
        word = unit[1]
    declared = [f'metavar="{word}"'] if word else []
    if name in _DECLARED:
        declared.append(_DECLARED[name])
    more = ("OUT", "FOLDER") if name == "out" else ()
    return _Option(name, source, default, text, tuple(declared), more, value, taken or source)


def _option_of_fit(name: str, methods: Sequence[str]) -> _Option:
    """Return an option of estimators, of some of the methods."""
    kind = ESTIMATORS[methods[0]]
    (described,) = [
        parameter for parameter in parse(kind.__doc__ or "").params if parameter.arg_name == name
    ]
    text, _, _ = " ".join((described.description or "").split()).partition(". ")
    text = text.rstrip(".") + "."
    if len(methods) <= _FEW:
        text += f" Only for {' and '.join(methods)}."
    if name == "terms":
        chooses = kind_of(DEFAULT_METHOD).method
        chosen = f"chosen by {chooses}, else none" if chooses in methods else "none"
        text += f" Default: {chosen}. Separated by commas, '' for none: {_offers(methods)}."
    else:
        text += f" Default: {_default_text(name, methods)}."
    hint = get_type_hints(kind)[name]
    if name in NAMES_OF_FIT:
        source = "str"
    elif isinstance(hint, type) and issubclass(hint, Enum):
        source = _hint_of_values(hint)
    else:
        source = _hint(hint)
    word = [f'metavar="{_WORDS[name]}"'] if name in _WORDS else []
    group = "THE_FIT" if name == "terms" else "FIT_IN_DETAIL"
    declared = (f"group={group}", *word, "show_default=False", "show_choices=False")
    return _Option(name, source.removesuffix(" | None") + " | None", None, text, declared)


def _method(default: str, *, several: bool = False) -> _Option:
    """Return the option of a method, or of several."""
    listing = "; ".join(f"{method}: {kind.summary}" for method, kind in ESTIMATORS.items())
    listing += f"; {DEFAULT_METHOD}: the same as {kind_of(DEFAULT_METHOD).method}"
    rank = "To rank several, separate them by commas. " if several else ""
    declared = ('name=("--method", "-m")', "group=THE_FIT", 'metavar="METHOD"')
    kind = "str" if several else f"Literal[{', '.join(map(_text, METHODS))}]"
    return _Option("method", kind, default, f"{rank}{listing}.", (*declared, "show_choices=False"))


def _offers(methods: Sequence[str]) -> str:
    """List the terms that all methods offer, and count the others."""
    offers = [set(offered(method)) for method in methods if offered(method)]
    shared, some = set.intersection(*offers), set.union(*offers)
    names = [name for name in offered(methods[0]) if name in shared]
    return f"{', '.join(names)}; {len(some - shared)} more, see docs/methods.md"


def _default_text(name: str, methods: Sequence[str]) -> str:
    """Return the default, of each estimator if they differ."""
    defaults = {}
    for method in methods:
        value = getattr(ESTIMATORS[method], name)  # a field's default is an attribute of the class
        if isinstance(value, tuple):
            value = ",".join(value) or "none"
        defaults[method] = "chosen from the data" if value is None else str(value)
    if len(set(defaults.values())) == 1:
        return next(iter(defaults.values()))
    return "; ".join(f"{method}: {value}" for method, value in defaults.items())


def _class_of_verb(name: str, options: Sequence[_Option]) -> str:
    """Return the source of a verb's options, of what the verb takes, and of those not given."""
    title = name.capitalize()
    taken = "\n".join(f"    {option.name}: {option.taken}" for option in options)
    values = ", ".join(f'"{option.name}": {option.value}' for option in options)
    return "\n".join(
        [
            f"class {title}Keywords(TypedDict):",
            f'    """Keywords of `butterfly.{name}`."""\n',
            f"{taken}\n",
            _class(f"OptionsOf{title}", "", f"Options of `butterfly {name}`.", options),
            f"    def keywords(self) -> {title}Keywords:",
            f'        """Return them as `butterfly.{name}` takes them."""',
            f"        return {{{values}}}\n",
            f"{name.upper()} = OptionsOf{title}()\n",
        ]
    )


def _class(name: str, base: str, about: str, options: Collection[_Option]) -> str:
    """Return the source of a dataclass of options, whose docstring is their help."""
    head = f"class {name}({base}):" if base else f"class {name}:"
    texts = "\n".join(
        textwrap.indent(
            f"{option.name}\n{textwrap.indent(_wrapped(option.text), ' ' * 4)}", " " * 4
        )
        for option in options
    )
    fields = "\n".join(f"    {option.field}" for option in options)
    return (
        f'@Parameter(name="*")\n@dataclass(frozen=True, kw_only=True)\n{head}\n'
        f'    """{about}\n\n    Parameters\n    ----------\n{texts}\n    """\n\n{fields}\n'
    )


def _wrapped(text: str) -> str:
    """Return a text in the lines of a docstring of a parameter."""
    return textwrap.fill(text, 92, break_long_words=False, break_on_hyphens=False)


def _without_python(text: str) -> str:
    sentences = re.split(r"(?<=[.]) (?=[A-Z])", text)
    return " ".join(part for part in sentences if not _OF_PYTHON.search(part)).replace("``", "")


def _hint(hint: object) -> str:
    """Return the source of a type."""
    name = hint.__name__ if isinstance(hint, type) else str(hint)
    return name.replace("typing.", "").replace("'", '"')


def _hint_of_values(kind: type[Enum]) -> str:
    return f"Literal[{', '.join(_text(member.value) for member in kind)}]"


def _mapping(texts: Mapping[str, str]) -> str:
    entries = "".join(f'    "{name}": {_text(text)},\n' for name, text in texts.items())
    return f"{{\n{entries}}}"


def _text(value: object) -> str:
    """Return the source of a value, a long text in several lines."""
    if not isinstance(value, str):
        return repr(value)
    lines = re.findall(r"(?s).{1,80}(?:\s|$)|\S+", value) or [""]
    quoted = [json.dumps(line, ensure_ascii=False) for line in lines]
    return quoted[0] if len(quoted) == 1 else f"({' '.join(quoted)})"


MODULES = {
    "estimator_options.py": fits_module,
    "verb_options.py": verbs_module,
    "command_texts.py": texts_module,
}
"""The modules that are made, the last of functions that need the others."""


def main() -> None:
    """Write the modules."""
    for name, made in MODULES.items():
        Path(__file__).with_name(name).write_text(made(), encoding="utf-8")


if __name__ == "__main__":
    main()
