"""The live parameters of the laws as parameters of the node, by the six services of rcl_interfaces.

Each is a double, by the name that it has on the bus. Source: ROS 2, rcl_interfaces/srv.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import SrlError, nearest
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages import cdr
from srl.runtime.ros2.inbox import Inbox, Item, Lane
from srl.runtime.ros2.names import PARAMETERS
from srl.runtime.ros2.node import Call, Node

SPARE: Final = 16  # names that may be unknown
NOT_SET, INTEGER, DOUBLE = 0, 2, 3  # rcl_interfaces/msg/ParameterType
_EMPTY: Final = {
    "type": NOT_SET, "bool_value": False, "integer_value": 0, "double_value": 0.0, "string_value": "",
    "byte_array_value": (), "bool_array_value": (), "integer_array_value": (), "double_array_value": (),
    "string_array_value": (),
}  # fmt: skip


class Parameters:
    """The services; see the module's docstring."""

    def __init__(
        self, node: Node, inbox: Inbox, layout: Layout, row: Callable[[], NDArray[np.int64] | None],
        change: Callable[[str, float], Any] | None,
    ) -> None:  # fmt: skip
        """
        Args:
            row: gives the newest row, which holds the values.
            change: sets a parameter by its name, and raises SrlError where it can't; None: nobody may.
        """
        self._layout, self._row, self._change = layout, row, change
        self._inbox = inbox
        self._known: dict[str, dict[str, Any]] = {entry["name"]: entry for entry in layout.meta.get("parameters", [])}
        for service, work in (
            ("GetParameters", self._get), ("GetParameterTypes", self._types), ("DescribeParameters", self._describe),
            ("ListParameters", self._list), ("SetParameters", self._set),
            ("SetParametersAtomically", self._set_atomically),
        ):  # fmt: skip
            name = "".join(f"_{c.lower()}" if c.isupper() else c for c in service)[1:]
            hand_over = inbox.requests(partial(self._serve, PARAMETERS + service, work), Lane.PARAMETERS)
            node.service(f"{node.name.name}/{name}", PARAMETERS + service, hand_over)

    def _serve(self, kind: str, work: Callable[[dict[str, Any], Item], dict[str, Any]], item: Item) -> None:
        call: Call = item.what
        request = cdr.decode(f"{kind}_Request", call.payload)
        for given in request.values():  # names or parameters; nobody may keep the node busy with more than there are
            if isinstance(given, list):
                del given[len(self._known) + SPARE :]
        call.answer(cdr.encode(f"{kind}_Response", work(request, item)))

    def _get(self, request: dict[str, Any], _: Item) -> dict[str, Any]:
        return {"values": [self._value(name) for name in request["names"]]}

    def _value(self, name: str) -> dict[str, Any]:
        row = self._row()
        if name not in self._known or row is None:
            return _EMPTY
        return _EMPTY | {"type": DOUBLE, "double_value": float(self._layout.value(row, name).item())}

    def _types(self, request: dict[str, Any], _: Item) -> dict[str, Any]:
        return {"types": [DOUBLE if name in self._known else NOT_SET for name in request["names"]]}

    def _describe(self, request: dict[str, Any], _: Item) -> dict[str, Any]:
        return {"descriptors": [self._descriptor(name) for name in request["names"]]}

    def _descriptor(self, name: str) -> dict[str, Any]:
        known = self._known.get(name)
        made: dict[str, Any] = {
            "name": name, "type": NOT_SET, "description": "", "additional_constraints": "", "read_only": True,
            "dynamic_typing": False, "floating_point_range": [], "integer_range": [],
        }  # fmt: skip
        if known is not None:
            bounds = {"from_value": known["lower"], "to_value": known["upper"], "step": 0.0}
            made |= {"type": DOUBLE, "read_only": self._change is None, "floating_point_range": [bounds]}
            made["description"] = f"{known['text']} [{known['unit']}]"
        return made

    def _list(self, request: dict[str, Any], _: Item) -> dict[str, Any]:
        prefixes, depth = request["prefixes"], request["depth"] or np.inf

        def listed(name: str) -> bool:
            below = [name.removeprefix(f"{p}.") for p in prefixes if name.startswith(f"{p}.")] if prefixes else [name]
            return name in prefixes or any(rest.count(".") < depth for rest in below)

        names = [name for name in self._known if listed(name)]
        owners = sorted({name.rpartition(".")[0] for name in names} - {""})
        return {"result": {"names": names, "prefixes": owners}}

    def _set(self, request: dict[str, Any], item: Item) -> dict[str, Any]:
        results = []
        for parameter in request["parameters"]:
            reason = self._refusal(parameter) or self._apply(parameter, item)
            results.append({"successful": not reason, "reason": reason})
        return {"results": results}

    def _set_atomically(self, request: dict[str, Any], item: Item) -> dict[str, Any]:
        """Only one at a time can be set so: the loop takes each by itself."""
        given = request["parameters"]
        reason = "several parameters can't be set at once: set each by itself" if len(given) > 1 else ""
        for parameter in given[:1]:
            reason = reason or self._refusal(parameter) or self._apply(parameter, item)
        return {"result": {"successful": not reason, "reason": reason}}

    def _refusal(self, parameter: dict[str, Any]) -> str:
        name, kind = parameter["name"], parameter["value"]["type"]
        if name not in self._known:
            return f"there is no parameter '{name}'. {nearest(name, self._known)}"
        if self._change is None:
            return "peers may change nothing: the profile's bus.ros2.commands is off"
        return "" if kind in (INTEGER, DOUBLE) else f"'{name}' takes a number, and a value of type {kind} came"

    def _apply(self, parameter: dict[str, Any], item: Item) -> str:
        """Sets it; returns why it couldn't be, or ""."""
        assert self._change is not None
        if self._inbox.overtaken(item):
            return "a stop came after it: ask again"
        value = parameter["value"]
        try:
            self._change(parameter["name"], value["double_value" if value["type"] == DOUBLE else "integer_value"])
        except SrlError as error:
            return str(error)
        return ""
