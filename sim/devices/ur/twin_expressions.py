"""URScript's expressions, parsed from one line's tokens into closures."""

from __future__ import annotations

import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Final

_TOKEN: Final = re.compile(
    r"""\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<text>"[^"]*")|(?P<name>[A-Za-z_]\w*)"""
    r"""|(?P<mark>==|!=|<=|>=|[-+*/%<>=()\[\],:]))"""
)
_COMPARE: Final = {
    "==": operator.eq, "!=": operator.ne, "<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge,
}  # fmt: skip
_ARITHMETIC: Final = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "%": operator.mod,
}  # fmt: skip

Scope = dict[str, Any]
Expression = Callable[[Scope], Any]


class ScriptError(Exception):
    """The program's text is wrong, or the program did something impossible."""


class Pose(list[float]):
    """A value `p[x, y, z, rx, ry, rz]`: m, and rotation vector, rad. Joint angles are plain lists."""


def copied(value: Any) -> Any:
    """A value as URScript passes it on: lists and poses are values, not references."""
    return type(value)(value) if isinstance(value, list) else value


class Expressions(ABC):
    """A recursive-descent parser of `_line`, from `_column` on."""

    def __init__(self, functions: Mapping[str, Callable[..., Any]]) -> None:
        self._functions = functions
        self._globals: Scope = {}
        self._line: list[tuple[str, str]] = []
        self._number = 0
        self._column = 0
        self._called: dict[str, int] = {}  # functions of the program that it calls, and a line that does

    @abstractmethod
    def _value_of(self, name: str, given: list[Any], by_name: dict[str, Any]) -> Any:
        """Calls a function of the program within an expression."""

    @abstractmethod
    def _thread(self, name: str, given: list[Any]) -> Any:
        """Starts a thread of the program."""

    def _whole(self) -> Expression:
        value = self._expression()
        self._ended()
        return value

    def _expression(self) -> Expression:
        left = self._both()
        while self._accept("or"):
            left = _either(left, self._both())
        return left

    def _both(self) -> Expression:
        left = self._not()
        while self._accept("and"):
            left = _all(left, self._not())
        return left

    def _not(self) -> Expression:
        if self._accept("not"):
            inner = self._not()
            return lambda scope: not inner(scope)
        return self._comparison()

    def _comparison(self) -> Expression:
        left = self._sum()
        if (mark := self._peek()) in _COMPARE:
            self._column += 1
            return _binary(_COMPARE[mark], left, self._sum())
        return left

    def _sum(self) -> Expression:
        left = self._product()
        while (mark := self._peek()) in ("+", "-"):
            self._column += 1
            left = _binary(_ARITHMETIC[mark], left, self._product())
        return left

    def _product(self) -> Expression:
        left = self._unary()
        while (mark := self._peek()) in ("*", "/", "%"):
            self._column += 1
            left = _binary(_ARITHMETIC[mark], left, self._unary())
        return left

    def _unary(self) -> Expression:
        if self._accept("-"):
            inner = self._unary()
            return lambda scope: -inner(scope)
        value = self._atom()
        while self._accept("["):
            value = _binary(operator.getitem, value, self._expression())
            self._expect("]")
        return value

    def _atom(self) -> Expression:
        if self._column >= len(self._line):
            raise ScriptError(f"line {self._number}: it ends too early")
        kind, word = self._line[self._column]
        self._column += 1
        if kind == "number":
            number = int(word) if word.isdigit() else float(word)
            return lambda scope: number
        if kind == "text":
            return lambda scope: word[1:-1]
        if word == "(":
            value = self._expression()
            self._expect(")")
            return value
        if word == "p" and self._peek() == "[" and (pose := self._pose()) is not None:
            return pose
        if word == "[":
            items = self._items("]")
            return lambda scope: [item(scope) for item in items]
        if word == "run" and self._column < len(self._line):
            return self._run_thread()
        if kind != "name":
            raise ScriptError(f"line {self._number}: '{word}' isn't expected here")
        if word in ("True", "False"):
            truth = word == "True"
            return lambda scope: truth
        return self._named(word)

    def _named(self, word: str) -> Expression:
        if self._accept("("):
            values, named = self._arguments()
            if word not in self._functions:
                self._called.setdefault(word, self._number)
                return lambda scope: self._value_of(
                    word, [value(scope) for value in values], {key: value(scope) for key, value in named.items()}
                )
            function = self._functions[word]
            if named:
                return lambda scope: function(
                    *[value(scope) for value in values], **{key: value(scope) for key, value in named.items()}
                )
            return lambda scope: function(*[value(scope) for value in values])
        everything = self._globals

        def look_up(scope: Scope) -> Any:
            if word in scope:
                return scope[word]
            if word in everything:
                return everything[word]
            raise ScriptError(f"'{word}' has no value")

        return look_up

    def _pose(self) -> Expression | None:
        """The pose that begins here; None: it is an element of a variable called p."""
        before = self._column
        self._column += 1
        items = self._items("]")
        if len(items) == 1:
            self._column = before
            return None
        if len(items) != 6:
            raise ScriptError(f"line {self._number}: a pose has six elements")
        return lambda scope: Pose(item(scope) for item in items)

    def _run_thread(self) -> Expression:
        name = self._line[self._column][1]
        self._column += 1
        self._expect("(")
        values, _ = self._arguments()
        self._called.setdefault(name, self._number)
        return lambda scope: self._thread(name, [value(scope) for value in values])

    def _arguments(self) -> tuple[list[Expression], dict[str, Expression]]:
        values: list[Expression] = []
        named: dict[str, Expression] = {}
        while not self._accept(")"):
            if self._column + 1 < len(self._line) and self._line[self._column + 1][1] == "=":
                key = self._line[self._column][1]
                self._column += 2
                named[key] = self._expression()
            else:
                values.append(self._expression())
            if not self._accept(","):
                self._expect(")")
                break
        return values, named

    def _items(self, end: str) -> list[Expression]:
        items: list[Expression] = []
        while not self._accept(end):
            items.append(self._expression())
            if not self._accept(","):
                self._expect(end)
                break
        return items

    def _peek(self) -> str:
        return self._line[self._column][1] if self._column < len(self._line) else ""

    def _accept(self, word: str) -> bool:
        if self._peek() != word:
            return False
        self._column += 1
        return True

    def _expect(self, word: str) -> None:
        if not self._accept(word):
            raise ScriptError(f"line {self._number}: expected '{word}', got '{self._peek() or 'its end'}'")

    def _ended(self) -> None:
        if self._column < len(self._line):
            raise ScriptError(f"line {self._number}: '{self._peek()}' isn't expected here")


def _binary(function: Callable[[Any, Any], Any], left: Expression, right: Expression) -> Expression:
    return lambda scope: function(left(scope), right(scope))


def _either(left: Expression, right: Expression) -> Expression:
    return lambda scope: bool(left(scope)) or bool(right(scope))


def _all(left: Expression, right: Expression) -> Expression:
    return lambda scope: bool(left(scope)) and bool(right(scope))


def tokens(line: str, number: int) -> list[tuple[str, str]]:
    line = line.rstrip()
    found, at = [], 0
    while at < len(line):
        match = _TOKEN.match(line, at)
        if match is None and line[at:].lstrip().startswith("#"):
            break
        if match is None:
            raise ScriptError(f"line {number}: '{line[at:].strip()[:20]}' isn't expected here")
        assert match.lastgroup is not None
        found.append((match.lastgroup, match[match.lastgroup]))
        at = match.end()
    return found
