"""A made-up run for the recorder's tests: a layout, rows with awkward bits, and a writer process."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from srl.runtime.ipc.events import EventWriter, Level
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.ipc.run_folder import RunFolder

FINGERS = ("thumb", "index", "middle", "ring", "little")


def make_layout(rate: int = 1000, extra: int = 40) -> Layout:
    """A hand, an extra finger with a command, a virtual sphere, frames, plots and `extra` more numbers."""
    layout = Layout(devices=["glove", "finger"])
    layout.add("glove.position", "state", (22,), "rad", labels=tuple(f"joint {i}" for i in range(22)))
    layout.add(
        "hand.tips",
        "internal",
        (5, 3),
        "m",
        frame="hand",
        labels=FINGERS,
        visual="points",
        links=((0, 1, 2, 3, 4),),
    )
    layout.add("mapping.sphere", "internal", (4,), "m", frame="hand", visual="sphere")
    layout.add("finger.position_command", "command", (4,), "rad", labels=("abduction", "mcp", "pip", "dip"))
    layout.add("finger.position_command.applied", "applied", (4,), "rad", labels=("abduction", "mcp", "pip", "dip"))
    layout.add("world.finger", "truth", (4,), "rad", labels=("abduction", "mcp", "pip", "dip"))
    layout.add("world.tip", "truth", (3,), "m", frame="hand", labels=("x", "y", "z"), visual="points")
    layout.add("hand.pose", "state", (7,), "m")
    layout.add("odd.values", "internal", (extra,), "1")
    joints = ("abduction", "mcp", "pip", "dip")
    place = {"size": [0.1, 0.2, 0.3], "position": [0.0, 0.0, 1.0], "quaternion": [1.0, 0.0, 0.0, 0.0]}
    kinds = ("box", "cylinder", "capsule", "sphere")
    layout.meta = {
        "scenery": [{"kind": kind, "colour": [0.5, 0.5, 0.5, 1.0]} | place for kind in kinds],
        "name": "made-up",
        "profile": "name: made-up\nrate: 1000\n",
        "sha256": "0" * 64,
        "rate": [rate, 1],
        "wall": 1_700_000_000_123_456_789,
        "frames": {
            "base": {"parent": None, "xyz": [0, 0, 0], "rpy": [0, 0, 0], "pose": None},
            "hand": {"parent": "base", "xyz": [0.1, 0, 0], "rpy": [0, 0, 0.5], "pose": "hand.pose"},
        },
        "record": {
            "plots": [
                {
                    "title": "Finger",
                    "unit": "rad",
                    "lines": {
                        f"{name} {what}": f"{signal}[{i}]"
                        for i, name in enumerate(joints)
                        for what, signal in (
                            ("applied", "finger.position_command.applied"),
                            ("measured", "world.finger"),
                        )
                    },
                },
                {
                    "title": "Distance of the tips",
                    "unit": "m",
                    "distance": {
                        "thumb": ["hand.tips[0]", "world.tip"],
                        "index": ["hand.tips[1]", "world.tip"],
                    },
                },
            ]
        },
    }
    return layout


def make_rows(layout: Layout, count: int, first: int = 1) -> NDArray[np.int64]:
    """Rows first .. first + count - 1, the same at each call: smooth motion, and every kind of float64."""
    n = np.arange(first, first + count)
    rows = np.zeros((count, layout.width), np.int64)
    period = 1_000_000_000 * layout.meta["rate"][1] // layout.meta["rate"][0]

    def word(name: str, values: NDArray[np.int64] | int) -> None:
        rows[:, layout.int_names.index(name)] = values

    def signal(name: str, values: NDArray[np.float64]) -> None:
        field = layout.fields[name]
        start = layout.ints + field.offset
        rows[:, start : start + field.size] = np.ascontiguousarray(values).view(np.int64).reshape(count, field.size)

    rng = np.random.default_rng(first)
    wake = 5_000_000_000_000_001 + n * period + (np.sin(n * 12.9898) * 20_000).astype(np.int64)
    ends = wake[:, None] + np.cumsum(20_000 + (np.sin(n[:, None] + np.arange(4)) * 9000).astype(np.int64), axis=1)
    word("cycle", n + 41)
    word("now", 5_000_000_000_000_000 + n * period)
    word("dt", period)
    word("deadline", 5_000_000_000_000_000 + n * period)
    word("wake", wake)
    for i, name in enumerate(("read", "control", "guard", "write")):
        word(name, ends[:, i])
    word("log", 4000)
    word("state", np.select([n < 300, n < 12000, n < 12200], [1, 2, 3], 4))
    word("cause", np.where(n < 12000, 0, 2))
    word("request", (1 << 62) + n)
    for device in layout.devices:
        word(f"{device}.stamp", 5_000_000_000_000_000 + n * period - 700_000 if device == "glove" else -1)
        word(f"{device}.frames", n)
    t = n * period / 1e9
    q = 0.6 + 0.5 * np.sin(2 * t[:, None] * np.array([0.3, 0.5, 0.7, 0.9]))
    tips = np.stack(
        [[0.09, 0.02 * i, 0.0] + 0.02 * np.stack([np.cos(t + i), np.sin(t), t * 0], 1) for i in range(5)], 1
    )
    signal("glove.position", 0.5 + 0.4 * np.sin(t[:, None] + np.arange(22)))
    signal("hand.tips", tips)
    signal("mapping.sphere", np.column_stack([tips.mean(1), 0.03 + 0.01 * np.sin(t)]))
    signal("finger.position_command", q)
    signal("finger.position_command.applied", q + 0.01)
    signal("world.finger", q - 0.03 * np.cos(t[:, None]))
    signal("world.tip", tips.mean(1))
    pose = np.zeros((count, 7))
    pose[:, 0], pose[:, 3], pose[:, 6] = 0.05 * np.sin(t), np.cos(t / 2), np.sin(t / 2)
    pose[n < 100] = 0.0  # no sample yet
    signal("hand.pose", pose)
    odd = layout.fields["odd.values"]
    start = layout.ints + odd.offset
    rows[:, start : start + odd.size] = rng.integers(-(2**63), 2**63 - 1, (count, odd.size))  # NaN payloads too
    return rows


def make_run(path: Path, layout: Layout, capacity: int = 8192) -> tuple[RunFolder, RingWriter, EventWriter]:
    """A run's folder with its rings."""
    path.mkdir(parents=True, exist_ok=True)
    run = RunFolder(path)
    layout.save(run.layout)
    return run, RingWriter.create(run.rows, layout.width, capacity), EventWriter(run.events)


def write_run(
    run: RunFolder,
    ring: RingWriter,
    events: EventWriter,
    layout: Layout,
    count: int,
    rate: float,
    *,
    first: int = 1,
) -> None:
    """Appends `count` rows at `rate` rows/s, a event every 500; 0: as fast as the recorder consumes them."""
    start = time.monotonic()
    for at in range(first, first + count, 100):
        rows = make_rows(layout, min(100, first + count - at), at)
        for i, row in enumerate(rows):
            if (at + i) % 500 == 0:
                events.write(time.monotonic_ns(), Level.WARNING, at + i + 41, f"row {at + i}: Grüße")
            while not rate and ring.head - ring.consumed >= ring.capacity:
                time.sleep(0.001)
            ring.append(row)
            if rate and (wait := start + (at + i - first) / rate - time.monotonic()) > 0.002:
                time.sleep(wait)


if __name__ == "__main__":
    folder, total, per_second, more = (
        Path(sys.argv[1]),
        int(sys.argv[2]),
        float(sys.argv[3]),
        int(sys.argv[4]),
    )
    the_layout = make_layout(extra=more)
    the_run, the_ring, the_events = make_run(folder, the_layout)
    print("ready", flush=True)
    write_run(the_run, the_ring, the_events, the_layout, total, per_second)
    the_ring.finish()
