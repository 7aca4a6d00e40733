"""RTDE's handshake: versions, the two recipes, start. Blocks: for `open` only."""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from typing import Final

from srl.drivers.transport import Transport
from srl.drivers.ur import rtde
from srl.drivers.ur.recipe import IN_USE, NOT_FOUND, Recipe
from srl.drivers.ur.rtde import Kind, Message, Parser
from srl.runtime.contracts.errors import DeviceError

ANSWER: Final = 3.0  # s
MEASURED: Final = (5, 23)  # version from which the controller sends measured torques
_NOT_RTDE: Final = "Check 'port'; enable RTDE at the pendant under Settings > Security > Services"


class Handshake:
    """The handshake on one connection.

    Attributes:
        parser: the parser of all incoming bytes.
        version: the controller's: major, minor, bug fix, build.
        text: the newest text message received during the handshake.
    """

    def __init__(self, link: Transport, place: str) -> None:
        self.parser = Parser(rtde.ANSWERS)
        self.version = (0, 0, 0, 0)
        self.text = ""
        self._link, self._place = link, place
        self._early: list[Message] = []

    def greet(self) -> None:
        """Agrees on protocol 2. Raises DeviceError if there is no RTDE, or one that is too old."""
        if self._ask(Kind.PROTOCOL, rtde.ask_protocol())[0] != 1:
            raise DeviceError(self._place, "the controller doesn't know RTDE 2", "Update PolyScope to 5.x")
        major, minor, fix, build = struct.unpack(">4I", self._ask(Kind.CONTROLLER, rtde.ask_controller()))
        self.version = (major, minor, fix, build)

    def require(self, effort: str) -> None:
        """Checks the controller's version.

        Raises:
            DeviceError: another series, or too old for `effort: measured`.
        """
        shown = ".".join(map(str, self.version[:3]))
        if self.version[0] != 5:
            raise DeviceError(
                self._place,
                f"the controller's version is {shown}; this driver speaks to the e-Series (5.x), not to a CB3",
                "Use an e-Series controller",
            )
        if effort == "measured" and self.version[:2] < MEASURED:
            raise DeviceError(
                self._place,
                f"PolyScope {shown} doesn't give measured torques",
                "Update it to 5.23 or set 'effort: target'",
            )

    def outputs(self, rate: float, names: Sequence[str], types: Sequence[str]) -> tuple[int, Recipe]:
        """Requests output variables; returns the recipe's number and layout.

        Raises:
            DeviceError: a variable has another type, or is unknown.
        """
        return self._agree(Kind.OUTPUTS, rtde.ask_outputs(rate, names), names, types)

    def inputs(self, names: Sequence[str], types: Sequence[str]) -> tuple[int, Recipe]:
        """Claims inputs; returns the recipe's number and layout. Raises DeviceError if one is unknown or in use."""
        return self._agree(Kind.INPUTS, rtde.ask_inputs(names), names, types)

    def start(self, number: int, recipe: Recipe) -> Message:
        """Starts the data and returns the first data message."""
        self.parser.data[number] = recipe.message_size
        if self._ask(Kind.START, rtde.start())[0] != 1:
            raise DeviceError(self._place, "the controller doesn't start RTDE's data", "See the pendant's log")
        self.parser.only(rtde.STREAM)
        return self._await(Kind.DATA)

    def _agree(self, kind: Kind, request: bytes, names: Sequence[str], types: Sequence[str]) -> tuple[int, Recipe]:
        answer = self._ask(kind, request)
        types_got = answer[1:].decode("ascii", "replace").split(",")
        if IN_USE in types_got:
            taken = names[types_got.index(IN_USE)] if len(types_got) == len(names) else "an input"
            raise DeviceError(
                self._place,
                f"another client holds the arm's inputs ({taken})",
                "End the other program (a second service, a PLC or fieldbus that claims the upper registers)",
            )
        wrong = [f"{name} ({got})" for name, got, wanted in zip(names, types_got, types, strict=False) if got != wanted]
        if wrong or len(types_got) != len(names):
            absent = NOT_FOUND in types_got
            raise DeviceError(
                self._place,
                f"the controller has no {', '.join(wrong)}" if absent else f"RTDE answers {','.join(types_got)[:120]}",
                f"PolyScope is {'.'.join(map(str, self.version[:3]))}; update it" if absent else _NOT_RTDE,
            )
        return answer[0], Recipe(names, types_got)

    def _ask(self, kind: Kind, request: bytes) -> bytes:
        self._link.write_all(request, ANSWER)
        return self._await(kind).body

    def _await(self, kind: Kind) -> Message:
        deadline = time.monotonic() + ANSWER
        heard = b""
        while (left := deadline - time.monotonic()) > 0:
            while self._early:
                message = self._early.pop(0)
                if message.kind == kind:
                    return message
                if message.kind == Kind.TEXT and (remark := rtde.text(message.body)):
                    self.text = remark.text
            data = self._link.read_wait(left)
            heard = (heard + data)[:12]
            self._early += self.parser.feed(data)
        got = f"the bytes {heard.hex(' ')}" if heard else "nothing"
        raise DeviceError(
            self._place, f"expected RTDE's answer '{chr(kind)}' at {self._link.url}, got {got}", _NOT_RTDE
        )
