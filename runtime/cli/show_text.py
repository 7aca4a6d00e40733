"""The text of `srl check --all`: plain lines of at most 100 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from srl.runtime.contracts.printable import printable

Item = Mapping[str, Any]
WIDTH = 100  # columns
DEEPEST = 20  # steps down the tree of frames that are indented; each line names its parent
SECTIONS = {
    "devices": "the devices and their signals",
    "wiring": "the laws, the guard's limits and what stops the limb",
    "frames": "the tree of frames and the models",
}
_KINDS = {
    "root": "root",
    "link": "moves with the joints of {owner}",
    "body": "body of the simulated part {owner}",
    "device": "the own frame of the device {owner}",
}
_SLIDING = {"rad": "m", "rad/s": "m/s", "N m": "N"}
"""The unit of a joint that slides, where the others turn."""


def text(overview: Item, sections: Sequence[str]) -> list[str]:
    """The lines of these SECTIONS of `srl.runtime.overview.overview.overview`."""
    makers = {"devices": _devices, "wiring": _wiring, "frames": _frames}
    lines = [
        *_wrapped(0, f"{overview['profile']}: {overview['summary']}".rstrip(": ")),
        *_wrapped(0, f"rate {overview['rate_hz']:g} Hz, clock {overview['clock']}, start {_start(overview)}"),
    ]
    for choice, word in overview["chosen"].items():
        lines += _wrapped(0, f"choice {choice}: {word}")
    for section in sections:
        lines += ["", section.upper(), *makers[section](overview)]
    for key, begin in (("warnings", "warning: "), ("remarks", "")):
        lines += [line for each in overview[key] for line in _wrapped(0, begin + each)]
    return [printable(line) for line in lines]


def _start(overview: Item) -> str:
    if overview["start"] == "manual" or not overview["unseen"]:
        return str(overview["start"])
    return f"auto, but {', '.join(overview['unseen'])} has no position feedback: it waits for `srl start`"


def _wrapped(indent: int, line: str, more: int = 2) -> list[str]:
    """The line from this column on; what is too long goes on `more` columns further in."""
    begin, go_on = " " * indent, " " * (indent + more)
    return textwrap.wrap(line, WIDTH, initial_indent=begin, subsequent_indent=go_on, break_on_hyphens=False)


def _devices(overview: Item) -> Iterator[str]:
    for device in overview["devices"]:
        facts = [
            device["driver"],
            f"port {device['port']}" if device["port"] else "no port",
            "simulated" if device["simulated"] else "real",
        ]
        facts += [f"stale after {device['max_age']:g} s"] if device["max_age"] else []
        facts += ["its tick is the clock"] if device["paces"] else []
        facts += [f"links {', '.join(device['links'])}"] if device["links"] else []
        yield from _wrapped(2, f"{device['name']}: {', '.join(facts)}")
        named: dict[tuple[str, ...], str] = {}
        for signal in device["states"]:
            yield from _signal("state", signal, named)
        for signal in device["commands"]:
            feedback = f"measured by {signal['feedback']}" if signal["feedback"] else "not measured"
            home = f"home {_short(signal['home'])}" if signal["home"] else ""
            yield from _signal("command", signal, named, signal["kind"], feedback, home)
    for signal in overview["clients"]:
        yield from _wrapped(2, f"{signal['name'].partition('.')[0]}: client of the bus")
        yield from _signal("setpoint", signal, {}, f"stale after {signal['max_age']:g} s")
    if overview["untaken"]:
        yield from _wrapped(2, f"nothing takes {', '.join(overview['untaken'])}")


def _signal(role: str, signal: Item, named: dict[tuple[str, ...], str], *facts: str) -> Iterator[str]:
    """A signal and its elements. `named`: where elements were listed before, so that none is listed twice."""
    yield from _wrapped(4, f"{role} {signal['name']}: {', '.join([_form(signal), *filter(None, facts)])}")
    elements = tuple(signal["elements"])
    if elements in named:
        yield from _wrapped(6, f"elements as those of {named[elements]}")
    elif elements:
        named[elements] = signal["name"]
        yield from _wrapped(6, ", ".join(elements), 0)


def _form(signal: Item) -> str:
    """Shape, unit and frame: "5x3 m in hand"."""
    shape = "x".join(map(str, signal["shape"])) or "one number,"
    words = f"{shape} {signal['unit']}"
    if signal.get("slides") and signal["unit"] in _SLIDING:
        words += f" ({', '.join(signal['slides'])}: {_SLIDING.get(signal['unit'], signal['unit'])})"
    words += f" in {signal['frame']}" if signal["frame"] else ""
    return words + (f" of {signal['of']}" if signal.get("of") else "")


def _values(values: Mapping[str, float | None]) -> str:
    return ", ".join(f"{name} {_number(value)}" for name, value in values.items())


def _as_text(value: object) -> str:
    """An option's value as a profile would have it, without quotes."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_as_text(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_as_text, value)) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"


def _wiring(overview: Item) -> Iterator[str]:
    if not overview["laws"]:
        yield "  no law: what the devices give goes to the bus and the recording"
    for number, law in enumerate(overview["laws"], 1):
        yield from _wrapped(2, f"{number}. {law['name']} ({law['use']}): {law['summary']}")
        for wire in law["reads"]:
            yield from _wire(f"reads {wire['port']:<14} <- {' + '.join(wire['signals'])}", wire)
        for need in law["needs"]:
            by = f", measured by {', '.join(need['measured_by'])}" if need["measured_by"] else ""
            begin = f"needs {need['name'].partition('.')[2]:<14} {need['of']} in {need['into']}"
            yield from _wrapped(4, f"{begin}, from {need['from']}{by}")
        for wire in law["writes"]:
            verb = "commands" if wire["commands"] else "writes"
            yield from _wire(f"{verb} {wire['port']} -> {' + '.join(wire['signals'])}", wire)
        for p in law["parameters"]:
            unit = f" {p['unit']}" * (p["unit"] != "1")
            bounds = f"{_number(p['lower'])} to {_number(p['upper'])}{unit}"
            yield from _wrapped(4, f"live {p['name']}: {_number(p['default'])}{unit} ({bounds}): {p['text']}")
    if overview["commands"]:
        line = "limits: the narrower of the profile's and the driver's; a device may narrow them once it is open"
        yield from _wrapped(2, line)
    for command in overview["commands"]:
        yield from _guard(command)
    yield from _stops(overview["stops"])


def _wire(line: str, wire: Item) -> Iterator[str]:
    yield from _wrapped(4, f"{line}: {wire['form']}")
    if wire["elements"]:
        yield from _wrapped(6, "by name: " + ", ".join(f"{start} -> {end}" for start, end in wire["elements"]))


def _guard(command: Item) -> Iterator[str]:
    yield from _wrapped(2, f"guard {command['name']}: {command['kind']}, {command['unit']}; stop: {command['stop']}")
    if command["limits"]:
        yield from _table(command["limits"])
    if command["kind"] != "intensity" and not {"lower", "upper"} & set(command["limits"]):
        yield "    no bound of the position before the device is open"
    if (following := command["following_error"]) is not None:
        far = f"further from its command than {_short(following['window'])} for {following['timeout']:g} s"
        yield from _wrapped(4, f"following error: it stops if it is {far}")
    if (clear := command["clear"]) is not None:
        lag = f"lag {clear['lag']:g} s, tracking {_short(clear['tracking'])}"
        yield from _wrapped(4, f"keeps clear ({clear['use']}): {clear['summary']}; {lag}")
        if clear["options"]:
            yield from _wrapped(6, ", ".join(f"{key} {_as_text(value)}" for key, value in clear["options"].items()))
        for wire in clear["reads"]:
            yield from _wire(f"reads {wire['port']:<14} <- {' + '.join(wire['signals'])}", wire)


def _short(values: Mapping[str, float | None]) -> str:
    """One number where all elements have the same."""
    alone = set(values.values())
    return _number(alone.pop()) if len(alone) == 1 else _values(values)


def _table(limits: Mapping[str, Item]) -> Iterator[str]:
    """A row for each element, a column for each limit; units in the head, or beside what has another one."""
    elements = list(next(iter(limits.values()))["values"])
    units = {name: limit["units"][elements[0]] for name, limit in limits.items()}
    rows = [["", *limits], ["", *(unit for unit in units.values())]]
    for element in elements:
        cells = []
        for name, limit in limits.items():
            unit = limit["units"][element]
            cells.append(_number(limit["values"][element]) + (f" {unit}" if unit != units[name] else ""))
        rows.append([element, *cells])
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        line = "    " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield from [line.rstrip()] if len(line.rstrip()) <= WIDTH else _wrapped(4, " ".join(row))


def _stops(stops: Item) -> Iterator[str]:
    reactions = stops["reactions"]
    for entry in stops["emergency"]:
        at = f"{entry['signal']}[{entry['element']}]" if entry["element"] else entry["signal"]
        yield from _wrapped(2, f"emergency {at} at {entry['when']:g}: {_reaction(entry['category'])}")
    if not stops["emergency"]:
        yield "  no emergency input"
    for entry in stops["intent_of"]:
        age = f"lost, or older than {entry['max_age']:g} s" if entry["max_age"] else "lost"
        yield from _wrapped(2, f"intent loss, {entry['name']} {age}: {_reaction(reactions['intent-loss'])}")
    others = {k: v for k, v in reactions.items() if k not in ("intent-loss", "overrun")}
    yield from _wrapped(2, "; ".join(f"{k.replace('-', ' ')}: {_reaction(v)}" for k, v in others.items()))
    late = reactions["overrun"]
    yield from _wrapped(2, f"overruns within {late['window']:g} s: {late['tolerate']} tolerated, {late['stop']} stop")
    for entry in stops["reset"]:
        at = f"{entry['signal']}[{entry['element']}]" if entry["element"] else entry["signal"]
        yield from _wrapped(2, f"reset by {at} at {entry['when']:g}")


def _reaction(word: str) -> str:
    return "each command's own stop" if word == "stop" else word


def _frames(overview: Item) -> Iterator[str]:
    if not overview["frames"]:
        yield "  no frame"
    for frame in overview["frames"]:
        column = 2 + 2 * min(frame["depth"], DEEPEST)
        yield from _wrapped(column, f"{frame['name']}: {_place(frame)}", 4)
        for line in _attached(frame):
            yield from _wrapped(column + 4, line)
    for part in overview["parts"]:
        if part["at"] is None:
            yield from _wrapped(2, f"in the simulated world: part {_part(part)}", 4)
    for model in overview["models"]:
        options = "; ".join(f"{key} {_as_text(value)}" for key, value in model["options"].items())
        yield from _wrapped(2, f"model {model['name']} ({model['kind']}): {options or 'the standard one'}")


def _place(frame: Item) -> str:
    """Where a frame is, in the words of the profile."""
    if frame["kind"] in _KINDS:
        return _KINDS[frame["kind"]].format(owner=frame["name"].partition("/")[0])
    line = f"in {frame['parent']}, "
    if frame["measured_by"]:
        fast = f" (believed up to {frame['fastest']:g} m/s)" if frame["fastest"] else ""
        line += f"measured by {frame['measured_by']}{fast}"
        if frame["pose"] == [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]:
            return line
        return f"{line}; what measures it is at {_pose(frame)}"
    return f"{line}fixed: {_pose(frame)}"


def _pose(frame: Item) -> str:
    position = f"position {_list(frame['position'])} m"
    if frame["rpy"]:
        return f"{position}, rpy {_list(frame['rpy'])} rad"
    if frame["quaternion"]:
        return f"{position}, quaternion {_list(frame['quaternion'])} (rpy {_list(frame['turned'])} rad)"
    return f"{position}, not turned"


def _list(values: Iterable[float]) -> str:
    return ", ".join(f"{value + 0.0:.5g}" for value in values)


def _attached(frame: Item) -> Iterator[str]:
    for part in frame["parts"]:
        yield f"simulated part {_part(part)}"
    if frame["devices"]:
        yield f"device {', '.join(frame['devices'])}"
    if frame["of"]:
        yield f"its own motion or force: {', '.join(frame['of'])}"
    if frame["in"]:
        yield f"given in it: {', '.join(frame['in'])}"
    if frame["used_by"]:
        yield f"used by {', '.join(frame['used_by'])}"


def _part(part: Item) -> str:
    at = "" if part["pose"] == [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] else f" at {_list(part['pose'][:3])} m"
    turn = f", quaternion {_list(part['pose'][3:])}" if part["pose"][3:] != [1.0, 0.0, 0.0, 0.0] else ""
    return f"{part['name']} ({part['part']}){at}{turn}"
