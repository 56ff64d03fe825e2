"""How help shows options: in groups, each with a short word or the unit of its value.

One name means one thing in all commands, and so do its group, its word and its short form here.
"""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

from butterfly.errors import InputError

_GROUPS = {
    "The fit": ("method", "terms", "loss", "check"),
    "The fit in detail": (
        *("fixed", "per_mass", "per_log", "window", "horizon", "half_width", "cogging_periods"),
        *("decimation", "workers"),
    ),
    "The data": (
        *("root", "arm", "input_kind", "intersample", "columns", "units", "repair", "known"),
        *("zero", "joint", "gravity", "begin", "end", "restarts", "holdout"),
    ),
    "What is written": ("report", "figures", "save", "out", "plot", "json_file"),
}
_WORDS = {
    "FOLDER": ("root", "other_results"),
    "FILE": ("report", "save", "plot", "json_file"),
    "KIND": ("input_kind", "joint"),
    "METHOD": ("method",),
    "LOSS": ("loss",),
    "HOLD": ("intersample",),
    "SPLIT": ("split",),
    "FAULT": ("repair",),
    "NAMES": (
        *("terms", "fixed", "per_mass", "per_log", "holdout", "candidates", "methods"),
        "chosen_columns",
    ),
    "NUMBERS": ("which", "only"),
    "N": (
        *("cogging_periods", "decimation", "workers", "draws", "seed", "jobs", "limit", "folds"),
        *("repetitions", "port", "fps", "size", "number"),
    ),
    "RESULT": ("given",),
    "TABLE": ("table",),
    "PATH": ("out",),
    "ADDRESS": ("scheduler",),
    "PAIRS": ("columns", "units", "known", "against", "where"),
    "kg": ("hand_mass", "added_mass"),
    "m": ("arm",),
    "m/s²": ("gravity",),
    "rad": ("zero", "angle", "swing"),
    "s": ("begin", "end", "half_width", "horizon", "seconds", "window"),
}
_RENAMED = {
    "--against": "--other-results",
    "--count": "--limit",
    "--logs": "--log",
    "--mass": "--hand-mass",
    "--methods": "--method",
}
"""Options that were called otherwise, by the names that they had."""

_SHORT = {"out": "-o", "method": "-m", "methods": "-m", "report": "-r"}

_GROUP_OF = {name: group for group, names in _GROUPS.items() for name in names}
_WORD_OF = {name: word for word, names in _WORDS.items() for name in names}
_ORDER = [None, *_GROUPS]


class ArrangedCommand(TyperCommand):
    """A command whose help is laid out so."""

    def get_params(self, ctx: Any) -> list[Any]:  # noqa: ANN401 - typer's
        """Return its arguments and options, those of a group together."""
        return sorted(arranged(super().get_params(ctx)), key=_place)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - typer's
        """Read what was said.

        Raises
        ------
        InputError
            If an option is called by a name that it had before.
        """
        own = {name for each in self.params for name in each.opts}
        for said in (text.partition("=")[0] for text in args):
            if said not in own and _RENAMED.get(said) in own:
                raise InputError("butterfly", said, "its former name", _RENAMED[said])
        parsed: list[str] = super().parse_args(ctx, args)
        return parsed


def arranged(parameters: list[Any]) -> list[Any]:
    """Give options their groups, words and short forms; what has them keeps them."""
    for each in parameters:
        if each.param_type_name != "option":
            each.metavar = each.metavar or each.name.upper()
            continue
        each.rich_help_panel = _GROUP_OF.get(each.name, each.rich_help_panel)
        short = _SHORT.get(each.name)
        if short is not None and short not in each.opts:
            each.opts.append(short)
        if each.is_flag:
            each.metavar = ""
        elif each.metavar is None:
            each.metavar = _WORD_OF.get(each.name)
    return parameters


def _place(parameter: Any) -> int:  # noqa: ANN401 - typer's
    group = getattr(parameter, "rich_help_panel", None)
    return _ORDER.index(group) if group in _ORDER else 0
