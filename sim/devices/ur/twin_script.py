"""A small URScript: enough of the language to run the driver's control program and other short programs.

Statements: assignment, `def` with parameters, `if`/`elif`/`else`, `while`, `return`, `break`, `continue`, calls.
No threads, structures, matrices, or calls that take time within an expression. Source of the language's facts:
protocol sheet ur-rtde, section 5.1; URScript manual.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Mapping
from typing import Any, Final

from sim.devices.ur.twin_expressions import Expression, Expressions, Scope, ScriptError, tokens

BUDGET: Final = 20_000  # statements in one control cycle; a real controller stops much sooner
_PROGRAM: Final = re.compile(r"(?:def|sec)\s+(\w+)\s*\(")
_OPENS: Final = re.compile(r"\s*(?:def|sec|thread|while|for|if|struct)\b")
_CLOSES: Final = re.compile(r"\s*end\b")

Wait = Generator[None, None, None]
Statement = Callable[[Scope], Wait]


class _Leave(Exception):  # noqa: N818
    """break, continue and return, while they leave their block."""

    def __init__(self, kind: str, value: Any = None) -> None:
        super().__init__(kind)
        self.kind, self.value = kind, value


class Programs:
    """Splits the bytes of a script port into whole programs: a `def` or `sec` up to its `end`, or a single line.

    Attributes:
        too_long: number of bytes discarded because they exceed the greatest length of a program.
    """

    LONGEST: Final = 200_000

    def __init__(self) -> None:
        self._rest = ""
        self._lines: list[str] = []
        self._size = 0
        self._depth = 0
        self.too_long = 0

    def feed(self, data: bytes) -> list[str]:
        """Takes bytes as they arrive; returns the programs that they complete."""
        *lines, self._rest = (self._rest + data.decode("latin-1")).split("\n")
        found = []
        for line in lines:
            if not self._lines and (not line.strip() or line.lstrip().startswith("#")):
                continue
            self._lines.append(line)
            self._size += len(line) + 1
            self._depth += bool(_OPENS.match(line)) - bool(_CLOSES.match(line))
            if self._depth <= 0:
                found.append("\n".join(self._lines) + "\n")
                self._forget()
        if self._size + len(self._rest) > self.LONGEST:
            self.too_long += self._size + len(self._rest)
            self._rest = ""
            self._forget()
        return found

    def _forget(self) -> None:
        self._lines, self._size, self._depth = [], 0, 0


def name_of(program: str) -> str:
    """A program's name; "" for a single line."""
    found = _PROGRAM.match(program.lstrip())
    return found[1] if found else ""


class Script:
    """One parsed program, ready to run.

    Attributes:
        name: the program's name.
    """

    def __init__(
        self, text: str, functions: Mapping[str, Callable[..., Any]], motions: Mapping[str, Callable[..., Wait]]
    ) -> None:
        """
        Args:
            text: a `def NAME(): ... end`, or single lines.
            functions: functions that take no time.
            motions: generators; each `yield` is the end of a control cycle.
        Raises:
            ScriptError: the text isn't a program that this interpreter understands.
        """
        self.name = name_of(text)
        try:
            reader = _Reader(text, functions, motions)
            block = reader.program()
        except (RecursionError, IndexError):
            raise ScriptError("the program is nested too deeply, or cut short") from None
        self._run = block({}) if not self.name else reader.main(self.name)
        self._budget = reader.budget

    def cycle(self) -> bool:
        """Runs one control cycle; returns False once the program has ended.

        Raises:
            ScriptError: the program can't continue.
        """
        self._budget[0] = BUDGET
        try:
            next(self._run)
        except StopIteration:
            return False
        except ScriptError:
            raise
        except RecursionError:
            raise ScriptError(f"{self.name}: functions call each other too deeply") from None
        except (_Leave, TypeError, ValueError, KeyError, IndexError, ArithmeticError) as error:
            raise ScriptError(f"{self.name}: {error}") from None
        return True


class _Reader(Expressions):
    """A recursive-descent parser of lines; it makes closures."""

    def __init__(
        self, text: str, functions: Mapping[str, Callable[..., Any]], motions: Mapping[str, Callable[..., Wait]]
    ) -> None:
        super().__init__(functions)
        self._lines = [
            (number, found) for number, line in enumerate(text.split("\n"), 1) if (found := tokens(line, number))
        ]
        self._at = 0
        self._motions = motions
        self._own: dict[str, tuple[list[str], Statement]] = {}
        self.budget = [BUDGET]

    def program(self) -> Statement:
        """Parses all lines."""
        block = self._block(())
        if self._at < len(self._lines):
            raise ScriptError(f"line {self._lines[self._at][0]}: 'end' without a beginning")
        return block

    def main(self, name: str) -> Wait:
        """Runs the program's own function."""
        return self._call(name, [], {})

    # -- statements

    def _block(self, ends: tuple[str, ...]) -> Statement:
        statements: list[Statement] = []
        while self._at < len(self._lines):
            word = self._lines[self._at][1][0][1]
            if word in ("end", "else", "elif"):
                if word in ends:
                    break
                raise ScriptError(f"line {self._lines[self._at][0]}: '{word}' without a beginning")
            statements.append(self._statement())
        else:
            if ends:
                raise ScriptError("the program has no end")
        budget = self.budget

        def run(scope: Scope) -> Wait:
            for statement in statements:
                budget[0] -= 1
                if budget[0] < 0:
                    raise ScriptError("the program runs on without letting time pass")
                yield from statement(scope)

        return run

    def _statement(self) -> Statement:
        self._number, self._line = self._lines[self._at]
        self._at += 1
        self._column = 0
        kind, word = self._line[0]
        if kind == "name":
            if word in ("def", "sec"):
                return self._define()
            if word == "if":
                return self._if()
            if word == "while":
                return self._while()
            if word in ("break", "continue", "return", "halt"):
                return self._leave(word)
            if word in ("thread", "struct", "for", "run", "kill", "join", "enter_critical", "exit_critical"):
                raise ScriptError(f"line {self._number}: this interpreter has no '{word}'")
            if word in ("global", "local"):
                self._column = 1
            if len(self._line) > self._column + 1 and self._line[self._column + 1][1] == "=":
                return self._assign(word == "global")
        self._column = 0
        return self._bare_call()

    def _assign(self, everywhere: bool) -> Statement:
        name = self._line[self._column][1]
        self._column += 2
        value = self._whole()
        everything = self._globals

        def run(scope: Scope) -> Wait:
            (everything if everywhere or (name in everything and name not in scope) else scope)[name] = value(scope)
            yield from ()

        return run

    def _bare_call(self) -> Statement:
        name = self._line[0][1]
        timed = self._motions.get(name)
        if timed is None and name not in self._own:
            value = self._whole()

            def run(scope: Scope) -> Wait:
                value(scope)
                yield from ()

            return run
        self._column = 1
        self._expect("(")
        values, named = self._arguments()
        self._ended()

        def go(scope: Scope) -> Wait:
            given = [value(scope) for value in values]
            by_name = {key: value(scope) for key, value in named.items()}
            yield from timed(*given, **by_name) if timed is not None else self._call(name, given, by_name)

        return go

    def _call(self, name: str, given: list[Any], by_name: dict[str, Any]) -> Wait:
        if name not in self._own:
            raise ScriptError(f"there is no function '{name}'")
        parameters, body = self._own[name]
        scope: Scope = {"": self._globals, **dict(zip(parameters, given, strict=False)), **by_name}
        try:
            yield from body(scope)
        except _Leave as leave:
            if leave.kind not in ("return", "halt"):
                raise ScriptError(f"'{leave.kind}' outside a loop") from None
            if leave.kind == "halt":
                raise

    def _define(self) -> Statement:
        name = self._line[1][1] if len(self._line) > 1 else ""
        parameters = [word for kind, word in self._line[2:] if kind == "name"]
        if not name.isidentifier() or self._line[-1][1] != ":":
            raise ScriptError(f"line {self._number}: expected 'def NAME():'")
        self._own[name] = (parameters, _nothing)  # so that its body may call it
        body = self._block(("end",))
        self._at += 1
        self._own[name] = (parameters, body)

        def run(scope: Scope) -> Wait:
            yield from ()

        return run

    def _if(self) -> Statement:
        branches: list[tuple[Expression, Statement]] = []
        otherwise: Statement | None = None
        word = "if"
        while word != "end":
            self._column = 1
            if word == "else":
                self._expect(":")
                self._ended()
                otherwise = self._block(("end",))
            else:
                condition = self._expression()
                self._expect(":")
                self._ended()
                branches.append((condition, self._block(("elif", "else", "end"))))
            self._number, self._line = self._lines[self._at]
            self._at += 1
            word = self._line[0][1]

        def run(scope: Scope) -> Wait:
            for condition, body in branches:
                if condition(scope):
                    yield from body(scope)
                    return
            if otherwise is not None:
                yield from otherwise(scope)

        return run

    def _while(self) -> Statement:
        self._column = 1
        condition = self._expression()
        self._expect(":")
        self._ended()
        body = self._block(("end",))
        self._at += 1
        budget = self.budget

        def run(scope: Scope) -> Wait:
            while condition(scope):
                budget[0] -= 1
                if budget[0] < 0:
                    raise ScriptError("a loop runs on without letting time pass")
                try:
                    yield from body(scope)
                except _Leave as leave:
                    if leave.kind == "break":
                        return
                    if leave.kind != "continue":
                        raise

        return run

    def _leave(self, word: str) -> Statement:
        self._column = 1
        value = self._whole() if len(self._line) > 1 else None

        def run(scope: Scope) -> Wait:
            yield from ()
            raise _Leave(word, value(scope) if value is not None else None)

        return run


def _nothing(scope: Scope) -> Wait:
    yield from ()
