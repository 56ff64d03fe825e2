"""What is left of functions (see `translate`), written in C, JavaScript or Python."""

from __future__ import annotations

import builtins
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from textwrap import wrap

from butterfly.twin.reduced import (
    NUMBER,
    Expression,
    Fields,
    Function,
    Kind,
    Statement,
    all_of,
    is_known,
)

_COMPARES, _ATOM = 4, 8
_BINDS = {"?": 1, "or": 2, "and": 3, "+": 5, "-": 5, "*": 6, "/": 6, "not": 7, "neg": 7}
_BINDS |= dict.fromkeys(("<", "<=", ">", ">=", "==", "!="), _COMPARES)
"""How hard operators bind; those that compare never stand side by side."""
_WIDTH = 100

_HELPERS = {
    "abs": "double {0}_abs(double x) {{ return x < 0.0 ? -x : x; }}",
    "sign": "double {0}_sign(double x) {{ return (double)(x > 0.0) - (double)(x < 0.0); }}",
    "max": "double {0}_max(double x, double y) {{ return x > y ? x : y; }}",
    "min": "double {0}_min(double x, double y) {{ return x < y ? x : y; }}",
    "square": "double {0}_square(double x) {{ return x * x; }}",
    "round": """double {0}_round(double x) {{ /* halves to even; x up to 2^51 */
    const double large = 6755399441055744.0;
    return (x + large) - large;
}}""",
    "ceil": """double {0}_ceil(double x) {{
    const double near = {0}_round(x);
    return near < x ? near + 1.0 : near;
}}""",
    "sqrt": """double {0}_sqrt(double x) {{ /* Newton's iteration, from above */
    double root = x < 1.0 ? 1.0 : x, next = 0.5 * (root + x / root);
    if (x <= 0.0) return 0.0;
    while (next < root) {{
        root = next;
        next = 0.5 * (root + x / root);
    }}
    return root;
}}""",
    "cos": """double {0}_cos(double x) {{
    const double half = sin(0.5 * x);
    return 1.0 - 2.0 * half * half;
}}""",
}
"""What C has in libm, and here does without."""


class C:
    """C99, which is C++ as well; all names begin with a prefix."""

    infinity, nan, flags = "INFINITY", "NAN", ("0", "1")
    counter, comment = "int", "/* {} */"
    words = {"and": "&&", "or": "||", "not": "!"}  # noqa: RUF012 - what each language writes
    head_of, otherwise, chained = "{} ({}) {{", "} else {", "}} else {}"
    end, close = ";", ["}"]

    def __init__(self, prefix: str, functions: Sequence[Function]) -> None:
        self._prefix = prefix
        self._helpers: set[str] = set()
        self._tuples: dict[str, str] = {}
        self._names: dict[Function, str] = {}
        for each in functions:
            alike = sum(other.name == each.name for other in self._names)
            number = f"_{alike + 1}" if alike else ""
            self._names[each] = f"{prefix}_{each.name}{number}"

    def text(self) -> str:
        """Return all functions, after what they need."""
        functions = [self._function(each) for each in self._names]
        helpers = [self.helper(name) for name in _HELPERS if name in self._helpers]
        return "\n\n".join([*self._tuples.values(), *helpers, *functions])

    def helper(self, name: str) -> str:
        """Return a function of numbers that the language lacks."""
        return f"static inline {_HELPERS[name].format(self._prefix)}"

    def type_of(self, kind: Kind) -> str:
        """Return the type of a kind; one that is new is defined."""
        if isinstance(kind, Fields):
            return f"const {self._prefix}_parameters *"
        if not isinstance(kind, tuple):
            return "double " if kind == NUMBER or type(kind) is float else "int "
        types = [self.type_of(each).strip() for each in kind]
        sizes = (len(each) if isinstance(each, tuple) else 1 for each in kind)
        name = f"{self._prefix}_{'_'.join(map(str, sizes))}"
        if set(types) == {"double"}:
            name = f"{self._prefix}_{len(kind)}"
        fields = "".join(f"{each} e{k}; " for k, each in enumerate(types))
        given = ", ".join(f"{each} e{k}" for k, each in enumerate(types))
        made = ", ".join(f"e{k}" for k in range(len(types)))
        self._tuples[name] = (
            f"typedef struct {{ {fields}}} {name};\n\n"
            f"static inline {name} {name}_of({given}) {{\n"
            f"    const {name} made = {{{made}}};\n    return made;\n}}"
        )
        return f"{name} "

    def declared(self, kind: Kind, name: str, *, once: bool) -> str:
        """Return a variable as it is first named."""
        return f"{'const ' if once else ''}{self.type_of(kind)}{name}"

    def head(self, function: Function) -> str:
        """Return a function's first line."""
        kinds = function.kinds
        given = ", ".join(f"{self.type_of(kinds[each])}{each}" for each in function.arguments)
        return f"static inline {self.type_of(function.returned)}{self._names[function]}({given})"

    def field(self, owner: str, name: str) -> str:
        """Return a constant of the joint."""
        return f"{owner}->{name}"

    def item(self, whole: str, number: int) -> str:
        """Return an element of a tuple."""
        return f"{whole}.e{number}"

    def tuple_of(self, kind: Kind, parts: Sequence[str]) -> str:
        """Return a tuple of its elements."""
        return f"{self.type_of(kind).strip()}_of({', '.join(parts)})"

    def called(self, name: str) -> str:
        """Return what a function of numbers is called."""
        if name not in _HELPERS:
            return name
        self._helpers |= {name, "round"} if name == "ceil" else {name}
        return f"{self._prefix}_{name}"

    def whole(self, text: str) -> str:
        """Return a number without its fraction."""
        return f"(int)({text})"

    def call(self, function: Function, given: Mapping[str, str]) -> str:
        """Return a call with arguments by name."""
        return f"{self._names[function]}({', '.join(given[each] for each in function.arguments)})"

    def lines(self, function: Function) -> list[str]:
        """Return the head of a function, and the lines of its block."""
        counts = Counter(each.target for each in all_of(function.body) if each.target)
        block = _Lines(self, function, counts).of(function.body, {*function.arguments})
        return [self.head(function), *block]

    def _function(self, function: Function) -> str:
        head, *lines = self.lines(function)
        about = self.comment.format(function.about.replace("``", ""))
        lines = [about, f"{head} {{", *lines, "}"]
        return "\n".join(part for line in lines for part in wrapped(line))

    def expression(self, value: Expression, binds: int = 0) -> str:
        """Return an expression, in brackets if what is about it binds harder."""
        own = _BINDS.get(value.op, _ATOM)
        text = self._bare(value, own)
        own = min(own, _BINDS["neg"]) if text.startswith("-") else own
        return f"({text})" if own < binds else text

    def _bare(self, value: Expression, own: int) -> str:  # noqa: PLR0911 - one for each kind
        parts, op = value.parts, value.op
        match op:
            case "constant":
                return self.number(value.kind)
            case "name":
                return str(value.meant)
            case "field":
                return self.field(self.expression(parts[0]), value.meant)
            case "item":
                return self.item(self.expression(parts[0]), value.meant)
            case "tuple":
                return self.tuple_of(value.kind, [self.expression(each) for each in parts])
            case "call":
                meant = value.meant
                name = self._names[meant] if isinstance(meant, Function) else self.called(meant)
                return f"{name}({', '.join(map(self.expression, parts))})"
            case "?":
                return self.choice(*(self.expression(each, own + 1) for each in parts))
            case "and" | "or":
                return f" {self.words[op]} ".join(
                    self.expression(each, _COMPARES) for each in parts
                )
            case "not" | "neg":
                return f"{self.words.get(op, '-')}{self.expression(parts[0], _ATOM)}"
        left = self.expression(parts[0], own + (own == _COMPARES))
        right = self.expression(parts[1], own + 1)
        return f"{left} {op} {right}"

    def choice(self, test: str, one: str, other: str) -> str:
        """Return one of two values."""
        return f"{test} ? {one} : {other}"

    def loop(self, name: str, count: Expression) -> str:
        """Return the head of a loop."""
        text, begin = self.expression(count), f"{self.counter} {name} = 0"
        until = f"{count.kind:g}" if is_known(count.kind) else text
        if not is_known(count.kind) and count.op != "name":
            until, begin = "n", f"{begin}, n = {self.whole(text)}"
        return self.head_of.format("for", f"{begin}; {name} < {until}; {name}++")

    def number(self, value: float | bool) -> str:
        """Return a number or a flag."""
        if isinstance(value, bool):
            return self.flags[value]
        if not math.isfinite(value):
            return self.nan if math.isnan(value) else f"{'-' * (value < 0)}{self.infinity}"
        return repr(value)


class JavaScript(C):
    """JavaScript, in which a tuple is an array."""

    infinity, nan, flags = "Infinity", "NaN", ("false", "true")
    counter, comment = "let", "// {}"

    def helper(self, name: str) -> str:
        """Return a function of numbers that the language lacks."""
        what = {"square": "x * x", "round": "x + 6755399441055744 - 6755399441055744"}[name]
        return f"const {self._prefix}_{name} = (x) => {what};"

    def declared(self, kind: Kind, name: str, *, once: bool) -> str:  # noqa: ARG002
        """Return a variable as it is first named."""
        return f"{'const' if once else 'let'} {name}"

    def head(self, function: Function) -> str:
        """Return a function's first line."""
        return f"function {self._names[function]}({', '.join(function.arguments)})"

    def field(self, owner: str, name: str) -> str:
        """Return a constant of the joint."""
        return f"{owner}.{name}"

    def item(self, whole: str, number: int) -> str:
        """Return an element of a tuple."""
        return f"{whole}[{number}]"

    def tuple_of(self, kind: Kind, parts: Sequence[str]) -> str:  # noqa: ARG002
        """Return a tuple of its elements."""
        return f"[{', '.join(parts)}]"

    def called(self, name: str) -> str:
        """Return what a function of numbers is called."""
        return super().called(name) if name in {"square", "round"} else f"Math.{name}"

    def whole(self, text: str) -> str:
        """Return a number without its fraction."""
        return text


class Python(JavaScript):
    """Python, where a name begins with an underscore."""

    infinity, nan, flags = "math.inf", "math.nan", ("False", "True")
    words = {"and": "and", "or": "or", "not": "not "}  # noqa: RUF012
    head_of, otherwise, chained, end, close = "{} {}:", "else:", "el{}", "", []

    def helper(self, name: str) -> str:
        """Return a function of numbers that the language lacks."""
        what = {"square": "x * x", "sign": "float(x > 0.0) - float(x < 0.0)"}[name]
        return f"def {self._prefix}_{name}(x):\n    return {what}"

    def declared(self, kind: Kind, name: str, *, once: bool) -> str:  # noqa: ARG002
        """Return a variable as it is first named."""
        return name

    def head(self, function: Function) -> str:
        """Return a function's first line."""
        return f"def {self._names[function]}({', '.join(function.arguments)}):"

    def tuple_of(self, kind: Kind, parts: Sequence[str]) -> str:  # noqa: ARG002
        """Return a tuple of its elements."""
        return f"({', '.join(parts)},)"

    def called(self, name: str) -> str:
        """Return what a function of numbers is called."""
        if name in {"square", "sign"}:
            return C.called(self, name)
        return name if name in vars(builtins) else f"math.{name}"

    def choice(self, test: str, one: str, other: str) -> str:
        """Return one of two values."""
        return f"{one} if {test} else {other}"

    def loop(self, name: str, count: Expression) -> str:
        """Return the head of a loop."""
        return f"for {name} in range(int({self.expression(count)})):"

    def _function(self, function: Function) -> str:
        head, *lines = self.lines(function)
        about = function.about.replace("``", "")
        return "\n".join([f"\n{head}", f'    """{about}"""', *lines])


class _Lines:
    """Lines of a function; a variable is declared in the innermost block that holds it."""

    def __init__(self, language: C, function: Function, counts: Counter[str]) -> None:
        self._language, self._kinds, self._counts = language, function.kinds, counts

    def of(self, statements: Sequence[Statement], declared: set[str]) -> list[str]:
        """Return the lines of a block, given what is declared before it."""
        lines: list[str] = []
        declared, language = {*declared}, self._language
        for k, each in enumerate(statements):
            later = _names(statements[k + 1 :])
            new = {inner.target for inner in all_of([each]) if inner.op == "="} - declared
            for name in sorted(new & later - {each.target}):
                first = self._first(name, once=False)
                lines.append(f"{first} = {self._zero(self._kinds[name])}{language.end}")
                declared.add(name)
            lines += self._lines(each, declared)
            declared |= {each.target} if each.op == "=" else set()
        return [f"    {line}" for line in lines]

    def _first(self, name: str, *, once: bool) -> str:
        return self._language.declared(self._kinds[name], name, once=once)

    def _zero(self, kind: Kind) -> str:
        if isinstance(kind, tuple):
            return self._language.tuple_of(kind, [self._zero(each) for each in kind])
        return self._language.number(0.0 if kind == NUMBER or type(kind) is float else False)

    def _lines(self, each: Statement, declared: set[str]) -> list[str]:  # noqa: PLR0911
        language, value = self._language, each.value
        text = language.expression(value) if value else ""
        match each.op:
            case "=":
                if each.target not in declared:
                    once = self._counts[each.target] == 1
                    return [f"{self._first(each.target, once=once)} = {text}{language.end}"]
                if value and value.op in {"+", "-", "*", "/"}:
                    first, second = value.parts
                    if first.op == "name" and first.meant == each.target:
                        text = language.expression(second)
                        return [f"{each.target} {value.op}= {text}{language.end}"]
                return [f"{each.target} = {text}{language.end}"]
            case "if":
                final = [*language.close]
                if len(each.other) == 1 and each.other[0].op == "if":
                    begun, *rest = self._lines(each.other[0], declared)
                    final = [language.chained.format(begun), *rest]
                elif each.other:
                    final = [language.otherwise, *self.of(each.other, declared), *final]
                return [language.head_of.format("if", text), *self.of(each.body, declared), *final]
            case "for" if value:
                head = language.loop("i" if each.target == "_" else each.target, value)
                return [head, *self.of(each.body, {*declared, each.target}), *language.close]
            case "while":
                head = language.head_of.format("while", text)
                return [head, *self.of(each.body, declared), *language.close]
        return [f"{each.op} {text}".rstrip() + language.end]


def _names(statements: Sequence[Statement]) -> set[str]:
    """Names of all variables in statements."""
    read = {name for s in all_of(statements) if s.value for name in s.value.names()}
    return read | {each.target for each in all_of(statements)}


def wrapped(line: str) -> list[str]:
    """Return a line in parts that are not too long; what follows is set in."""
    begin = f"{' ' * (len(line) - len(line.lstrip()))}    "
    if len(line) <= _WIDTH or line.startswith("#"):
        return [line]
    line = line.replace(" *c", "\0*c")  # belongs to its type
    parts = wrap(line, _WIDTH, subsequent_indent=begin, break_long_words=False)
    return [part.replace("\0", " ") for part in parts]
