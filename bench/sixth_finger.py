"""The sixth finger's cycle, and the cost of telemetry to the loop."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from bench import phases
from bench.pairs import Row, measure


def _srl(*arguments: str) -> dict[str, Any]:
    command = [
        sys.executable,
        "-m",
        "srl",
        "run",
        "sixth-finger",
        "--sim",
        "--instance",
        "bench",
        "--json",
        *arguments,
    ]
    found = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    summary: dict[str, Any] = json.loads(found)
    return summary


def cycle() -> list[Row]:
    """Measures one whole cycle by phase in us, paced at 100 Hz; it is compared with the period."""

    def ours() -> dict[str, float]:
        summary = _srl("--duration", "2")
        return summary["phases_us"] | {"whole": summary["cycle_us"]["p50"]}

    period = {"read": 1e4, "control": 1e4, "guard": 1e4, "write": 1e4, "log": 1e4, "whole": 1e4}
    pairs = measure(ours, {"the period": lambda: period})
    rows = [pairs.row("cycle-sixth-finger", f"{phase}, simulated, p50", phase, "the period", "us") for phase in period]
    return rows + phases.run("cycle-sixth-finger", "sixth-finger")


def telemetry() -> list[Row]:
    """Measures the cost of a full-rate telemetry row to the loop at 1 kHz, with recorder and bus attached."""

    def ours() -> dict[str, float]:
        with tempfile.TemporaryDirectory() as folder:
            summary = _srl("--set", "rate=1000", "--duration", "2", "--record", str(Path(folder) / "x.rrd"))
        return {"p50": summary["phases_us"]["log"], "p99": summary["phases_p99_us"]["log"]}

    pairs = measure(ours, {"the aim": lambda: {"p50": 10.0, "p99": 10.0}})
    return [
        pairs.row(
            "telemetry-1khz", f"appending a row, sign of life and answers, {figure}", figure, "the aim", "us",
            "under 10 us", (lambda r: r < 1.0) if figure == "p50" else None,
        )
        for figure in ("p50", "p99")
    ]  # fmt: skip
