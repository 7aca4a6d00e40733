"""Motion files that a person hands over, MVNX and C3D: what can't be used is refused in a line, in bounded time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import pytest
import test_handed_files_fuzz as fuzz
from helpers import c3d_files, mvnx
from test_handed_files import bounded, refused
from test_handed_files_fuzz import Handed, faults, file

from srl.drivers.capture import c3d
from srl.drivers.noitom.skeleton import Skeleton
from srl.drivers.replay import suit_motion
from srl.drivers.xsens_mvn.mvnx import read
from srl.drivers.xsens_mvn.protocol import SEGMENTS

K: Final = len(SEGMENTS)
PLACES: Final = np.tile(np.linspace(0.0, 1.7, K)[:, None], (3, 1, 3))
TURNS: Final = np.tile([1.0, 0.0, 0.0, 0.0], (3, K, 1))
GOOD: Final = mvnx.text(
    PLACES, TURNS, joints=np.zeros((3, 22, 3)), centre=np.zeros((3, 3)), poses={"tpose": (PLACES[0], TURNS[0])}
)
BOMB: Final = '<!DOCTYPE mvnx [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefghi", "bcdefghij", strict=True)
) + "]>"  # fmt: skip
HEAD: Final = GOOD.splitlines()[0] + "\n"
ONE: Final = "1.000000 0.000000 0.000000 0.000000"
WRONG: Final[dict[str, tuple[Callable[[str], str], list[str]]]] = {
    "another version": (lambda t: t.replace('version="4"', 'version="2"'), ["line 2", "version '2'", "3 and 4"]),
    "no version": (lambda t: t.replace(' version="4"', ""), ["line 2", "version"]),
    "another root": (lambda t: t.replace("mvnx xmlns", "frames xmlns").replace("</mvnx>", "</frames>"), ["'frames'"]),
    "no segments": (lambda t: t.replace("<segments>", "<x>").replace("</segments>", "</x>"), ["segments", "line"]),
    "a segment twice": (lambda t: t.replace('label="Head"', 'label="Neck"'), ["Neck", "once more"]),
    "fewer segments than numbers": (lambda t: t.replace('<segment label="Head" id="7"><points/></segment>', ""),
                                    ["orientation", "92", "22 segments"]),
    "a changing count": (lambda t: t[: t.rindex(ONE)] + t[t.rindex(ONE) + len(ONE):], ["orientation", "88"]),
    "no positions": (lambda t: t.replace("position>", "place>"), ["no 'position'"]),
    "angles in some frames": (lambda t: t.replace("jointAngle>", "x>", 2), ["jointAngle", "some frames"]),
    "NaN": (lambda t: t.replace("1.700000 ", "nan ", 1), ["position", "finite"]),
    "a word": (lambda t: t.replace("1.700000 ", "one ", 1), ["position", "number"]),
    "a decimal comma": (lambda t: t.replace("1.700000 ", "1,7 ", 1), ["position", "number"]),
    "a quaternion of zeros": (lambda t: t.replace(ONE, "0 0 0 0", 1), ["Pelvis", "quaternion", "line"]),
    "centimetres": (lambda t: t.replace("1.700000 ", "17000 ", 1), ["1.7e+04 m", "MVNX has m"]),
    "no frame rate": (lambda t: t.replace('frameRate="60"', ""), ["frameRate"]),
    "a rate of zero": (lambda t: t.replace('frameRate="60"', 'frameRate="0"'), ["0 Hz"]),
    "another rate": (lambda t: t.replace('time="33"', 'time="2000"'), ["60 Hz", "2.000 s"]),
    "an unknown frame": (lambda t: t.replace('type="normal"', 'type="odd"'), ["'odd'", "normal"]),
    "frames out of order": (lambda t: t.replace('index="2"', 'index="0"'), ["frame 0 after frame 1"]),
    "one frame": (lambda t: t.replace('type="normal"', 'type="npose"', 2), ["1 frame"]),
    "an index of 5000 digits": (lambda t: t.replace('index="2"', f'index="{fuzz.BIG}"'), ["5000 digits"]),
    "cut short": (lambda t: t[: len(t) * 3 // 4], ["frame 2", "cut short"]),
    "cut in a tag": (lambda t: t[: t.rindex("<frame") + 3], ["cut short"]),
    "empty": (lambda t: "", ["cut short"]),
    "no XML": (lambda t: "HIERARCHY\n", ["line 1", "XML"]),
    "an entity": (lambda t: t.replace("<mvnx", '<!DOCTYPE m [<!ENTITY a "b">]><mvnx', 1), ["line 2", "entity 'a'"]),
    "entities within entities": (lambda t: t.replace("<mvnx", f"{BOMB}<mvnx", 1).replace("P07", "&j;"), ["entity"]),
    "an entity of a file": (lambda t: t.replace("<mvnx", '<!DOCTYPE m [<!ENTITY a SYSTEM "/etc/hostname">]><mvnx', 1),
                            ["entity"]),
    "1,000,000 elements within each other": (lambda t: HEAD + '<mvnx version="4">' + "<a>" * 1_000_000,
                                             ["within 32 others"]),
    "a text without end": (lambda t: t.replace(ONE, ONE * 100_000, 1), ["orientation", "letters"]),
    "50,000 segments": (lambda t: t.replace("<segments>", "<segments>" + "".join(
        f'<segment label="s{i}"/>' for i in range(50_000))), ["200 segments"]),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_mvnx_file_is_refused_in_a_line(case: str, tmp_path: Path) -> None:
    change, words = WRONG[case]
    path = file(tmp_path, "a.mvnx", change(GOOD))
    assert path.read_text() != GOOD
    refused(lambda: read(path), "a.mvnx", *words)


def test_a_document_type_without_entities_is_read(tmp_path: Path) -> None:
    """MVN writes it, as a comment; nothing is fetched."""
    text = GOOD.replace("<mvnx", '<!DOCTYPE mvnx SYSTEM "http://localhost:1/schema.dtd"><mvnx', 1)
    assert bounded(lambda: read(file(tmp_path, "a.mvnx", text))) == ""


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    refused(lambda: read(tmp_path), "directory")
    refused(lambda: read(tmp_path / "none.mvnx"), "none.mvnx")


MARKERS: Final = c3d_files.markers(4)
WRONG_C3D: Final[dict[str, tuple[Callable[[], bytes], list[str]]]] = {
    "text": (lambda: b"HIERARCHY\n" * 100, ["begin"]),
    "cut short": (lambda: c3d_files.content(c3d_files.markers(400))[:-9000], ["of the 400 frames", "cut short"]),
    "another unit": (lambda: c3d_files.content(MARKERS, unit="furl"), ["furl", "mm, cm, m"]),
    "metres as millimetres": (lambda: c3d_files.content(MARKERS * 1e5, unit="m"), ["m away", "UNITS"]),
    "a name twice": (lambda: c3d_files.content(MARKERS, ("A:C7", "A:C7", "A:T10")), ["two", "A:C7"]),
    "nothing seen": (lambda: c3d_files.content(MARKERS, hidden=np.ones((4, 3), bool)), ["ever seen"]),
    "one frame": (lambda: c3d_files.content(MARKERS[:1]), ["1 frame"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", WRONG_C3D)
def test_a_wrong_c3d_file_is_refused_in_a_line(case: str, tmp_path: Path) -> None:
    made, words = WRONG_C3D[case]
    refused(lambda: c3d.read(file(tmp_path, "a.c3d", made())), "a.c3d", *words)


READERS: Final = {
    "MVNX": Handed(lambda _: GOOD, read, "a.mvnx", trials=60),
    "MVNX as a suit": Handed(lambda _: GOOD, lambda path: suit_motion.read(path, Skeleton("axis-neuron")), "a.mvnx",
                             trials=20),
    "C3D": Handed(lambda _: c3d_files.content(MARKERS), c3d.read, "a.c3d", trials=40),
}  # fmt: skip


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "C3D")) for n in READERS])
def test_a_damaged_motion_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    assert faults(READERS[name], tmp_path, 0, READERS[name].trials) == []


@pytest.mark.slow
@pytest.mark.exhaustive
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", READERS)
def test_many_damaged_motion_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    assert faults(READERS[name], tmp_path, 10_000, 10 * READERS[name].trials) == []
