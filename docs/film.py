"""Makes the README's moving picture: a simulated run, as the panel shows it in Chromium. Needs what the tests need.

.venv/bin/python docs/film.py docs/human-srl.gif
"""

from __future__ import annotations

import base64
import io
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from helpers.chromium import Chromium, Page
from helpers.run import environment, srl
from helpers.wait import until

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.pictures.film import in_common_colours
from srl.runtime.web.operator.client import OperatorPage

PROFILE: Final = "human-srl"
WIDTH, HEIGHT = 500, 530  # px
BEGIN, END = 4.5, 11.0  # s since the run began: a hand comes to the arm, stays, and goes
RATE = 10.0  # pictures a second
# Nothing but the picture, as large as the window, and nearer.
ALONE = """(() => {
  const space = document.getElementById("space");
  Object.assign(space.style, { position: "fixed", inset: 0, width: "100vw", height: "100vh", zIndex: 99 });
  document.getElementById("tags").style.display = "none";
  space.dispatchEvent(new WheelEvent("wheel", { deltaY: -290 }));
})()"""


def film(gif: Path) -> None:
    """Runs the simulation and writes the film."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run = subprocess.Popen(srl("run", PROFILE, "--sim"), env=environment(folder), cwd=folder)
        try:
            where = RunFolder(folder / "run" / PROFILE)
            until(where.layout.exists, timeout=60)
            with OperatorPage(where, folder) as panel, Chromium(folder / "chromium") as browser:
                pictures = _watched(browser.open(panel.address))
        finally:
            run.send_signal(signal.SIGINT)
            run.wait()
    _save(pictures, gif)
    print(f"{gif}: {len(pictures)} pictures, {gif.stat().st_size / 1e6:.1f} MB")


def _watched(page: Page) -> list[tuple[float, Image.Image]]:
    """The pictures and their times, s since the run began."""
    page.ask("Emulation.setDeviceMetricsOverride", width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False)
    page.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "light"}])
    until(lambda: page.value("globalThis.pictureNow?.solid"), timeout=60)
    page.value(ALONE)
    found: list[tuple[float, Image.Image]] = []
    while True:
        due = time.monotonic() + 1.0 / RATE
        at = page.value("globalThis.pictureNow.cycle") / 100.0
        if at > END:
            return found
        if at > BEGIN:
            shot = page.ask("Page.captureScreenshot", format="png")["data"]
            found.append((at, Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB")))
        time.sleep(max(0.0, due - time.monotonic()))


def _save(pictures: list[tuple[float, Image.Image]], gif: Path) -> None:
    times = [at for at, _ in pictures]
    first, *others = in_common_colours([picture for _, picture in pictures])
    gaps = [round(100 * (b - a)) * 10 for a, b in zip(times, [*times[1:], times[-1] + 0.1], strict=True)]
    first.save(gif, "GIF", save_all=True, append_images=others, duration=gaps, loop=0, optimize=True)


if __name__ == "__main__":
    film(Path(sys.argv[1]))
