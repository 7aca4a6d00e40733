"""`python -m bench.picture [PROFILE]`: how often the panel's picture is drawn a second, without a graphics card.

A simulated run, its panel, and headless Chromium with the whole page at 1280 x 800, all on this machine: Chromium
computes the picture on the processor. Prints the frames a second, the processor time of Chromium for each, and how
many pixels were drawn for one of the page's. The first seconds, in which it finds that number, don't count.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import aiohttp

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.operator.client import OperatorPage

SIZE = (1280, 800)
SETTLE, SECONDS = 10.0, 20.0
START = 120.0  # s


def main() -> int:
    """Measures once."""
    profile = sys.argv[1] if len(sys.argv) > 1 else "human-srl"
    browser = next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), ""
    )
    if not browser:
        sys.exit("bench.picture: Chromium isn't installed. apt install chromium")
    with tempfile.TemporaryDirectory(prefix="srl-") as scratch:
        os.environ["SRL_RUNTIME_DIR"] = scratch
        run = subprocess.Popen([sys.executable, "-m", "srl", "run", profile, "--sim"], stderr=subprocess.DEVNULL)
        folder = RunFolder(Path(scratch) / profile)
        try:
            _wait(folder.layout.exists)
            time.sleep(2.0)
            with OperatorPage(folder) as page:
                asyncio.run(_measure(browser, Path(scratch), page.address))
        finally:
            run.send_signal(signal.SIGINT)
            run.wait()
    return 0


def _wait(there: Any) -> None:
    end = time.monotonic() + START
    while not there():
        if time.monotonic() > end:
            raise RuntimeError("it doesn't begin")
        time.sleep(0.1)


async def _measure(browser: str, scratch: Path, address: str) -> None:
    data = scratch / "browser"
    flags = ["--headless=new", "--disable-gpu", "--remote-debugging-port=0", f"--user-data-dir={data}"]
    flags += ["--no-sandbox"] if os.geteuid() == 0 else []
    process = subprocess.Popen([browser, *flags], stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        port = data / "DevToolsActivePort"
        await asyncio.to_thread(_wait, lambda: port.exists() and "\n" in port.read_text())
        base = f"http://127.0.0.1:{port.read_text().split()[0]}"
        async with aiohttp.ClientSession() as session, session.put(f"{base}/json/new?about:blank") as made:
            where = (await made.json(content_type=None))["webSocketDebuggerUrl"]
            async with session.ws_connect(where, max_msg_size=0) as page:
                await _watch(page, address, process.pid)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


async def _watch(page: aiohttp.ClientWebSocketResponse, address: str, browser: int) -> None:
    async def ask(method: str, **given: Any) -> Any:
        await page.send_json({"id": 1, "method": method, "params": given})
        while (answer := await page.receive_json()).get("id") != 1:
            pass
        return answer["result"]

    async def shows(what: str) -> Any:
        return (await ask("Runtime.evaluate", expression=f"globalThis.pictureNow && {what}"))["result"].get("value")

    width, height = SIZE
    await ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
    await ask("Page.navigate", url=address)
    end = time.monotonic() + START
    while not await shows("pictureNow.solid") and time.monotonic() < end:
        await asyncio.sleep(0.2)
    await asyncio.sleep(SETTLE)
    before = await shows("pictureNow.frames"), _processor(browser), time.monotonic()
    await asyncio.sleep(SECONDS)
    after = await shows("pictureNow.frames"), _processor(browser), time.monotonic()
    frames, processor, seconds = (b - a for a, b in zip(before, after, strict=True))
    print(
        f"{width} x {height}: {frames / seconds:.1f} frames/s, {1000 * processor / max(frames, 1):.0f} ms of processor "
        f"time each, {await shows('pictureNow.ratio')} pixels for one of the page's; load {os.getloadavg()[0]:.1f} on "
        f"{os.cpu_count()} processors"
    )


def _processor(group: int) -> float:
    """s that the processes of a session have used."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        if int(fields[3]) == group:
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    sys.exit(main())
