"""What is left of functions (see `translate`), written in C, JavaScript or Python."""

from __future__ import annotations

import builtins
import math
from collections.abc import Iterable, Mapping, Sequence
from textwrap import wrap

from butterfly.twin.translate import (
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
    "abs": "(double x) {{ return x < 0.0 ? -x : x; }}",
    "sign": "(double x) {{ return (double)(x > 0.0) - (double)(x < 0.0); }}",
    "max": "(double x, double y) {{ return x > y ? x : y; }}",
    "min": "(double x, double y) {{ return x < y ? x : y; }}",
    "square": "(double x) {{ return x * x; }}",
    "round": """(double x) {{ /* halves to even; x up to 2^51 */
    const double large = 6755399441055744.0;
    return (x + large) - large;
}}""",
    "ceil": """(double x) {{
    const double near = {0}_round(x);
    return near < x ? near + 1.0 : near;
}}""",
    "sqrt": """(double x) {{ /* Newton's iteration, from above */
    double root = x < 1.0 ? 1.0 : x, next = 0.5 * (root + x / root);
    if (x <= 0.0) return 0.0;
    while (next < root) {{
        root = next;
        next = 0.5 * (root + x / root);
    }}
    return root;
}}""",
    "cos": """(double x) {{
    const double half = sin(0.5 * x);
    return 1.0 - 2.0 * half * half;
}}""",
}
"""What C has in libm, and here does without."""


class C:
    """C99, which is C++ as well; all names begin with a prefix."""

    infinity, nan, flags, counter = "INFINITY", "NAN", ("0", "1"), "int"
    words = {"and": "&&", "or": "||", "not": "!"}  # noqa: RUF012 - what each language writes
    head_of, otherwise, chained = "{} ({}) {{", "} else {", "}} else {}"
    end, close, first, first_and_only = ";", ["}"], "{}{}", "const {}{}"
    field_of, item_of, whole, choice = "{}->{}", "{}.e{}", "(int)({})", "{} ? {} : {}"
    tuple_form, library, helper = "{}_of({})", "{}", "static inline double {}_{}{}"
    definition = "/* {about} */\nstatic inline {kind}{name}({given}) {{\n{body}\n}}"
    helpers: Mapping[str, str] = _HELPERS

    def __init__(self, prefix: str, functions: Sequence[Function]) -> None:
        self._prefix = prefix
        self._helpers: set[str] = set()
        self._tuples: dict[str, str] = {}
        self._names: dict[Function, str] = {}
        for function in functions:
            alike = sum(other.name == function.name for other in self._names)
            number = f"_{alike + 1}" if alike else ""
            self._names[function] = f"{prefix}_{function.name}{number}"

    def text(self) -> str:
        """Return all functions, after what they need."""
        functions = []
        for function, name in self._names.items():
            body = "\n".join(self._block(function, function.body, {*function.arguments}))
            given = ", ".join(
                f"{self._type(function.kinds[one])}{one}" for one in function.arguments
            )
            about, kind = function.about.replace("``", ""), self._type(function.returned)
            parts = {"about": about, "kind": kind, "name": name, "given": given, "body": body}
            functions.append(self.definition.format(**parts))
        used = [(name, form) for name, form in self.helpers.items() if name in self._helpers]
        n = self._prefix
        helpers = [self.helper.format(n, name, form.format(n)) for name, form in used]
        return "\n\n".join([*self._tuples.values(), *helpers, *functions])

    def call(self, function: Function, given: Mapping[str, str]) -> str:
        """Return a call with arguments by name."""
        return f"{self._names[function]}({', '.join(given[name] for name in function.arguments)})"

    def _type(self, kind: Kind) -> str:
        """Return the type of a kind; one that is new is defined."""
        if isinstance(kind, Fields):
            return f"const {self._prefix}_parameters *"
        if not isinstance(kind, tuple):
            return "double " if kind == NUMBER or type(kind) is float else "int "
        types = [self._type(part).strip() for part in kind]
        sizes = (len(part) if isinstance(part, tuple) else 1 for part in kind)
        name = f"{self._prefix}_{'_'.join(map(str, sizes))}"
        if set(types) == {"double"}:
            name = f"{self._prefix}_{len(kind)}"
        fields = "".join(f"{type_name} e{k}; " for k, type_name in enumerate(types))
        given = ", ".join(f"{type_name} e{k}" for k, type_name in enumerate(types))
        made = ", ".join(f"e{k}" for k in range(len(types)))
        self._tuples[name] = (
            f"typedef struct {{ {fields}}} {name};\n\n"
            f"static inline {name} {name}_of({given}) {{\n"
            f"    const {name} made = {{{made}}};\n    return made;\n}}"
        )
        return f"{name} "

    def _tuple(self, kind: Kind, parts: Iterable[str]) -> str:
        return self.tuple_form.format(self._type(kind).strip(), ", ".join(parts))

    def _called(self, name: str) -> str:
        """Return what a function of numbers is called."""
        if name not in self.helpers:
            return self.library.format(name)
        self._helpers |= {name, "round"} if name == "ceil" else {name}
        return f"{self._prefix}_{name}"

    def _expression(self, value: Expression, binds: int = 0) -> str:
        """Return an expression, in brackets if what is about it binds harder."""
        strength = _BINDS.get(value.op, _ATOM)
        text = self._bare(value, strength)
        strength = min(strength, _BINDS["neg"]) if text.startswith("-") else strength
        return f"({text})" if strength < binds else text

    def _bare(self, value: Expression, strength: int) -> str:  # noqa: PLR0911 - one for each kind
        parts, op = value.parts, value.op
        match op:
            case "constant":
                return self._number(value.kind)
            case "name":
                return str(value.meant)
            case "field":
                return self.field_of.format(self._expression(parts[0]), value.meant)
            case "item":
                return self.item_of.format(self._expression(parts[0]), value.meant)
            case "tuple":
                return self._tuple(value.kind, map(self._expression, parts))
            case "call":
                meant = value.meant
                name = self._names[meant] if isinstance(meant, Function) else self._called(meant)
                return f"{name}({', '.join(map(self._expression, parts))})"
            case "?":
                return self.choice.format(*(self._expression(part, strength + 1) for part in parts))
            case "and" | "or":
                sides = [self._expression(part, _COMPARES) for part in parts]
                return f" {self.words[op]} ".join(sides)
            case "not" | "neg":
                return f"{self.words.get(op, '-')}{self._expression(parts[0], _ATOM)}"
        first = self._expression(parts[0], strength + (strength == _COMPARES))
        second = self._expression(parts[1], strength + 1)
        return f"{first} {op} {second}"

    def _loop(self, name: str, count: Expression) -> str:
        """Return the head of a loop."""
        text, begin = self._expression(count), f"{self.counter} {name} = 0"
        until = f"{count.kind:g}" if is_known(count.kind) else text
        if not is_known(count.kind) and count.op != "name":
            until, begin = "n", f"{begin}, n = {self.whole.format(text)}"
        return self.head_of.format("for", f"{begin}; {name} < {until}; {name}++")

    def _number(self, value: float | bool) -> str:
        """Return a number or a flag."""
        if isinstance(value, bool):
            return self.flags[value]
        if not math.isfinite(value):
            return self.nan if math.isnan(value) else f"{'-' * (value < 0)}{self.infinity}"
        return repr(value)

    def _block(
        self, function: Function, statements: Sequence[Statement], declared: set[str]
    ) -> list[str]:
        """Return the lines of a block, given what is declared before it."""
        lines: list[str] = []
        declared = {*declared}
        for k, statement in enumerate(statements):
            later = _names(statements[k + 1 :])
            new = {inner.target for inner in all_of([statement]) if inner.op == "="} - declared
            for name in sorted(new & later - {statement.target}):
                kind = function.kinds[name]
                first = self.first.format(self._type(kind), name)
                lines.append(f"{first} = {self._zero(kind)}{self.end}")
                declared.add(name)
            lines += self._lines(function, statement, declared)
            declared |= {statement.target} if statement.op == "=" else set()
        return [f"    {line}" for line in lines]

    def _zero(self, kind: Kind) -> str:
        if isinstance(kind, tuple):
            return self._tuple(kind, map(self._zero, kind))
        return self._number(0.0 if kind == NUMBER or type(kind) is float else False)

    def _lines(self, function: Function, statement: Statement, declared: set[str]) -> list[str]:  # noqa: PLR0911
        value = statement.value
        text = self._expression(value) if value else ""
        match statement.op:
            case "=":
                if statement.target not in declared:
                    times = sum(other.target == statement.target for other in all_of(function.body))
                    form = self.first_and_only if times == 1 else self.first
                    kind = self._type(function.kinds[statement.target])
                    return [f"{form.format(kind, statement.target)} = {text}{self.end}"]
                if value and value.op in {"+", "-", "*", "/"}:
                    first, second = value.parts
                    if first.op == "name" and first.meant == statement.target:
                        text = self._expression(second)
                        return [f"{statement.target} {value.op}= {text}{self.end}"]
                return [f"{statement.target} = {text}{self.end}"]
            case "if":
                final = [*self.close]
                if len(statement.other) == 1 and statement.other[0].op == "if":
                    begun, *rest = self._lines(function, statement.other[0], declared)
                    final = [self.chained.format(begun), *rest]
                elif statement.other:
                    final = [
                        self.otherwise,
                        *self._block(function, statement.other, declared),
                        *final,
                    ]
                body = self._block(function, statement.body, declared)
                return [self.head_of.format("if", text), *body, *final]
            case "for" if value:
                head = self._loop("i" if statement.target == "_" else statement.target, value)
                body = self._block(function, statement.body, {*declared, statement.target})
                return [head, *body, *self.close]
            case "while":
                body = self._block(function, statement.body, declared)
                return [self.head_of.format("while", text), *body, *self.close]
        return [f"{statement.op} {text}".rstrip() + self.end]


class JavaScript(C):
    """JavaScript, in which a tuple is an array."""

    infinity, nan, flags, counter = "Infinity", "NaN", ("false", "true"), "let"
    field_of, item_of, whole, first = "{}.{}", "{}[{}]", "{}", "let {}{}"
    tuple_form, library, helper = "{}[{}]", "Math.{}", "const {}_{} = (x) => {};"
    definition = "// {about}\nfunction {name}({given}) {{\n{body}\n}}"
    helpers: Mapping[str, str] = {
        "square": "x * x",
        "round": "x + 6755399441055744 - 6755399441055744",
    }

    def _type(self, kind: Kind) -> str:  # noqa: ARG002
        return ""


class Python(JavaScript):
    """Python, where a name begins with an underscore."""

    infinity, nan, flags = "math.inf", "math.nan", ("False", "True")
    words = {"and": "and", "or": "or", "not": "not "}  # noqa: RUF012
    head_of, otherwise, chained, end, close = "{} {}:", "else:", "el{}", "", []
    first = first_and_only = "{}{}"
    choice, tuple_form, library = "{1} if {0} else {2}", "{}({},)", "math.{}"
    helper = "def {}_{}(x):\n    return {}"
    definition = '\ndef {name}({given}):\n    """{about}"""\n{body}'
    helpers = {"sign": "float(x > 0.0) - float(x < 0.0)", "square": "x * x"}  # noqa: RUF012

    def _called(self, name: str) -> str:
        return name if name in vars(builtins) else super()._called(name)

    def _loop(self, name: str, count: Expression) -> str:
        return f"for {name} in range(int({self._expression(count)})):"


def _names(statements: Sequence[Statement]) -> set[str]:
    """Names of all variables in statements."""
    read = {name for s in all_of(statements) if s.value for name in s.value.names()}
    return read | {statement.target for statement in all_of(statements)}


def wrapped(text: str) -> str:
    """Return a text with lines that are not too long; what follows is set in."""
    lines: list[str] = []
    for line in text.split("\n"):
        begin = f"{' ' * (len(line) - len(line.lstrip()))}    "
        marked = line.replace(" *c", "\0*c")  # belongs to its type
        parts = wrap(marked, _WIDTH, subsequent_indent=begin, break_long_words=False)
        lines += [line] if len(line) <= _WIDTH or line.startswith("#") else parts
    return "\n".join(lines).replace("\0", " ")
