"""Matches the elements at the two ends of a wire by their names, never by their places."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import FORCE, WRENCH
from srl.runtime.ipc.layout import Layout

_WRENCH = "N, N m"  # the unit of a signal that has forces, N, and torques, N m


@dataclass(frozen=True)
class Link:
    """One wire.

    Attributes:
        near: the signal at the near end: a controller's input or output, or a command that has a feedback.
        name: the near end's full name.
        far: full names of the signals at the far end.
        rows: for each of the near signal's rows, the far signal and its row there. None: the one far signal, whole
            and in its own order.
    """

    near: Signal
    name: str
    far: tuple[str, ...]
    rows: tuple[tuple[str, int], ...] | None = None

    def beside(self, ending: str) -> Link:
        """The same link to the signals that have this ending besides: `.applied`."""
        rows = None if self.rows is None else tuple((name + ending, row) for name, row in self.rows)
        return replace(self, far=tuple(name + ending for name in self.far), rows=rows)

    def index(self, layout: Layout) -> NDArray[np.intp]:
        """The places of the near signal's elements among the row's float64 words; not for a link without `rows`."""
        found: list[int] = []
        for name, row in self.rows or ():
            field = layout.fields[name]
            width = field.size // field.shape[0]
            found += range(field.offset + row * width, field.offset + (row + 1) * width)
        return np.array(found, np.intp)


def link(
    near: Signal, name: str, far: Mapping[str, Signal], renamed: Mapping[str, str], place: str, key: str = "from"
) -> Link:
    """Finds each element of the near signal among those of the far ones.

    Args:
        near: the signal; shapes, units, frames and components must fit each far one.
        name: its full name.
        far: by their full names.
        renamed: the wire's `map`.
        place: of the wire, for errors.
        key: "from" or "to", for the remedy.
    Raises:
        WiringError: something differs; both sides are named.
    """
    for other, signal in far.items():
        _compare(near, name, signal, other, place, whole=_is_whole(near, signal))
    names = tuple(far)
    first = far[names[0]]
    if any(_is_whole(near, signal) for signal in far.values()):
        if len(far) > 1 or renamed or near.slots != first.slots:
            raise WiringError(
                place,
                f"{name} {_has(near)}, {', '.join(names)} {_has(first)}: without names on both sides nothing is mapped",
                "Wire one signal as a whole to a port of its kind, or give both sides labels",
            )
        return Link(near, name, names)
    there = elements(far)
    if len(there) < sum(len(signal.names) for signal in far.values()):
        raise WiringError(place, f"two elements of {', '.join(names)} have one name", "Name their elements apart")
    alone = near.shape[:1] == first.shape[:1] == (1,) and len(far) == 1
    if alone and not renamed and not (near.labels and first.labels) and near.unit == first.unit:
        return Link(near, name, names)
    if unknown := [n for n in renamed if n not in near.names]:
        raise WiringError(place, f"its map names '{unknown[0]}', {name} has {_list(near.names)}", "Correct the map")
    wanted = [renamed.get(n, n) for n in near.names]
    if missing := [n for n in wanted if n not in there]:
        raise WiringError(
            place,
            f"names differ: {name} has {_list(near.names)}; {', '.join(names)} has {_list(there)}, no '{missing[0]}'",
            "Use the same names on both sides, or say which is which: "
            + _example(key, names, near.names[wanted.index(missing[0])]),
        )
    if twice := next((n for n in wanted if wanted.count(n) > 1), None):
        raise WiringError(place, f"'{twice}' stands for two elements of {name}", "Map each to one of its own")
    rows = tuple(there[n] for n in wanted)
    _compare_units(near, name, far, rows, place)
    _compare_slides(near, name, far, rows, place)
    if len(far) == 1 and rows == tuple((names[0], i) for i in range(first.shape[0])):
        return Link(near, name, names)
    return Link(near, name, names, rows)


def _compare_units(
    near: Signal, name: str, far: Mapping[str, Signal], rows: tuple[tuple[str, int], ...], place: str
) -> None:
    """Element by element, where one end has a wrench and the other forces or torques: `_compare` lets these pass."""
    for own, (other, row) in zip(near.names, rows, strict=True):
        signal = far[other]
        here, there = _unit(near, own), _unit(signal, signal.names[row])
        if near.unit != signal.unit and here != there:
            problem = f"units differ: {other}[{signal.names[row]}] has '{there}', {name}[{own}] has '{here}'"
            raise WiringError(place, problem, "Wire forces to forces (N), and torques to torques (N m)")


def _unit(signal: Signal, element: str) -> str:
    if signal.unit != _WRENCH:
        return signal.unit
    return "N" if element in FORCE else "N m" if element in WRENCH else _WRENCH


def _compare_slides(
    near: Signal, name: str, far: Mapping[str, Signal], rows: tuple[tuple[str, int], ...], place: str
) -> None:
    for joint, (other, row) in zip(near.labels, rows, strict=False):
        signal = far[other]
        if (
            near.slides is None
            or signal.slides is None
            or (joint in near.slides) == (signal.names[row] in signal.slides)
        ):
            continue
        here, there = ("slides", "turns") if joint in near.slides else ("turns", "slides")
        raise WiringError(
            place,
            f"{joint} of {name} {here}, {signal.names[row]} of {other} {there}: one would be in m, the other in rad",
            "Say it at the device (`m_per_rad` of a Dynamixel motor that slides), or in the arms' `slides`",
        )


def elements(signals: Mapping[str, Signal]) -> dict[str, tuple[str, int]]:
    """Each element's name -> (signal, row). A name that several have begins with the device: left.joint1."""
    owners = [name.partition(".")[0] for name in signals]
    count = [n for signal in signals.values() for n in signal.names]
    found = {}
    for name, signal in signals.items():
        owner = name.partition(".")[0]
        prefix = owner if owners.count(owner) == 1 else name
        for row, element in enumerate(signal.names):
            found[element if count.count(element) == 1 else f"{prefix}.{element}"] = (name, row)
    return found


def _example(key: str, far: tuple[str, ...], name: str) -> str:
    ends = far[0] if len(far) == 1 else f"[{', '.join(far)}]"
    return f"{{{key}: {ends}, map: {{{name}: NAME}}}}"


def _is_whole(near: Signal, far: Signal) -> bool:
    """Whether names play no part: slots, and numbers without an axis."""
    return near.slots or far.slots or not near.shape or not far.shape


def _compare(near: Signal, name: str, far: Signal, other: str, place: str, whole: bool) -> None:
    start = 0 if whole else 1
    units = {near.unit, far.unit}
    parts = not whole and _WRENCH in units and units <= {_WRENCH, "N", "N m"}
    for what, a, b in (
        ("shapes", _text(far.shape[start:]), _text(near.shape[start:])),
        ("units", "" if parts else f"'{far.unit}'", "" if parts else f"'{near.unit}'"),
        ("components", _each(far.components), _each(near.components)),
    ):
        if a != b:
            raise WiringError(
                place,
                f"{what} differ: {other} has {a}, {name} has {b}",
                "Wire another signal, or change the options that decide this one's form",
            )
    if far.frame and near.frame and far.frame != near.frame:
        raise WiringError(
            place,
            f"frames differ: {other} is in '{far.frame}', {name} expects '{near.frame}'",
            "Wire a signal in that frame",
        )
    if far.of and near.of and far.of != near.of:
        raise WiringError(
            place, f"{other} is that of frame '{far.of}', {name} expects that of '{near.of}'", "Wire one of that frame"
        )


def _has(signal: Signal) -> str:
    return "has slots" if signal.slots else f"has {_list(signal.names)}"


def _text(shape: tuple[int, ...]) -> str:
    return "x".join(map(str, shape)) or "one number"


def _each(components: tuple[tuple[str, ...], ...]) -> str:
    return " by ".join(map(_list, components))


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "one number without a name"
