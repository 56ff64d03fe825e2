"""The command that follows an identification: to mend what is wrong, to save it, or to use it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from butterfly.identification.identified import Identified
from butterfly.identification.trust import FindingKind
from butterfly.model.terms import PARAMETERS, TERMS, offered
from butterfly.report.finding_texts import estimate_verdict
from butterfly.verdict import Level

_ADVICE = re.compile(r"Set (--\S+) (\S+?),? ")


def next_command(
    identification: Identified,
    words: Sequence[str],
    data: Sequence[Path | str],
    saved: Path | None = None,
) -> str:
    """Return a command to paste: it mends units or the model, or saves the result or uses it.

    ``data``: paths, and options that say what is read, which other commands take too.
    """
    verdict, missing = (
        estimate_verdict(identification.estimate),
        identification.residuals.missing.terms,
    )
    if advice := _ADVICE.search(" ".join(verdict.lines)):
        return _again(words, advice[1], advice[2], merged=True)
    read = shlex.join(map(str, data))
    if verdict.level is Level.WARNING:
        poor = (
            finding
            for finding in identification.estimate.findings
            if finding.kind is FindingKind.POOR_FIT
        )
        better = next((finding.parameters for finding in poor), ())
        return (
            f"butterfly identify {read} --method {better[0]}"
            if better
            else f"butterfly inspect {read}"
        )
    if missing:
        names = (
            n for n in identification.estimate.names if n not in PARAMETERS and not TERMS[n].follows
        )
        terms = ",".join([*names, *missing])
        if identification.made_by is None or {*missing} <= {
            *offered(identification.made_by.method)
        }:
            return _again(words, "--terms", terms)
        return f"butterfly identify {read} --terms {terms}"
    if saved is None:
        return _again(words, "--save", "joint.json")
    done = verdict.level is Level.GOOD and not identification.estimate.open
    use = "validate" if done else "design"
    return f"butterfly {use} {shlex.quote(str(saved))}"


def _again(words: Sequence[str], option: str, value: str, *, merged: bool = False) -> str:
    """Return the command anew, with a value of an option, or one more of its pairs."""
    arguments: list[str] = []
    for word in words:
        arguments += word.split("=", maxsplit=1) if word.startswith(f"{option}=") else [word]
    if option not in arguments:
        return f"butterfly {shlex.join([*arguments, option, value])}"
    at = arguments.index(option) + 1
    column = f"{value.partition('=')[0]}="
    pairs = [pair for pair in arguments[at].split(",") if merged and not pair.startswith(column)]
    arguments[at] = ",".join([*pairs, value])
    return f"butterfly {shlex.join(arguments)}"
