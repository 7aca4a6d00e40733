"""The fault campaign: every profile, every device, every fault at random instants, and what the limb did.

A trial has one fault. What is expected of it was written before (`device_faults`, `process_faults`); a trial that
differs says how, in its column `wrong`, and counts as not as expected.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from statistics import median
from typing import Any, Final

from ruamel.yaml import YAML

from srl.runtime.profile import profile as profiles
from srl.runtime.testing.lab import Lab
from srl.sim.devices.examples import DEVICES
from srl.studies.faults import device_faults
from srl.studies.faults import wire_trial as wires
from srl.studies.faults.process_faults import FAULTS as PROCESS
from srl.studies.result import Claim, Result
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

STUDY: Final = "faults"
OF_CLIENT: Final = {"silent": "a client of the bus falls silent", "garbage": "a client asks for a million"}
# Trials of each cell of profile, device and fault. One of a fast profile takes 0.1 s, one at 1 kHz 5 s.
SLOW, CHOICE, PLAIN = 1, 5, 9
WIRE: Final = 3  # trials of each wire and fault; of another device at the port, one
TITLES: Final = {
    "faults-device": "A device or client fails",
    "faults-wire": "A wire fails",
    "faults-process": "A process or the host fails",
}
FAST: Final = 200.0  # Hz
MAIN: Final = "sixth-finger"  # the profile that has every fault of the processes
PROCESS_SEEDS: Final = 2
EVERYWHERE: Final = ("loop-killed", "supervisor-killed", "sigterm")  # those that every profile has
PART: Final = "This is a part of the campaign:"
SHOWN: Final = 30  # trials that are listed
Cell = tuple[str, list[str], str, str]


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs all trials; `quick`: two profiles, one trial of each cell, one run that is killed."""
    devices, processes = device_tasks(quick), process_tasks(quick)
    some = len(devices) // 10
    # A part of a campaign has some of everything.
    tasks = [
        *devices[:some],
        *processes[: len(PROCESS)],
        *wire_tasks(quick),
        *devices[some:],
        *processes[len(PROCESS) :],
    ]
    rows = runner.done(tasks, folder)
    table = [line for trial in TITLES for line in _table(rows, trial)]
    seeds = sorted({row.task.seed for row in rows})
    return Result(STUDY, True, seeds, claims=_claims(rows), table=table, page=page(rows, len(tasks)))


def variants() -> Iterator[tuple[str, list[str]]]:
    """Each shipped profile with each word of its choices, the other choices as the profile has them."""
    for file in sorted(resources.files("srl.profiles").iterdir(), key=lambda f: f.name):
        if not file.name.endswith(".yaml"):
            continue
        content = YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8"))
        name, choices = file.name.removesuffix(".yaml"), content.get("choices", {})
        yield name, []
        for choice, words in choices.items():
            yield from ((name, [f"{choice}={word}"]) for word in words if word != content[choice])


def cells(profile: str, choices: list[str]) -> tuple[bool, list[Cell]]:
    """Whether its trials are quick, and each device with each fault that it can have."""
    with Lab(profile, choices) as lab:
        graph = lab._graph
        found = [
            (profile, choices, device.name, kind)
            for i, device in enumerate(graph.devices)
            for kind in device_faults.kinds_of(graph, i)
        ]
        if lab.layout.meta["setpoints"]:
            found += [(profile, choices, device_faults.CLIENT, kind) for kind in OF_CLIENT]
        return graph.profile.rate <= FAST and not graph.clearances, found


def device_tasks(quick: bool = False) -> list[TrialTask]:
    """One task a trial of the devices' faults, the fast profiles' first, seed by seed."""
    found: list[tuple[tuple[bool, int], TrialTask]] = []
    for profile, choices in variants():
        if quick and profile not in (MAIN, "finger-jog"):
            continue
        fast, these = cells(profile, choices)
        text = profiles.find(profile)[1]
        for seed in range(1, 1 + (SLOW if quick or not fast else CHOICE if choices else PLAIN)):
            for name, words, device, kind in these:
                given = {"profile": name, "choices": words, "device": device, "fault": kind}
                found.append(
                    ((not fast, seed), TrialTask.of(STUDY, "faults-device", seed, given, profile=name, text=text))
                )
    return [task for _, task in sorted(found, key=lambda pair: pair[0])]


def wire_tasks(quick: bool = False) -> list[TrialTask]:
    """One task a trial of the wires, device by device."""
    found = []
    for seed in range(1, 1 + (SLOW if quick else WIRE)):
        for kind in DEVICES:
            if kind in wires.NOT or (quick and kind != "firmata"):
                continue
            for fault in wires.kinds_of(kind):
                others = [o for o in wires.OTHERS if o != kind and seed == 1]
                for other in others if fault == "other-device" else [""]:
                    given = {"kind": kind, "fault": fault, "other": other}
                    found.append(TrialTask.of(STUDY, "faults-wire", seed, given))
    return found


def process_tasks(quick: bool = False) -> list[TrialTask]:
    """One task a trial of the processes' and the host's faults."""

    def task(profile: str, fault: str, seed: int) -> TrialTask:
        given = {"profile": profile, "choices": [], "fault": fault}
        return TrialTask.of(STUDY, "faults-process", seed, given, profile=profile)

    if quick:
        return [task(MAIN, "loop-killed", 1)]
    found = [task(MAIN, fault, seed) for seed in range(1, 1 + PROCESS_SEEDS) for fault in PROCESS]
    others = [name for name, choices in variants() if not choices and name != MAIN]
    return found + [task(name, fault, 1) for fault in EVERYWHERE for name in others]


def _what(row: Row) -> str:
    """A row's fault, in words."""
    given = row.task.parameters
    if row.task.trial == "faults-process":
        return PROCESS[given["fault"]].what
    if row.task.trial == "faults-wire":
        return f"`{given['fault']}`: {wires.KINDS[given['fault']]}"
    if given["device"] == device_faults.CLIENT:
        return OF_CLIENT[given["fault"]]
    return f"`{given['fault']}`: {device_faults.KINDS[given['fault']]}"


def _table(rows: list[Row], trial: str) -> list[dict[str, Any]]:
    """A line a fault, in the catalogue's order."""
    order = [f"`{kind}`: {text}" for kind, text in device_faults.KINDS.items()]
    order += [f"`{kind}`: {text}" for kind, text in wires.KINDS.items()]
    order += [*OF_CLIENT.values(), *(fault.what for fault in PROCESS.values())]
    found: dict[str, list[Row]] = {}
    for row in rows:
        if row.task.trial == trial:
            found.setdefault(_what(row), []).append(row)
    return [_line(what, trial, found[what]) for what in order if what in found]


def _followed(row: Row) -> str:
    """What followed, in words."""
    entered, cause = str(row.values["entered"]), str(row.values["cause"])
    if row.task.trial == "faults-device":
        return "goes on" if entered == "active" else cause
    if entered == "refused" or row.task.trial == "faults-wire":
        return entered
    return f"{entered} ({cause})" if entered == "ended" else "the loop is dead"


def _line(what: str, trial: str, rows: list[Row]) -> dict[str, Any]:
    causes: dict[str, int] = {}
    for row in rows:
        key = _followed(row)
        causes[key] = causes.get(key, 0) + 1
    values = [row.values for row in rows]
    safe = [1e3 * float(v["safe"]) for v in values if v["safe"] is not None]
    return {
        "part": trial, "fault": what, "trials": len(rows),
        "of": len({str(row.task.parameters.get("kind", row.task.profile)) for row in rows}),
        "entered": ", ".join(f"{cause} {n}" for cause, n in sorted(causes.items(), key=lambda c: -c[1])),
        "safe p50, ms": median(safe) if safe else None, "safe most, ms": max(safe, default=None),
        "largest step": max(float(v["step"] or 0.0) for v in values),
        "recorded": sum(bool(v["recorded"]) for v in values), "not as expected": sum(bool(v["wrong"]) for v in values),
    }  # fmt: skip


def _claims(rows: list[Row]) -> list[Claim]:
    steps = [float(row.values["step"] or 0.0) for row in rows]
    wrong = sum(bool(row.values["wrong"]) for row in rows)
    recorded = sum(not row.values["recorded"] for row in rows)
    most = max(steps, default=0.0)
    return [
        Claim(id="within-limits", text="nothing sent went beyond the limits", paper="", measured=most,
              unit="of what they allow, at most", holds=most <= 1.0 + 1e-9),
        Claim(id="as-expected", text="every trial did what was expected of it", paper="", measured=float(wrong),
              unit=f"of {len(rows)} trials didn't", holds=wrong == 0),
        Claim(id="recorded", text="every trial recorded what happened", paper="", measured=float(recorded),
              unit=f"of {len(rows)} trials didn't", holds=recorded == 0),
    ]  # fmt: skip


def page(rows: list[Row], asked: int) -> str:
    """The campaign's tables as Markdown, and each trial that wasn't as expected.

    Args:
        rows: those of the trials that have values.
        asked: number of the campaign's trials.
    """
    wrong = [row for row in rows if row.values["wrong"]]
    of = Counter(row.task.trial for row in rows)
    followed = "what followed | safe after, ms: p50 (most) | largest step | recorded | not as expected"
    lines = [
        f"{len(rows)} trials: {of['faults-device']} of devices, in lockstep on fakes with the world's time, "
        f"{of['faults-wire']} of wires, with the drivers in front of their twins, and {of['faults-process']} of "
        "processes and the host, with real processes around a simulated limb. "
        f"{len(wrong)} weren't as expected.",
    ]
    if len(rows) < asked:
        lines += ["", f"{PART} {len(rows)} of {asked} trials have values."]
    for trial, title in TITLES.items():
        if table := _table(rows, trial):
            what = "devices" if trial == "faults-wire" else "profiles"
            lines += ["", f"| {title} | trials ({what}) | {followed} |", "| --- " * 7 + "|", *map(_markdown, table)]
    if wrong:
        lines += ["", "Those that weren't as expected:", ""]
        wrongs: dict[str, None] = {}  # in order, each once
        for row in wrong:
            given = row.task.parameters
            words = [given["profile"], *given["choices"], given.get("device", "")] if "profile" in given else []
            who = " ".join(words or [given["kind"], given["other"]]).strip()
            wrongs[f"`{who}`, {given['fault']}: {row.values['wrong']}"] = None
        lines += [f"- {text}" for text in list(wrongs)[:SHOWN]]
        if len(wrongs) > SHOWN:
            lines.append(f"- and {len(wrongs) - SHOWN} more, in the study's `rows.parquet`")
    return "\n".join(lines)


def _markdown(line: dict[str, Any]) -> str:
    safe, most = line["safe p50, ms"], line["safe most, ms"]
    cells = [
        line["fault"], f"{line['trials']} ({line['of']})", line["entered"],
        "" if safe is None else f"{safe:.0f} ({most:.0f})", f"{line['largest step']:.2f}",
        "all" if line["recorded"] == line["trials"] else f"{line['recorded']}", str(line["not as expected"]),
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"
