"""A controller's RTDE server: several clients, each with its own outputs, its claims on inputs, and its rate."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from srl.drivers.ur import rtde
from srl.drivers.ur.recipe import IN_USE, NOT_FOUND, Recipe, input_type, output_type
from srl.drivers.ur.rtde import Kind, Message, Parser
from srl.runtime.contracts.signals import Array
from srl.sim.devices.shared.sockets import Client, TcpDoor
from srl.sim.devices.ur.twin_registers import Registers

_RATE = 500.0


class RtdeServer:
    """The RTDE server, version 2 only; disconnects a client that sends invalid data or reads too slowly.

    Attributes:
        version: the answer to `v`.
        seen: messages received, by their letter.
        dropped: number of clients disconnected.
    """

    def __init__(self, door: TcpDoor, registers: Registers) -> None:
        self.door, self.registers = door, registers
        self.version = (5, 11, 0, 0)
        self.seen: dict[str, int] = {}
        self.dropped = 0
        self.claims: dict[str, _Connection] = {}
        self._connections: list[_Connection] = []

    def receive(self) -> None:
        """Accepts new clients and takes what clients have sent."""
        self._connections += [_Connection(self, client) for client in self.door.accept()]
        for connection in self._connections:
            connection.receive()
        gone = [connection for connection in self._connections if connection.client.gone]
        if gone:
            self._connections = [connection for connection in self._connections if not connection.client.gone]
            self.claims = {name: owner for name, owner in self.claims.items() if owner not in gone}

    def send(self, number: int, values: Array) -> None:
        """Sends sample `number` to the clients for which it is due."""
        for connection in self._connections:
            connection.send(number, values)

    def remark(self, words: str, level: int) -> None:
        """Sends a text message to all clients."""
        for connection in self._connections:
            if connection.started:
                connection.client.write(rtde.remark(words, "twin", level))


class _Connection:
    def __init__(self, server: RtdeServer, client: Client) -> None:
        self.client = client
        self.started = False
        self._server = server
        self._parser = Parser(rtde.REQUESTS)
        self._inputs: dict[int, Recipe] = {}
        self._outputs: Recipe | None = None
        self._read: Callable[[int, Array], list[Any]] | None = None
        self._every = 1
        self._agreed = False

    def receive(self) -> None:
        for message in self._parser.feed(self.client.read()):
            letter = chr(message.kind)
            self._server.seen[letter] = self._server.seen.get(letter, 0) + 1
            self.client.write(self._answer(message), keep=True)
        if self._parser.resyncs:
            self._drop()

    def send(self, number: int, values: Array) -> None:
        if not self.started or self._read is None or self._outputs is None or number % self._every:
            return
        body = self._outputs.pack(self._read(number, values))
        self.client.write(rtde.message(Kind.DATA, b"\x01" + body))
        if self.client.lost:
            self._drop()

    def _drop(self) -> None:
        self._server.dropped += not self.client.gone
        self.client.reset()

    def _answer(self, message: Message) -> bytes:
        match message.kind:
            case Kind.PROTOCOL:
                self._agreed = message.body == struct.pack(">H", rtde.PROTOCOL)
                return rtde.accepted(Kind.PROTOCOL, self._agreed)
            case Kind.CONTROLLER:
                return rtde.version(self._server.version)
            case Kind.OUTPUTS:
                return self._set_outputs(message.body)
            case Kind.INPUTS:
                return self._claim(message.body)
            case Kind.START:
                self.started = self._read is not None or bool(self._inputs)
                return rtde.accepted(Kind.START, self.started)
            case Kind.PAUSE:
                self.started = False
                return rtde.accepted(Kind.PAUSE)
            case Kind.DATA:
                self._server.registers.write(self._inputs[message.body[0]].unpack(message.body))
        return b""

    def _set_outputs(self, body: bytes) -> bytes:
        if len(body) < 8:
            return rtde.recipe(Kind.OUTPUTS, 0, [NOT_FOUND])
        (rate,) = struct.unpack_from(">d", body)
        names = _names(body[8:])
        types = [output_type(name) for name in names]
        self._read = None
        if NOT_FOUND in types or not names or not 1.0 <= rate <= _RATE:
            return rtde.recipe(Kind.OUTPUTS, 0, types or [NOT_FOUND])
        self._outputs = Recipe(names, types)
        self._read = self._server.registers.reader(names)
        self._every = max(1, round(_RATE / rate))
        return rtde.recipe(Kind.OUTPUTS, 1, types)

    def _claim(self, body: bytes) -> bytes:
        names = _names(body)
        claims = self._server.claims
        types = [IN_USE if claims.get(name, self) is not self else input_type(name) for name in names]
        number = len(self._inputs) + 1
        if not names or NOT_FOUND in types or IN_USE in types or number > 255:
            return rtde.recipe(Kind.INPUTS, 0, types or [NOT_FOUND])
        claims.update(dict.fromkeys(names, self))
        recipe = self._inputs[number] = Recipe(names, types)
        self._parser.data[number] = recipe.message_size
        return rtde.recipe(Kind.INPUTS, number, types)


def _names(body: bytes) -> list[str]:
    return [name for name in body.decode("latin-1").split(",") if name]
