"""RTDE's data received by this driver and by ur_rtde (C++), the same variables at 500 Hz: CPU time per packet.

Both read from `srl twin` in its own process. ur_rtde's figure is that of its whole process while its own thread
receives; ours is that of a process that waits for each packet, parses it and fills the states.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.pairs import PAIRS, Row, measure

SECONDS: Final = 1.0
_ROOT: Final = Path(__file__).resolve().parents[1]
_PROFILE: Final = """\
name: bench-ur
rate: 500
devices:
  arm: {{driver: ur, port: "tcp://{host}", interface: position}}
setpoints:
  client.position:
    {{shape: [6], unit: rad, labels: [shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3]}}
controllers:
  - use: joint-setpoint
    name: jog
    joints: [shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3]
    in: {{target: client.position}}
    out: {{q: arm.position_command, q_velocity: arm.position_command.velocity}}
guard:
  arm.position_command: {{velocity: 1.0, acceleration: 5.0}}
sim:
  world: cell
  parts: {{arm: {{part: ur16e}}}}
  devices: {{arm: {{host: {host}, standard_ports: true}}}}
"""


def run() -> list[Row]:
    """Runs the comparison; takes about 2 minutes."""
    host = f"127.{os.getpid() % 200 + 20}.{os.getpid() // 200 % 250}.9"
    with tempfile.TemporaryDirectory() as folder:
        profile = Path(folder) / "bench-ur.yaml"
        profile.write_text(_PROFILE.format(host=host))
        twin = subprocess.Popen(
            [sys.executable, "-m", "runtime", "twin", str(profile), "--json"],
            stdout=subprocess.PIPE, cwd=_ROOT, text=True,
        )  # fmt: skip
        try:
            assert twin.stdout is not None
            twin.stdout.readline()
            pairs = measure(lambda: _worker("ours", host), {"ur_rtde": lambda: _worker("ur_rtde", host)}, PAIRS)
        finally:
            twin.terminate()
            twin.wait()
    return [pairs.row("ur-rtde-receive", "RTDE at 500 Hz, CPU time a packet", "cpu", "ur_rtde", "us")]


def _worker(kind: str, host: str) -> dict[str, float]:
    command = [sys.executable, "-m", "bench.ur", kind, host]
    found: dict[str, float] = json.loads(
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=60, cwd=_ROOT).stdout
    )
    return found


def _ours(host: str) -> dict[str, float]:
    from drivers.transport import open_transport
    from drivers.ur import rtde, sample
    from drivers.ur.handshake import Handshake

    link = open_transport(f"tcp://{host}:30004", place="bench")
    handshake = Handshake(link, "bench")
    handshake.greet()
    handshake.start(*handshake.outputs(500.0, sample.names("target"), sample.TYPES))
    found, parser = sample.Sample(), handshake.parser
    arrays = [np.zeros(6) for _ in range(4)]
    pose = np.zeros(7)
    poll = select.poll()
    poll.register(link.fileno(), select.POLLIN)
    frames, cpu, until = parser.frames, time.process_time(), time.monotonic() + SECONDS
    while time.monotonic() < until:
        poll.poll(100)
        newest = None
        for message in parser.feed(link.read()):
            if message.kind == rtde.Kind.DATA:
                newest = message.body
        if newest is not None and found.take(newest):
            for array, values in zip(arrays, (found.position, found.velocity, found.effort, found.wrench), strict=True):
                array[:] = values
            sample.fill_pose(found.tool.tolist(), pose)
    cpu, frames = time.process_time() - cpu, parser.frames - frames
    link.close()
    return {"cpu": cpu / frames * 1e6}


def _ur_rtde(host: str) -> dict[str, float]:
    import rtde_receive  # type: ignore[import-not-found,unused-ignore]

    from drivers.ur import sample

    receiver: Any = rtde_receive.RTDEReceiveInterface(host, 500.0, list(sample.names("target")))
    time.sleep(0.2)
    first, cpu = receiver.getTimestamp(), time.process_time()
    time.sleep(SECONDS)
    cpu, frames = time.process_time() - cpu, (receiver.getTimestamp() - first) * 500
    receiver.disconnect()
    return {"cpu": cpu / frames * 1e6}


if __name__ == "__main__":
    print(json.dumps({"ours": _ours, "ur_rtde": _ur_rtde}[sys.argv[1]](sys.argv[2])))
