"""Compiled functions of the kernel, reduced to what one joint needs, for other languages.

A function's own source is read, so what is written of it elsewhere cannot differ from it. What is
known beforehand is worked out: None and flags among its arguments, and constants of a joint that
are 0. With them goes whatever they make unreachable, 0, or of no use. The source may use numbers,
tuples, fields of its constants, `OF_NUMBERS`, loops over ranges, and functions that do the same.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from butterfly.twin.reduced import (
    FLAG,
    NUMBER,
    Expression,
    Fields,
    Function,
    Kind,
    Statement,
    all_of,
    constant,
    is_known,
    join,
    negated,
    tidy,
    tuple_of,
    without_aliases,
)

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
