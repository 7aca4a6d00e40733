"""URScript's statements, parsed from lines into closures that run until time passes."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from typing import Any, Final

from srl.sim.devices.ur.twin_expressions import Expression, Expressions, Scope, ScriptError, copied
from srl.sim.devices.ur.twin_program_text import statements

BUDGET: Final = 20_000  # statements in one control cycle; a real controller stops much sooner

Wait = Generator[None, None, Any]
Statement = Callable[[Scope], Wait]


class Leave(Exception):  # noqa: N818
    """break, continue and return, while they leave their block."""

    def __init__(self, kind: str, value: Any = None) -> None:
        super().__init__(kind)
        self.kind, self.value = kind, value


class Thread:
    """A running thread; `alive` until it has ended or was killed."""

    def __init__(self, steps: Wait) -> None:
        self.steps = steps
        self.alive = True


class Statements(Expressions):
    """A recursive-descent parser of lines; it makes closures."""

    def __init__(
        self, text: str, functions: Mapping[str, Callable[..., Any]], motions: Mapping[str, Callable[..., Wait]]
    ) -> None:
        super().__init__(functions)
        self._lines = statements(text)
        self._at = 0
        self._motions = motions
        self._own: dict[str, tuple[list[str], Statement]] = {}
        self.budget = [BUDGET]
        self.threads: list[Thread] = []
        self.on_kill: Callable[[Thread], None] = lambda thread: None

    def program(self) -> Statement:
        """Parses all lines."""
        block = self._block(())
        if self._at < len(self._lines):
            raise ScriptError(f"line {self._lines[self._at][0]}: 'end' without a beginning")
        for name, number in self._called.items():
            if name not in self._own:
                raise ScriptError(f"line {number}: there is no function '{name}'")
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
            if word in ("def", "sec", "thread"):
                return self._define()
            if word == "if":
                return self._if()
            if word == "while":
                return self._while()
            if word in ("break", "continue", "return", "halt"):
                return self._leave(word)
            if word in ("enter_critical", "exit_critical"):
                return _nothing
            if word in ("kill", "join"):
                return self._kill_or_join(word)
            if word in ("struct", "for"):
                raise ScriptError(f"line {self._number}: this interpreter has no '{word}'")
            if word in ("global", "local"):
                self._column = 1
            if len(self._line) > self._column + 1:
                mark = self._line[self._column + 1][1]
                if mark == "=":
                    return self._assign(word == "global")
                if mark == "[":
                    return self._assign_element()
        self._column = 0
        return self._bare_call()

    def _assign(self, everywhere: bool) -> Statement:
        name = self._line[self._column][1]
        self._column += 2
        value = self._timed_value()
        everything = self._globals

        def run(scope: Scope) -> Wait:
            found = copied((yield from value(scope)))
            (everything if everywhere or (name in everything and name not in scope) else scope)[name] = found

        return run

    def _assign_element(self) -> Statement:
        name = self._line[self._column][1]
        self._column += 2
        index = self._expression()
        self._expect("]")
        self._expect("=")
        value = self._whole()
        everything = self._globals

        def run(scope: Scope) -> Wait:
            values = scope[name] if name in scope else everything.get(name)
            if not isinstance(values, list):
                raise ScriptError(f"'{name}' is no list")
            values[index(scope)] = value(scope)
            yield from ()

        return run

    def _timed_value(self) -> Statement:
        """The rest of the line as a value: an expression, or one call of the program's own, which may take time."""
        name, before = self._line[self._column][1] if self._column < len(self._line) else "", self._column
        if name.isidentifier() and name not in self._functions and name not in ("not", "run"):
            self._column += 1
            if self._accept("("):
                values, named = self._arguments()
                if self._column == len(self._line):
                    self._called.setdefault(name, self._number)
                    return lambda scope: self._call(
                        name, [value(scope) for value in values], {key: value(scope) for key, value in named.items()}
                    )
            self._column = before
        value = self._whole()

        def run(scope: Scope) -> Wait:
            yield from ()
            return value(scope)

        return run

    def _kill_or_join(self, word: str) -> Statement:
        self._column = 1
        value = self._whole()

        def run(scope: Scope) -> Wait:
            thread = value(scope)
            if not isinstance(thread, Thread):
                return
            while word == "join" and thread.alive:
                yield
            if thread.alive:
                thread.alive = False
                self.on_kill(thread)

        return run

    def _thread(self, name: str, given: list[Any]) -> Thread:
        thread = Thread(self._call(name, given, {}))
        self.threads.append(thread)
        return thread

    def _value_of(self, name: str, given: list[Any], by_name: dict[str, Any]) -> Any:
        steps = self._call(name, given, by_name)
        try:
            next(steps)
        except StopIteration as end:
            return end.value
        raise ScriptError(f"'{name}' takes time: assign its value to a variable first")

    def _bare_call(self) -> Statement:
        name = self._line[0][1]
        timed = self._motions.get(name)
        if timed is None and (name in self._functions or len(self._line) < 2 or self._line[1][1] != "("):
            value = self._whole()

            def run(scope: Scope) -> Wait:
                value(scope)
                yield from ()

            return run
        if timed is None:
            self._called.setdefault(name, self._number)
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
        scope: Scope = dict(zip(parameters, map(copied, given), strict=False))
        scope.update((key, copied(value)) for key, value in by_name.items())
        try:
            yield from body(scope)
        except Leave as leave:
            if leave.kind not in ("return", "halt"):
                raise ScriptError(f"'{leave.kind}' outside a loop") from None
            if leave.kind == "halt":
                raise
            return leave.value
        return None

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
                except Leave as leave:
                    if leave.kind == "break":
                        return
                    if leave.kind != "continue":
                        raise

        return run

    def _leave(self, word: str) -> Statement:
        self._column = 1
        value = self._timed_value() if len(self._line) > 1 else _nothing

        def run(scope: Scope) -> Wait:
            raise Leave(word, (yield from value(scope)))

        return run


def _nothing(scope: Scope) -> Wait:
    yield from ()
