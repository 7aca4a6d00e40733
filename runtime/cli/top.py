"""`srl top`: a live view of a running instance, over its bus."""

from __future__ import annotations

import argparse
import contextlib
import json
import threading
import time
from typing import Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from srl.runtime.bus.client import Client, Update, connect
from srl.runtime.cli import add_command, options
from srl.runtime.cli.instance import choose
from srl.runtime.contracts.errors import NoAnswerError, RequestError
from srl.runtime.profile.keys import path

REFRESH = 5.0  # Hz
GONE = 5.0  # s without a status after which the client checks whether the instance still exists
BAR = 13  # characters
SHOWN_EVENTS = 6
SHOWN_COMMANDS = 24
_LEVELS = ("green", "yellow", "bold red", "magenta")  # of diagnostic_msgs/DiagnosticStatus
_PHASES = ("read", "control", "guard", "write", "log")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "top", "srl top sixth-finger")
    options.instance(parser)
    parser.add_argument("--once", action="store_true", help="print one frame as plain text")
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Shows the instance. Raises RequestError if it isn't running, or if several run and none is named."""
    named = args.instance is not None and "/" in args.instance  # a run folder, of another user
    with connect(args.instance if named else choose(args.instance)) as client:
        view = View(client)
        if args.json:
            view.gather()
            print(json.dumps(view.content()))
        elif args.once:
            view.gather()
            Console(width=100, color_system=None, force_terminal=False, highlight=False).print(view.frame())
        else:
            _live(view, client)
    return 0


def _live(view: View, client: Client) -> None:
    try:
        with Live(view.frame(), refresh_per_second=REFRESH, screen=True) as live:
            while True:
                time.sleep(1 / REFRESH)
                view.refresh_events()
                live.update(view.frame())
                if view.silence() > GONE and not client.alive():
                    break
    except KeyboardInterrupt:
        return
    print(f"{client.instance} has ended.")


class View:
    """The newest data of the instance, and its display."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._lock = threading.Lock()  # updates arrive on a zenoh thread
        self._meta = client.meta()
        self._status: dict[str, Any] = {}
        self._heard = time.monotonic()
        self._updates: dict[str, Update] = {}
        self._span: dict[str, float] = {}  # the largest value seen, by signal: the bars' scale
        self._events = client.events()
        self._events_at = time.monotonic()
        client.subscribe_status(self._take_status)
        client.subscribe(self._take)

    def _take_status(self, status: dict[str, Any]) -> None:
        with self._lock:
            self._status, self._heard = status, time.monotonic()

    def _take(self, update: Update) -> None:
        with self._lock:
            self._updates[update.name] = update

    def gather(self, timeout: float = 2.0) -> None:
        """Waits until there is a status and, if they arrive in time, a sample of each signal."""
        until = time.monotonic() + timeout
        while time.monotonic() < until and not (self._status and len(self._updates) >= len(self._meta)):
            time.sleep(0.01)
        if not self._status:
            raise RequestError(f"instance '{self._client.instance}'", "it sent no status", "Is its loop running?")

    def silence(self) -> float:
        """Seconds since the last status."""
        return time.monotonic() - self._heard

    def refresh_events(self) -> None:
        """Queries the newest events, at most once a second."""
        if time.monotonic() - self._events_at > 1.0:
            self._events_at = time.monotonic()
            with contextlib.suppress(NoAnswerError):  # the silence is shown
                self._events = self._client.events() or self._events

    def content(self) -> dict[str, Any]:
        """Returns the content for `--json`: the status, every signal's values, the events."""
        with self._lock:
            signals = {
                name: {
                    "values": u.values.tolist(),
                    "stamp": u.stamp,
                    "unit": self._meta.get(name, {}).get("unit", ""),
                }
                for name, u in self._updates.items()
            }
            return {**self._status, "signals": signals, "events": self._events}

    def frame(self) -> Group:
        """Returns the whole display."""
        with self._lock:
            status, updates = self._status, dict(self._updates)
        if not status:
            return Group(Panel(Text("waits for a status"), title=self._client.instance))
        parts: list[RenderableType] = [self._head(status), _devices(status["devices"])]
        commands = self._commands(updates)
        if commands.row_count:
            parts.append(commands)
        if self._events:
            lines = [f"{time.strftime('%H:%M:%S', time.localtime(n['time'] / 1e9))}  {n['text']}" for n in self._events]
            parts.append(Panel(Text("\n".join(lines[-SHOWN_EVENTS:])), title="events", title_align="left"))
        return Group(*parts)

    def _head(self, status: dict[str, Any]) -> Panel:
        text = Text()
        text.append(f"{status['message']}\n", style=_LEVELS[min(status["level"], 3)])
        if self.silence() > 1.0:
            text.append(f"no status for {self.silence():.0f} s\n", style="bold red")
        if status.get("latches"):
            kept, how = ", ".join(status["latches"]), f"`srl reset {status['instance']}` on its machine ends this"
            text.append(f"latched: {kept}   {how}\n", style="yellow")
        if "rate_hz" in status:
            text.append(
                f"rate {status['rate_hz']:.1f} of {status['rate_nominal_hz']:g} Hz"
                f"   period p50 {status['period_p50_us']:.0f} us, p99 {status['period_p99_us']:.0f} us"
                f"   overruns {status['overruns']}" + ("   telemetry degraded" if status["degraded"] else "") + "\n"
            )
        if "cycle_p50_us" in status:
            phases = "  ".join(f"{p} {status[f'{p}_us']:.0f}" for p in _PHASES)
            text.append(
                f"cycle p50 {status['cycle_p50_us']:.0f} us, p99 {status['cycle_p99_us']:.0f} us   in us: {phases}\n"
            )
        text.append(f"cycle {status.get('cycle', 0)}   rows lost by the bus {status['lost_rows']}")
        if status.get("refused"):
            text.append(f"   requests refused {status['refused']}", style="yellow")
        if status["rejected_setpoints"]:
            text.append(
                f"\nsetpoints refused {status['rejected_setpoints']}: {status['last_rejection']}",
                style="yellow",
            )
        return Panel(text, title=f"{status['instance']} ({status['profile']})", title_align="left")

    def _commands(self, updates: dict[str, Update]) -> Table:
        table = Table(title="commands: asked, applied, sent", title_justify="left", expand=True, box=None)
        table.add_column("command", no_wrap=True)
        for heading in ("asked", "", "applied", "", "sent"):
            table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
        for name, update in sorted(updates.items()):
            found = [updates.get(f"{name}/{value}") for value in ("applied", "sent")]
            given = [u.values.ravel() for u in found if u is not None and u.values.shape == update.values.shape]
            if len(given) < 2:
                continue
            values = np.array([update.values.ravel(), *given])
            labels = update.labels or tuple(str(i) for i in range(update.values.size))
            span = max(self._span.get(name, 1e-9), float(np.nan_to_num(np.abs(values), posinf=0.0).max(initial=0.0)))
            self._span[name] = span
            unit = self._meta.get(name, {}).get("unit", "")
            for label, column in zip(labels, values.T.tolist(), strict=False):
                if table.row_count < SHOWN_COMMANDS:
                    short = path(label).replace("/", ".")
                    asked, applied, sent = (f"{value:.3f}" for value in column)
                    bars = [_bar(value / span) for value in column[:2]]
                    table.add_row(f"{name} {short} ({unit})", asked, bars[0], applied, bars[1], sent)
        return table


def _devices(devices: dict[str, dict[str, Any]]) -> Table:
    table = Table(title="devices", title_justify="left", expand=True, box=None)
    for heading in ("device", "driver", "link"):
        table.add_column(heading, no_wrap=True)
    for heading in ("age ms", "frames", "errors", "resyncs", "reconnects"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, device in devices.items():
        age = f"{device['age_ms']:.1f}" if device["age_ms"] >= 0 else "-"
        table.add_row(
            name,
            device["driver"],
            Text(device["message"], style=_LEVELS[min(device["level"], 3)]),
            age,
            *(str(device[word]) for word in ("frames", "errors", "resyncs", "reconnects")),
        )
    return table


def _bar(share: float) -> str:
    """Draws a value from -1 to 1 as a bar from the middle."""
    if not np.isfinite(share):
        return "not finite".center(BAR)
    middle = BAR // 2
    length = round(min(abs(share), 1.0) * middle)
    cells = ["·"] * BAR
    for i in range(length + 1):
        cells[middle + (i if share > 0 else -i)] = "█"
    return "".join(cells)
