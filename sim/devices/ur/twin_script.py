"""A small URScript: enough of the language to run the driver's control program and other short programs.

Statements: assignment, also to an element of a list, `def` with parameters, `if`/`elif`/`else`, `while`, `return`,
`break`, `continue`, calls, threads with `run`, `kill` and `join`. A thread runs until it lets time pass, so nothing
interrupts it within a critical section. No structures, matrices, or calls that take time within a longer expression.
Source of the language's facts: protocol sheet ur-rtde, section 5.1; URScript manual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from srl.sim.devices.ur.twin_expressions import ScriptError
from srl.sim.devices.ur.twin_program_text import name_of
from srl.sim.devices.ur.twin_statements import BUDGET, Leave, Statements, Thread, Wait


class Script:
    """One parsed program, ready to run.

    Attributes:
        name: the program's name.
        current: the thread that runs at present.
    """

    def __init__(
        self,
        text: str,
        functions: Mapping[str, Callable[..., Any]],
        motions: Mapping[str, Callable[..., Wait]],
        killed: Callable[[Thread], None] = lambda thread: None,
    ) -> None:
        """
        Args:
            text: a `def NAME(): ... end`, or single lines.
            functions: functions that take no time.
            motions: generators; each `yield` is the end of a control cycle.
            killed: called with each thread that the program kills.
        Raises:
            ScriptError: the text isn't a program that this interpreter understands.
        """
        self.name = name_of(text)
        try:
            reader = Statements(text, functions, motions)
            block = reader.program()
        except (RecursionError, IndexError):
            raise ScriptError("the program is nested too deeply, or cut short") from None
        self._main = Thread(block({}) if not self.name else reader.main(self.name))
        self._threads = reader.threads
        self._budget = reader.budget
        self.current = self._main
        reader.on_kill = killed

    def cycle(self) -> bool:
        """Runs one control cycle; returns False once the program has ended.

        Raises:
            ScriptError: the program can't continue.
        """
        self._budget[0] = BUDGET
        try:
            if not self._turn(self._main):
                return False
            for thread in list(self._threads):
                thread.alive = thread.alive and self._turn(thread)
            self._threads[:] = [thread for thread in self._threads if thread.alive]
        except ScriptError:
            raise
        except RecursionError:
            raise ScriptError(f"{self.name}: functions call each other too deeply") from None
        except (Leave, TypeError, ValueError, KeyError, IndexError, ArithmeticError) as error:
            raise ScriptError(f"{self.name}: {error}") from None
        return True

    def _turn(self, thread: Thread) -> bool:
        """Runs a thread until it lets time pass; returns False once it has ended."""
        self.current = thread
        return next(thread.steps, self) is not self
