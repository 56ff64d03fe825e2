"""What is left of a function once all that is known beforehand is worked out.

A known value is written as a number, and nothing is computed that is not read.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

NUMBER, FLAG = "number", "flag"
Kind: TypeAlias = Any
"""What is known of a value: it (None, a number or a flag); `NUMBER` or `FLAG`, one that is not; a
tuple of kinds; or the `Fields` of constants."""


@dataclass(frozen=True, eq=False)
class Fields:
    """Constants by name: 0 where they are always, else `NUMBER`."""

    kinds: Mapping[str, Kind]


@dataclass(frozen=True)
class Expression:
    """An operator's name, its parts, and the name, number or `Function` that it means."""

    op: str
    kind: Kind
    parts: tuple[Expression, ...] = ()
    meant: Any = None

    def all(self) -> Iterator[Expression]:
        """Yield it and all its parts."""
        yield self
        for part in self.parts:
            yield from part.all()

    def names(self) -> Iterator[str]:
        """Yield the variables in it."""
        yield from (part.meant for part in self.all() if part.op == "name")

    def with_names(self, meant: Mapping[str, Expression]) -> Expression:
        """Return it with others in the place of variables."""
        if self.op == "name":
            return meant.get(self.meant, self)
        return replace(self, parts=tuple(part.with_names(meant) for part in self.parts))


@dataclass
class Statement:
    """One of =, return, if, for, while, break and continue."""

    op: str
    value: Expression | None = None
    target: str = ""
    body: list[Statement] = field(default_factory=list)
    other: list[Statement] = field(default_factory=list)

    @property
    def leaves(self) -> bool:
        """Whether what follows is not reached."""
        both = (self.body, self.other)
        return self.op in {"return", "break", "continue"} or (
            self.op == "if" and all(block and block[-1].leaves for block in both)
        )


@dataclass(eq=False)
class Function:
    """What is left of a function: of its arguments, those that it uses."""

    name: str
    about: str
    arguments: list[str]
    kinds: dict[str, Kind]
    returned: Kind
    body: list[Statement]

    @property
    def forwarded(self) -> Expression | None:
        """What it only hands on, if it does no more."""
        value, atoms = self.body[0].value, {"name", "field", "constant"}
        if self.body[0].op != "return" or not value or value.op not in {*atoms, "tuple", "call"}:
            return None
        return value if all(part.op in atoms for part in value.parts) else None

    @property
    def called(self) -> dict[Function, None]:
        """It and what it calls, in an order in which each knows those that it calls."""
        functions: dict[Function, None] = {}
        for statement in all_of(self.body):
            for part in statement.value.all() if statement.value else ():
                if isinstance(part.meant, Function):
                    functions |= part.meant.called
        return functions | {self: None}


def all_of(statements: Iterable[Statement]) -> Iterator[Statement]:
    """Yield statements and all within them."""
    for statement in statements:
        yield statement
        yield from all_of([*statement.body, *statement.other])


def is_known(kind: Kind) -> bool:
    """Tell whether a kind is a value."""
    return kind is None or isinstance(kind, (bool, float))


def join(one: Kind, other: Kind) -> Kind:
    """Return the kind of what is of one kind or the other; NaN may be of any."""
    if isinstance(one, tuple):
        return tuple(map(join, one, other))
    if one is other or (type(one) is type(other) and one == other) or _lost(other):
        return one
    if _lost(one):
        return other
    return FLAG if {type(one), type(other)} <= {bool} or FLAG in {one, other} else NUMBER


def _lost(kind: Kind) -> bool:
    return isinstance(kind, float) and math.isnan(kind)


def without_aliases(body: list[Statement], arguments: Iterable[str]) -> list[Statement]:
    """Replace each variable that is always the same argument or constant by what it is."""
    changed = Counter(s.target for s in all_of(body) if s.op in {"=", "for"})
    fixed = {*arguments} - {*changed}
    meant: dict[str, Expression] = {}
    for statement in all_of(body):
        if statement.op == "=" and changed[statement.target] == 1 and statement.value is not None:
            value = statement.value.with_names(meant)
            if value.op in {"field", "name"} and {*value.names()} <= fixed:
                meant[statement.target] = value
    for statement in all_of(body):
        statement.value = statement.value.with_names(meant) if statement.value else None
    return body


def tidy(body: list[Statement]) -> list[Statement]:
    """Drop assignments to what is never read, and conditions and loops in which nothing happens."""
    while True:
        statements = [*all_of(body)]
        read = {
            name
            for statement in statements
            for name in (statement.value.names() if statement.value else ())
            if statement.op != "=" or name != statement.target
        }
        body = _kept(body, read)
        if len([*all_of(body)]) == len(statements):
            return body


def _kept(body: list[Statement], read: set[str]) -> list[Statement]:
    block: list[Statement] = []
    for statement in body:
        statement.body, statement.other = _kept(statement.body, read), _kept(statement.other, read)
        if statement.op == "if" and not statement.body and statement.value:
            statement.value, statement.body, statement.other = (
                negated(statement.value),
                statement.other,
                [],
            )
        if (
            statement.op == "return"
            and block
            and block[-1].op == "="
            and _is(statement.value, block[-1].target)
        ):
            statement.value = block.pop().value
        idle = not statement.body if statement.op in {"if", "for"} else statement.target not in read
        if statement.op not in {"=", "if", "for"} or not (
            idle or _is(statement.value, statement.target)
        ):
            block.append(statement)
    return block


def _is(value: Expression | None, variable: str) -> bool:
    return value is not None and value.op == "name" and value.meant == variable


def constant(value: Any) -> Expression:  # noqa: ANN401 - None, a flag, a number, a tuple of them
    """Return what is known as an expression."""
    if isinstance(value, tuple):
        return tuple_of([constant(part) for part in value])
    return Expression("constant", float(value) if type(value) is int else value)


def tuple_of(parts: Sequence[Expression]) -> Expression:
    """Return a tuple of expressions."""
    return Expression("tuple", tuple(part.kind for part in parts), tuple(parts))


def negated(value: Expression) -> Expression:
    """Return that something is not."""
    return constant(not value.kind) if is_known(value.kind) else Expression("not", FLAG, (value,))
