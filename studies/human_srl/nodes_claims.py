"""The claim `nodes-match`: the 90 nodes of every wearer and motion are where plain matrices have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from srl.studies.human_srl.part import NAME, Part
from srl.studies.human_srl.wearers import wearers
from srl.studies.result import Claim
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

PROFILE: Final = "human-srl-two"
MOTIONS: Final = 200
WITHIN: Final = 1e-9  # m
NODES: Final = 90
_QUICK, _SWEPT = 2, 10  # motions
_FRAMES: Final = 50
_USUAL: Final = ("text", "YXZ")  # as the suit's software sends them


def claims(runner: Runner, folder: Path, quick: bool) -> Part:
    """Runs the trials; see `part.py`."""
    count = _QUICK if quick else MOTIONS
    return analysed(runner.rows(tasks(count, *_USUAL), folder / "nodes"), count)


def sweep(runner: Runner, folder: Path) -> list[dict[str, Any]]:
    """What is sent in another way."""
    asked = {
        f"{wire}, {order}": tasks(_SWEPT, wire, order) for order in ("YXZ", "ZXY", "XYZ") for wire in ("text", "binary")
    }
    return [_line(how, rows) for how, rows in runner.by_label(asked, folder / "sweep-nodes").items()]


def tasks(count: int, wire: str, order: str) -> list[TrialTask]:
    """The first motions, those of all wearers in turn."""
    who = [asdict(one) for one in wearers()]
    return [
        TrialTask.of(
            NAME, "human-srl-nodes", seed,
            {"wearer": who[(seed - 1) % len(who)], "wire": wire, "order": order, "frames": _FRAMES}, profile=PROFILE,
        )
        for seed in range(1, count + 1)
    ]  # fmt: skip


def analysed(rows: Sequence[Row], count: int) -> Part:
    """The claim and a line of the table; `count`: how many trials there should be."""
    done = [row.values for row in rows if row.done]
    off = max((float(str(v[name])) for v in done for name in ("off", "vector")), default=None)
    frames = sum(int(str(v["frames"])) for v in done)
    whole = len(done) == count and all(v["nodes"] == NODES and v["frames"] == _FRAMES for v in done)
    claim = Claim(
        id="nodes-match",
        text=f"in all {frames} frames of {len(done)} motions, {NODES} nodes are within {WITHIN:g} m of where plain "
        "matrices have them, by what was sent and by the 540 numbers; measured: the largest distance",
        paper="", measured=off, unit="m", holds=whole and off is not None and off < WITHIN,
    )  # fmt: skip
    return Part([claim], [_line(", ".join(_USUAL), rows)])


def _line(how: str, rows: Sequence[Row]) -> dict[str, Any]:
    done = [row.values for row in rows if row.done]
    worst = {n: max((float(str(v[n])) for v in done), default=float("nan")) for n in ("off", "vector", "rounding")}
    return {
        "part": "nodes",
        "sent as": how,
        "motions": len(done),
        "frames": sum(int(str(v["frames"])) for v in done),
        "off, m": f"{worst['off']:.1e}",
        "by the 540 numbers, m": f"{worst['vector']:.1e}",
        "of the wire's rounding, m": f"{worst['rounding']:.1e}",
    }
