"""Functions translated to other languages: what is left once all that is known is worked out."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

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
        body = _without_unread(body, read)
        if len([*all_of(body)]) == len(statements):
            return body


def _without_unread(body: list[Statement], read: set[str]) -> list[Statement]:
    """Return statements without those whose targets nobody reads, and branches left empty."""
    block: list[Statement] = []
    for statement in body:
        statement.body, statement.other = (
            _without_unread(statement.body, read),
            _without_unread(statement.other, read),
        )
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


OF_NUMBERS: Mapping[Any, str] = {
    **{function: function.__name__ for function in (abs, max, min, round, np.sign)},
    **{
        function: function.__name__
        for function in (math.sin, math.cos, math.exp, math.sqrt, math.ceil)
    },
}
"""Functions of numbers, and what they are called."""

_OPERATORS: Mapping[type[ast.AST], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}


class Translator:
    """Reduces functions, each once for all kinds of arguments; ``instead`` replaces some."""

    def __init__(self, instead: Mapping[Any, Any]) -> None:
        self._instead = instead
        self._made: dict[Any, Function] = {}

    def function(self, source: Any, *kinds: Kind) -> Function:  # noqa: ANN401 - numba's, or Python's
        """Return what is left of a function, given the kinds of its arguments."""
        source = getattr(source, "py_func", source)
        if not isinstance(kinds[0], tuple):
            source = self._instead.get(source.__name__, source)
        wider = tuple(NUMBER if isinstance(kind, float) else kind for kind in kinds)
        if (source, wider) not in self._made:
            self._made[source, wider] = _Reduction(self, source, wider).function()
        return self._made[source, wider]


class _Reduction:
    """One function, given the kinds of its arguments."""

    def __init__(self, translator: Translator, source: Any, kinds: Sequence[Kind]) -> None:  # noqa: ANN401
        self._translator, self._source = translator, source
        tree: Any = ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]
        self._tree, self._arguments = tree, [argument.arg for argument in tree.args.args]
        self._kinds = dict(zip(self._arguments, kinds, strict=True))
        self._returned: Kind = math.nan

    def function(self) -> Function:
        """Work out kinds until no variable's grows wider; then drop what is of no use."""
        known = None
        while known != (known := (dict(self._kinds), self._returned)):
            body = self._block(self._tree.body)
        body = tidy(without_aliases(body, self._arguments))
        used = {name for s in all_of(body) if s.value for name in s.value.names()}
        return Function(
            name=self._source.__name__.strip("_"),
            about=(ast.get_docstring(self._tree) or "").split("\n")[0],
            arguments=[name for name in self._arguments if name in used],
            kinds=self._kinds,
            returned=self._returned,
            body=body,
        )

    def _block(self, nodes: Sequence[ast.stmt]) -> list[Statement]:
        made: list[Statement] = []
        for node in nodes:
            made += self._statements(node)
            if made and made[-1].leaves:
                break
        return made

    def _statements(self, node: Any) -> list[Statement]:  # noqa: ANN401, PLR0911 - of all kinds
        match node:
            case ast.Assign(targets=targets):
                value = self._value(node.value)
                return [made for target in targets for made in self._assign(target, value)]
            case ast.AugAssign(target=target, op=op, value=added):
                return self._assign(target, self._value(ast.BinOp(target, op, added)))
            case ast.If():
                test = self._value(node.test)
                if is_known(test.kind):
                    return self._block(node.body if test.kind else node.orelse)
                body, other = self._block(node.body), self._block(node.orelse)
                return [Statement("if", test, body=body, other=other)]
            case ast.For():
                return self._loop(node)
            case ast.While():
                return [Statement("while", self._value(node.test), body=self._block(node.body))]
            case ast.Return():
                value = self._value(node.value)
                self._returned = join(self._returned, value.kind)
                return [Statement("return", value)]
            case ast.Break() | ast.Continue():
                return [Statement(type(node).__name__.lower())]
            case ast.Expr(value=ast.Constant()):
                return []
        raise NotImplementedError(ast.unparse(node))

    def _assign(self, target: Any, value: Expression) -> list[Statement]:  # noqa: ANN401 - a tree
        if isinstance(target, ast.Name):
            self._kinds[target.id] = join(self._kinds.get(target.id, math.nan), value.kind)
            return [Statement("=", value, target.id)]
        made: list[Statement] = []
        names = [node.id for node in ast.walk(target) if isinstance(node, ast.Name)]
        if not (value.op == "name" or (value.op == "tuple" and {*value.names()}.isdisjoint(names))):
            holder = ast.Name("_".join(["all", *(name for name in names if name != "_")]))
            made = self._assign(holder, value)
            value = Expression("name", self._kinds[holder.id], meant=holder.id)
        for number, part in enumerate(target.elts):
            if ast.unparse(part) != "_":
                made += self._assign(part, _item(value, number))
        return made

    def _loop(self, node: ast.For) -> list[Statement]:
        """Return a loop over a range, or over a tuple of numbers."""
        target, over, more = ast.unparse(node.target), node.iter, []
        if isinstance(over, ast.Tuple):
            choices = [self._value(part) for part in over.elts]
            count, number, chosen = constant(len(choices)), f"{target}s", choices[-1]
            for k, choice in reversed([*enumerate(choices[:-1])]):
                name = Expression("name", NUMBER, meant=number)
                chosen = _choice(Expression("==", FLAG, (name, constant(k))), choice, chosen)
            more, target = self._assign(node.target, chosen), number
        else:
            count = self._value(over.args[0])  # type: ignore[attr-defined]
        self._kinds[target] = NUMBER
        body = more + self._block(node.body)
        once = is_known(count.kind) and count.kind >= 1 and body and body[-1].leaves
        ends = [statement.op for statement in all_of(body) if statement.op in {"break", "continue"}]
        if once and ends == ["break"] * (body[-1].op == "break"):
            return body[:-1] if ends else body
        return [Statement("for", count, target, body)]

    def _value(self, node: Any) -> Expression:  # noqa: ANN401, C901, PLR0911, PLR0912 - a tree of all kinds
        match node:
            case ast.Constant(value=value):
                return constant(value)
            case ast.Name(id=name) if name in self._kinds:
                return _known_or(Expression("name", self._kinds[name], meant=name))
            case ast.Name():
                return constant(self._object(node))
            case ast.Attribute(value=owner, attr=attr):
                if isinstance(fields := self._kinds.get(ast.unparse(owner)), Fields):
                    constants = self._value(owner)
                    return _known_or(Expression("field", fields.kinds[attr], (constants,), attr))
                return constant(self._object(node))
            case ast.Subscript(value=value, slice=number):
                return _item(self._value(value), int(self._value(number).kind))
            case ast.Tuple(elts=elements):
                return tuple_of([self._value(part) for part in elements])
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return negated(self._value(operand))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _arithmetic("-", operator.sub, constant(0.0), self._value(operand))
            case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=2)):
                return _called("square", lambda x: x * x, [self._value(left)])
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return _arithmetic(*_OPERATORS[type(op)], self._value(left), self._value(right))
            case ast.BoolOp(op=op, values=values):
                return _all_or_any(isinstance(op, ast.And), [self._value(part) for part in values])
            case ast.Compare(left=left, ops=ops, comparators=others):
                sides = [self._value(side) for side in (left, *others)]
                return _all_or_any(True, list(map(_compared, ops, sides, sides[1:])))
            case ast.IfExp(test=test, body=body, orelse=other):
                condition = self._value(test)
                if is_known(condition.kind):
                    return self._value(body if condition.kind else other)
                return _choice(condition, self._value(body), self._value(other))
            case ast.Call(func=func, args=arguments):
                return self._call(self._object(func), [self._value(part) for part in arguments])
        raise NotImplementedError(ast.unparse(node))

    def _object(self, node: Any) -> Any:  # noqa: ANN401
        """Return what a name stands for that is no variable."""
        if isinstance(node, ast.Attribute):
            return getattr(self._object(node.value), node.attr)
        return (vars(builtins) | self._source.__globals__)[node.id]

    def _call(self, called: Any, arguments: list[Expression]) -> Expression:  # noqa: ANN401
        if called is np.clip:
            return self._call(min, [self._call(max, arguments[:2]), arguments[2]])
        if name := OF_NUMBERS.get(called):
            first, *others = arguments
            if name in {"min", "max"} and len(others) > 1:
                others = [self._call(called, others)]
            return _called(name, called, [first, *others])
        function = self._translator.function(called, *(argument.kind for argument in arguments))
        names = inspect.signature(getattr(called, "py_func", called)).parameters
        given = dict(zip(names, arguments, strict=True))
        if (forwarded := function.forwarded) is not None:
            return forwarded.with_names(given)
        used = tuple(given[name] for name in function.arguments)
        return _known_or(Expression("call", function.returned, used, function))


def _known_or(value: Expression) -> Expression:
    """Return a constant in the place of what is known."""
    if isinstance(value.kind, tuple) and all(map(is_known, value.kind)):
        return constant(value.kind)
    return Expression("constant", value.kind) if is_known(value.kind) else value


def _item(value: Expression, number: int) -> Expression:
    if value.op == "tuple":
        return value.parts[number]
    return _known_or(Expression("item", value.kind[number], (value,), number))


def _called(name: str, function: Callable[..., Any], arguments: Sequence[Expression]) -> Expression:
    if all(is_known(argument.kind) for argument in arguments):
        return constant(float(function(*(argument.kind for argument in arguments))))
    return Expression("call", NUMBER, tuple(arguments), name)


def _choice(test: Expression, one: Expression, other: Expression) -> Expression:
    if one == other:
        return one
    return Expression("?", join(one.kind, other.kind), (test, one, other))


def _compared(op: ast.cmpop, one: Expression, other: Expression) -> Expression:
    if isinstance(op, (ast.Is, ast.IsNot)):
        return constant((one.kind is other.kind) is isinstance(op, ast.Is))
    sign, function = _OPERATORS[type(op)]
    if is_known(one.kind) and is_known(other.kind):
        return constant(function(one.kind, other.kind))
    return Expression(sign, FLAG, (one, other))


def _all_or_any(every: bool, parts: Iterable[Expression]) -> Expression:
    rest = [part for part in parts if not (is_known(part.kind) and bool(part.kind) is every)]
    if not rest or any(is_known(part.kind) for part in rest):
        return constant(every if not rest else not every)
    return rest[0] if len(rest) == 1 else Expression("and" if every else "or", FLAG, tuple(rest))


def _arithmetic(
    sign: str, function: Callable[[Any, Any], Any], one: Expression, other: Expression
) -> Expression:
    """Return a sum, difference, product or quotient, simplified where an operand is 0 or 1."""
    zero, unit = [[operand.kind == number for operand in (one, other)] for number in (0.0, 1.0)]
    if is_known(one.kind) and is_known(other.kind) and not (sign == "/" and zero[1]):
        return constant(function(one.kind, other.kind))
    if (sign == "*" and any(zero)) or (sign == "/" and zero[0]):
        return constant(0.0)
    if (sign in "+-" and zero[1]) or (sign in "*/" and unit[1]):
        return one
    if (sign == "+" and zero[0]) or (sign == "*" and unit[0]):
        return other
    if sign == "-" and zero[0]:
        return Expression("neg", NUMBER, (other,))
    return Expression(sign, NUMBER, (one, other))
