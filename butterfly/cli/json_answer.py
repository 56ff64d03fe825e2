"""``--json`` of every command that has an answer: one option, one form, one writer."""

from __future__ import annotations

from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from butterfly.cli.loudness import print_document, print_document_alone, writes_any_letter
from butterfly.cli.signature import option, with_options
from butterfly.errors import UnusableError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from butterfly.document import Told

JsonOption = Annotated[
    Path | None,
    typer.Option(
        "--json",
        help="Write the answer as JSON to this file, for other programs; - prints it, and nothing "
        "else.",
        show_default=False,
    ),
]

_STDOUT = Path("-")


class JsonAnswer:
    """Where the answer of a command goes as JSON.

    Parameters
    ----------
    path
        The file, ``-`` for standard output, or None if nobody asked.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path

    @property
    def wanted(self) -> bool:
        """Whether somebody asked."""
        return self.path is not None

    def give(self, make: Callable[[], Told]) -> None:
        """Write what is told, made only if somebody asked.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        if self.wanted:
            self.write(make().document())

    def write(self, document: Mapping[str, Any]) -> None:
        """Write a document, if somebody asked (see `give` for what is raised)."""
        from butterfly.document import (  # noqa: PLC0415 - slow to import
            json_text,
            write_document,
        )

        if self.path == _STDOUT:
            print_document(json_text(document, ascii_only=not writes_any_letter()))
        elif self.path is not None:
            write_document(document, self.path)
            typer.echo(f"Numbers: {self.path}")


def answers_in_json(kind: str) -> Callable[..., Any]:
    """Give a command ``--json``, for its argument ``answer``.

    Where values are refused as no joint's, their verdict is the answer.

    Parameters
    ----------
    kind
        Of the answer.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def answering(*, answer: JsonAnswer, **given: Any) -> Any:  # noqa: ANN401 - of any command
            if answer.path == _STDOUT:
                print_document_alone()
            try:
                return command(answer=answer, **given)
            except UnusableError as refused:
                answer.give(partial(_refused, kind, refused.reasons))
                raise

        def make(told: dict[str, Any]) -> JsonAnswer:
            return JsonAnswer(told["json_file"])

        return with_options(answering, "answer", [option("json_file", JsonOption, None)], make)

    return decorate


def _refused(kind: str, reasons: tuple[str, ...]) -> Told:
    from butterfly.document import Told  # noqa: PLC0415
    from butterfly.verdict import Level, Verdict  # noqa: PLC0415

    verdict = Verdict(Level.WARNING, reasons)
    title = "Nothing is made of values that no joint has"
    return Told(kind=kind, title=title, verdict=verdict, summary=(verdict.sentence,))
