"""Files that a person hands over: what can't be used is refused in one line, in bounded time and memory."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import signal
import struct
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import test_handed_files_fuzz as fuzz
from test_handed_files_fuzz import BIG, BVH, FORCES, GLOVE, HAND, POSES, SENSORS, file, forces, table, zipped

from srl.control.cobot.ft_record import FtRecord
from srl.drivers.cyberglove import calibration
from srl.drivers.cyberglove.protocol import LABELS
from srl.runtime.bus import certificate_warnings, certificates
from srl.runtime.cli import main
from srl.runtime.contracts.calibration_content import parse
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.models import record_file
from srl.runtime.models.robots import urdf
from srl.runtime.models.skeleton import bvh
from srl.runtime.profile import profile
from srl.runtime.recording import index, reader
from srl.sim.parts.body import mocap_motion
from srl.sim.parts.person.path import read_path
from srl.sim.wearer import inhard, load_wearer, topics
from srl.sim.wearer.forces import ForceRecording, load_forces
from srl.sim.wearer.mat5 import read_mat5
from srl.studies.toolkit import sheets

LONGEST: Final = 1500  # letters of an error
PROFILE: Final = profile.find("sixth-finger")[1]
FT: Final = {
    "format": "srl-ft-1", "date": "2026-02-17", "simulated": False, "signal": "sensor.wrench", "frame": None,
    "poses": 6, "bias": [0.0] * 6, "tool_mass": 0.3, "tool_com": [0.0, 0.0, 0.05], "left": [0.1, 0.1],
    "uncertain": [0.1] * 4,
}  # fmt: skip


def bounded(work: Callable[[], object], kinds: tuple[type[Exception], ...] = fuzz.KINDS, clock: int = 30) -> str:
    """What `work` comes to in a process of its own: "" where it returns, the error's text where it refuses.

    Anything else fails the test: another exception, too much memory or time, a wait without end, death by a signal.
    """
    out, into = os.pipe()
    if not (child := os.fork()):
        os.close(out)
        with contextlib.suppress(BaseException):
            os.write(into, _limited(work, kinds, clock).encode()[:60_000])
        os._exit(0)
    os.close(into)
    with os.fdopen(out, "rb") as pipe:
        output = pipe.read().decode(errors="replace")
    _, status = os.waitpid(child, 0)
    assert not os.WIFSIGNALED(status), f"killed by {signal.Signals(os.WTERMSIG(status)).name}: a hang or a crash"
    assert output[:1] in ("r", "e"), output or "it ended without a word"
    return output[1:]


def _limited(work: Callable[[], object], kinds: tuple[type[Exception], ...], clock: int) -> str:
    fuzz.limit_memory()
    fuzz.limit_time(clock)
    try:
        work()
    except kinds as error:
        return f"e{error}"
    except BaseException as error:
        return f"{type(error).__name__} escapes: {str(error)[:200]}"
    return "r"


def refused(work: Callable[[], object], *words: str, clock: int = 30) -> str:
    """The text of the error with which `work` refuses: one line, not too long, with these words (any case)."""
    output = bounded(work, clock=clock)
    assert output, "it was taken without a word"
    assert len(output.splitlines()) == 1, output
    assert len(output) < LONGEST, f"{len(output)} letters: {output[:200]}"
    assert not [word for word in words if word.lower() not in output.lower()], output
    return output


def shaped(shape: str, data: bytes = b"\0" * 64, kind: str = "<f8") -> bytes:
    """An NPY whose header claims a shape."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


# -- BVH

NESTED: Final = "".join(f"JOINT j{i}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n" for i in range(1500))
WRONG_BVH: Final = {
    "more frames than lines": (("Frames: 2", "Frames: 99999999999999"), ["line 12", "frames"]),
    "more frames than memory": (("Frames: 2", "Frames: 100000000"), ["line 12", "frames"]),
    "a count of 5000 digits": (("Frames: 2", f"Frames: {BIG}"), ["line 12"]),
    "a count that is no ASCII digit": (("Frames: 2", "Frames: ²"), ["line 12"]),
    "channels of 5000 digits": (("CHANNELS 6", f"CHANNELS {BIG}"), ["line 5"]),
    "channels that are no ASCII digit": (("CHANNELS 6", "CHANNELS ²"), ["line 5"]),
    "fewer frames than lines": (("0 0 1\n", "0 0 1\n0 0 0 0 0 2\n"), ["line 16", "frames"]),
    "something after the frames": (("0 0 1\n", "0 0 1\nMOTION\n"), ["line 16"]),
    "decimal commas": (("0 0 1\n", "0 0 1,5\n"), ["line 15", "comma"]),
}


@pytest.mark.parametrize("case", WRONG_BVH)
def test_a_wrong_bvh_file_is_refused_in_a_line(case: str, tmp_path: Path) -> None:
    (old, new), words = WRONG_BVH[case]
    assert old in BVH
    refused(lambda: bvh.read(file(tmp_path, "a.bvh", BVH.replace(old, new))), *words)


def test_joints_nested_1500_deep_are_read_or_refused(tmp_path: Path) -> None:
    text = BVH.replace("  End Site", f"{NESTED}  End Site").replace("MOTION", "}\n" * 1500 + "MOTION")
    path = file(tmp_path, "a.bvh", text)
    assert [bounded(partial(read, path)).count("\n") for read in (bvh.read, bvh.read_tree)] == [0, 0]


OTHER_BVH: Final = {
    "brace on the name's line": ("ROOT Hips\n{", "ROOT Hips {"),
    "brace on the end site's line": ("End Site\n  {", "End Site {"),
    "no space in Frames": ("Frames: 2", "Frames:2"),
    "no space in Frame Time": ("Frame Time: 0.01", "Frame Time:0.01"),
    "lower-case channels": ("Xposition Yposition", "xposition yposition"),
    "lower-case words": ("HIERARCHY\nROOT", "hierarchy\nroot"),
    "lower-case motion": ("MOTION\nFrames: 2\nFrame Time:", "motion\nframes: 2\nframe time:"),
    "empty lines at the end": ("0 0 1\n", "0 0 1\n\n \n"),
}


@pytest.mark.parametrize("case", OTHER_BVH)
def test_bvh_as_other_programs_write_it_is_the_same_motion(case: str, tmp_path: Path) -> None:
    old, new = OTHER_BVH[case]
    assert old in BVH
    plain, other = (bvh.read(file(tmp_path, "a.bvh", text)) for text in (BVH, BVH.replace(old, new)))
    assert [joint.name for joint in other.joints] == ["Hips", "Hips_End"]
    assert np.array_equal(other.world_positions(), plain.world_positions())
    assert other.frame_time == plain.frame_time


# -- tables of a hand

WRONG_TABLES: Final = {
    "quoted decimal commas": (table().replace("0.3", '"0,3"', 1), ["line 2", "comma"]),
    "milliseconds under time": (table(step=10.0), ["time_ms"]),
    "milliseconds under t": (table(("t", *SENSORS), step=10.0), ["time_ms"]),
    "a column twice": (table(("time", *SENSORS, "s3")), ["line 1", "s3", "twice"]),
    "a sensor by number and by label": (table(("time", *SENSORS, LABELS[22][3])), ["line 1", "s3"]),
    "a sensor in two units": (table(("time", *SENSORS, "s3_deg")), ["line 1", "s3"]),
    "a time that no curve goes through": (table().replace("0.290000", "1e300"), ["time"]),
}


@pytest.mark.parametrize("case", WRONG_TABLES)
def test_a_wrong_table_is_refused_with_its_remedy(case: str, tmp_path: Path) -> None:
    text, words = WRONG_TABLES[case]
    refused(lambda: load_wearer(file(tmp_path, "a.csv", text)), *words)


def test_separators_and_decimal_commas_are_read_right_or_named(tmp_path: Path) -> None:
    plain = load_wearer(file(tmp_path, "plain.csv", table())).target(0.1)
    for comma, point, words in ((";", ",", ["semicolon", "decimal"]), (";", ".", ["semicolon"]),
                                ("\t", ",", ["tab", "decimal"]), ("\t", ".", ["tab"])):  # fmt: skip
        path = file(tmp_path, "a.csv", table(comma=comma, point=point))
        if output := bounded(partial(load_wearer, path)):
            assert not [word for word in words if word not in output.lower()], output
        else:
            np.testing.assert_array_equal(load_wearer(path).target(0.1), plain)


def test_a_slow_table_that_says_its_unit_is_taken(tmp_path: Path) -> None:
    for name, step in (("time_ms", 10.0), ("time", 0.1), ("time_s", 0.5)):
        path = file(tmp_path, "a.csv", table((name, *SENSORS), step))
        assert bounded(partial(load_wearer, path)) == ""


@pytest.mark.slow
def test_what_of_a_hands_recording_is_left_out_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for names in (SENSORS, list(LABELS[22])):
        path = file(tmp_path, "a.csv", table(("time", *names, "battery"), n=200))
        assert main(["check", "sixth-finger", "--sim", "--set", f"sim.parts.hand.wearer.recording={path}"]) == 0
        output = "".join(capsys.readouterr())
        assert not [name for name in (*names[19:], "battery") if name not in output.replace(str(path), "")], names[19:]


WRONG_NPZ: Final[dict[str, tuple[dict[str, Any], list[str]]]] = {
    "an absurd shape": (HAND | {"position": shaped("(1000000000000, 22)")}, ["position"]),
    "a table in a table": (HAND | {"position": np.zeros((30, 22), [("a", "f8"), ("b", "f8")])}, ["position"]),
    "complex angles": (HAND | {"position": HAND["position"] * (1 + 1j)}, ["position"]),
    "dates for seconds": (HAND | {"time": np.arange(30).astype("M8[ms]")}, ["time"]),
    "milliseconds": (HAND | {"time": np.arange(30) * 10.0}, ["time"]),
    "a name twice": (HAND | {"names": np.array([*SENSORS[:21], "s3"])}, ["s3", "twice"]),
    "no sample": (HAND | {"time": np.zeros(0), "position": np.zeros((0, 22))}, ["sample"]),
    "no sample of a door": (fuzz.DOOR | {"hand_position": np.zeros((0, 22)), "episode": np.zeros(0)}, ["sample"]),
    "an episode that is no number": (fuzz.DOOR | {"episode": np.full(30, np.nan)}, ["episode"]),
}


@pytest.mark.parametrize("case", WRONG_NPZ)
def test_a_wrong_npz_is_refused_in_a_line(case: str, tmp_path: Path) -> None:
    members, words = WRONG_NPZ[case]
    path = file(tmp_path, "a.npz", zipped(**members))
    refused(lambda: load_wearer(path), *words)


@pytest.mark.slow
def test_an_npz_that_is_inflated_or_in_many_pieces_is_read_or_refused(tmp_path: Path) -> None:
    path, n = file(tmp_path, "a.npz", zipped(**HAND | {"time": shaped("(250000000,)", bytes(2_000_000_000))})), 100_000
    refused(lambda: load_wearer(path))
    many = {"hand_position": np.tile(HAND["position"], (n // 15, 1))[:n], "episode": np.arange(n) // 2}
    bounded(lambda: load_wearer(file(tmp_path, "a.npz", zipped(**fuzz.DOOR | many))))


# -- other recordings

poses: Final = partial(mocap_motion.read, rate=100.0)
MS: Final = FORCES.splitlines()[0] + "\n" + "".join(f"{10 * k},1,2,3\n" for k in range(30))
WRONG_OTHERS: Final[dict[str, tuple[Callable[[Path], object], str, list[str]]]] = {
    "forces twice": (forces, FORCES.replace("Fz", "Fz,fx").replace(",3\n", ",3,4\n"), ["line 1", "fx", "twice"]),
    "two times of forces": (forces, FORCES.replace("time", "time,t").replace(",1,", ",9,1,"), ["line 1", "time"]),
    "milliseconds of forces": (forces, MS, ["time_ms"]),
    "forces with decimal commas": (forces, FORCES.replace(",", ";").replace(".", ","), ["semicolon", "decimal"]),
    "poses twice": (poses, POSES.replace("time", "x"), ["x", "twice"]),
    "poses with decimal commas": (poses, POSES.replace(",", ";").replace(".", ","), ["semicolon", "decimal"]),
    "points twice": (read_path, "x,y,z,x\n0,0,0,5\n1,1,1,5\n", ["line 1", "x", "twice"]),
    "points with decimal commas": (read_path, "x;y;z\n0,1;0;0\n1;1;1\n", ["semicolon", "decimal"]),
}


@pytest.mark.parametrize("case", WRONG_OTHERS)
def test_other_wrong_tables_are_refused_with_their_remedy(case: str, tmp_path: Path) -> None:
    read, text, words = WRONG_OTHERS[case]
    refused(lambda: read(file(tmp_path, "a.csv", text)), *words)


def test_a_time_column_of_another_name_is_used_or_refused(tmp_path: Path) -> None:
    with contextlib.suppress(SrlError):
        assert poses(file(tmp_path, "p.csv", POSES.replace("time", "Time")))[0][1] == pytest.approx(0.02)
    pushes = ForceRecording(file=file(tmp_path, "f.csv", MS.replace("time", "time_ms")))
    with contextlib.suppress(SrlError):
        assert load_forces(pushes, "force").duration == pytest.approx(0.29)


@pytest.mark.parametrize("stamps", [(0, 9 * 10**18), (0, 10**15), (10**19, 10**19 + 1), ("²", 1), (BIG, 1), ("", "")])
def test_topics_without_end_are_refused_in_a_line(stamps: tuple[object, ...], tmp_path: Path) -> None:
    for finger in ("thumb", "index", "middle", "ring", "little"):
        rows = "".join(f"{stamp},0.1\n" if stamp != "" else "" for stamp in stamps)
        file(tmp_path, f"a_{finger}_finger_joint_1.csv", f"rosbagTimestamp,data\n{rows}")
    refused(lambda: topics.read(tmp_path))


@pytest.mark.slow
def test_a_matlab_file_that_is_deep_or_inflated_is_read_or_refused(tmp_path: Path) -> None:
    inner = fuzz.matrix(1.0, 2.0, 3.0)
    for _ in range(1500):
        inner = fuzz.struct_of(a=inner)
    bounded(lambda: read_mat5(file(tmp_path, "a.mat", fuzz.matlab(inner))))
    packed = zlib.compress(fuzz.element(14, b"\0" * (1 << 30)), 1)
    refused(lambda: read_mat5(file(tmp_path, "a.mat", fuzz.matlab(fuzz.element(15, packed)))), "a.mat")


# -- profiles, `--set` and calibrations

YAML: Final = {
    "deep brackets": f"x: {'[' * 1500}{']' * 1500}", "brackets 300 deep": f"x: {'[' * 300}{']' * 300}",
    "deep blocks": "x:\n" + "".join(f"{' ' * (i + 1)}a:\n" for i in range(1500)), "a big number": f"x: {BIG}",
    "a big version": f"%YAML 1.{BIG}", "a day that isn't": "x: 2026-02-31", "no hour": "x: 2026-02-17T25:61:61",
    "no integer": "x: !!int abc", "no number": "x: !!float abc", "no truth": "x: !!bool abc",
    "no letter": 'x: "\\UFFFFFFFF"', "no text": "x: \0",
}  # fmt: skip


@pytest.mark.parametrize("case", YAML)
def test_yaml_that_no_reader_takes_is_refused_in_a_line(case: str) -> None:
    first = case == "a big version"
    text = f"{YAML[case]}\n---\n{PROFILE}" if first else f"{PROFILE}{YAML[case]}\n"
    refused(lambda: profile.parse("a.yaml", text), "a.yaml")
    if not first:
        glove = KeptFile(Path("a.yaml"), f"{GLOVE}{YAML[case]}\n".encode())
        refused(lambda: calibration.load(glove, 22), "a.yaml")
        assert bounded(lambda: parse(glove.content)) == ""


RATES: Final = ("1/0", "'1e99999999'", f"0x{'f' * 5000}", f"'{BIG}/{BIG}'")


@pytest.mark.parametrize("rate", RATES, ids=lambda rate: rate[:12])
def test_a_rate_that_is_none_is_refused_in_a_line(rate: str) -> None:
    refused(lambda: profile.parse("a.yaml", PROFILE.replace("rate: 100 ", f"rate: {rate} ")), "rate")
    refused(lambda: profile.parse("a.yaml", PROFILE, [f"rate={rate}"]), "rate")


@pytest.mark.slow
def test_a_million_labels_are_refused_in_bounded_time() -> None:
    labels = ", ".join(f"a{i}" for i in range(1_000_000))
    wide = f"setpoints:\n  c.p: {{shape: [1000000], unit: rad, labels: [{labels}]}}\n"
    refused(lambda: profile.parse("a.yaml", PROFILE + wide), "a.yaml")


TWICE_AS_MUCH: Final = "[&a0 [1, 1], " + ", ".join(f"&a{i + 1} [*a{i}, *a{i}]" for i in range(30)) + "]"
OVERRIDES: Final = {
    "a big number": f"devices.glove.sensors={BIG}", "deep brackets": f"devices.glove.port={'[' * 1500}{']' * 1500}",
    "aliases of aliases": f"devices.glove.port={TWICE_AS_MUCH}", "itself": "devices.glove.port=&a [*a]",
    "a day that isn't": "devices.glove.port=2026-02-31", "no integer": "devices.glove.port=!!int abc",
    "a long path": f"{'.'.join('a' * 3000)}=1", "a big place": f"controllers.{BIG}.use=1",
    "a place that is no ASCII digit": "controllers.².use=1",
}  # fmt: skip


@pytest.mark.parametrize("case", OVERRIDES)
def test_an_override_is_taken_or_refused_in_a_line(case: str) -> None:
    output = bounded(lambda: profile.parse("a.yaml", PROFILE, [OVERRIDES[case]]))
    assert len(output.splitlines()) < 2
    assert len(output) < LONGEST, output[:200]


def test_json_of_any_size_is_read_or_refused_in_bounded_time() -> None:
    twice = "{" + ",".join(f'"a{i}":1' for i in range(50_000)) + ',"a49999":2}'
    refused(lambda: record_file.parse(FtRecord, twice.encode(), "a.json"), "a49999", "twice")
    for old, new in (("0.3", BIG), ("0.3", "[" * 50_000), ("0.3", "1e999"), ("sensor", "\\ud800")):
        text = json.dumps(FT).replace(old, new)
        refused(partial(record_file.parse, FtRecord, text.encode(), "a.json"), "a.json")
        assert bounded(partial(parse, text.encode())) == ""


@pytest.mark.parametrize("number", [BIG, "1e999", "[" * 5000, "7.9", "true", '"²"', '7, "id": 8'], ids=lambda n: n[:6])
def test_endpoints_without_a_number_are_refused(number: str, tmp_path: Path) -> None:
    path = file(tmp_path, "a.json", fuzz.ENDPOINTS.replace("7", number, 1))
    assert "a.json" in bounded(lambda: fuzz.endpoints(path), (ValueError,))


def test_a_urdf_of_many_links_or_joints_is_read_or_refused_in_bounded_time() -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(50_000))
    refused(lambda: urdf.tree(f'<robot name="a">{links}</robot>'.encode(), Path("a.urdf")), "a.urdf")
    limit = f'<limit lower="{BIG}" upper="1" velocity="1" effort="1"/>'
    joint = f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>'
    one = f'<robot name="a"><link name="a"/><link name="b"/>{joint}</robot>'
    refused(lambda: urdf.tree(one.encode(), Path("a.urdf")), "joint j", "lower")


def test_the_page_says_what_is_where_in_a_virtualhand_file_and_which_way_is_positive() -> None:
    page = (Path(__file__).parents[1] / "docs/devices/cyberglove.md").read_text()
    part = page[page.index("The driver also reads a VirtualHand file") :].partition("\n## ")[0]
    assert not [word for word in ("line", "offset", "gain", "flexion", *LABELS[22]) if word not in part]


def test_a_key_of_another_kind_is_doubted(tmp_path: Path) -> None:
    certificates.authority(tmp_path)
    certificates.sign(tmp_path, "a", ["localhost"], 30)
    key, curve = tmp_path / "a.key", bytes.fromhex("2a8648ce3d0201")
    head, body, end = key.read_text().strip().partition("\n")[0], key.read_text().splitlines()[1:-1], "-----END"
    der = base64.b64decode("".join(body))
    assert curve in der
    made = base64.encodebytes(der.replace(curve, curve[:-1] + b"\x7f")).decode()
    key.write_text(f"{head}\n{made}{head.replace('-----BEGIN', end)}\n")
    tls = TlsConfig(ca=str(tmp_path / "ca.pem"), certificate=str(tmp_path / "a.pem"), key=str(key))
    assert list(certificate_warnings.warnings(tls))


# -- what is no file

READERS: Final[dict[str, Callable[[Path], object]]] = {
    "a.bvh": bvh.read, "a.csv": load_wearer, "a.npz": load_wearer, "a.mat": read_mat5, "p.csv": read_path,
    "f.csv": forces, "f.npz": forces, "m.csv": poses, "s.csv": partial(sheets.read, required=["a"]),
    "InHARD.csv": lambda path: inhard.actions(path.parent), "a_thumb_base.csv": lambda path: topics.read(path.parent),
    "a.rrd": reader.read, "a.rrd.segments/000001.rrd": lambda path: reader.read(path.parent),
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_and_an_endless_device_are_refused_at_once(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    os.mkfifo(path)
    refused(lambda: READERS[name](path), clock=10)
    path.unlink()
    path.symlink_to("/dev/zero")
    refused(lambda: READERS[name](path))


def test_a_folder_or_a_pipe_that_is_called_a_recording_is_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "a.rrd.segments/000001.rrd").mkdir(parents=True)
    refused(lambda: reader.read(tmp_path / "a.rrd.segments"))
    os.mkfifo(tmp_path / "b.rrd")
    bounded(lambda: index.entries(tmp_path), clock=10)
