"""The calibration file: what is written is read, and what is wrong in it is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.edited import edited
from helpers.null_space_arm import calibrated

from srl.control.ikns.calibration import Calibration
from srl.control.ikns.record import Record, RecordError, read, write


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Record]:
    path = tmp_path_factory.mktemp("ikns") / "p07.json"
    return path, calibrated(path, "clavicle", 2)


def test_what_is_written_is_read_to_the_bit(made: tuple[Path, Record]) -> None:
    path, record = made
    assert read(path) == record
    found = record.calibration()
    again = Record.of(
        found, record.thresholds, person=record.person, date=record.date, simulated=record.simulated,
        rate=record.rate, frame=record.frame, joints=record.joints, dofs=record.dofs,
    )  # fmt: skip
    assert again == record
    assert {name: np.shape(getattr(found, name)) for name in Calibration.__dataclass_fields__} == {
        "sites": (10, 3), "directions": (10, 2, 9), "lower": (10, 2), "upper": (10, 2), "travel": (10, 2, 9),
        "samples": (10, 2), "explained": (10, 2), "wander": (10,), "condition": (10, 2),
        "crosstalk": (10, 2, 2), "agreement": (10,), "still": (), "lost": (), "jumps": (),
    }  # fmt: skip


def test_a_file_is_replaced_whole_or_not_at_all(made: tuple[Path, Record], monkeypatch: pytest.MonkeyPatch) -> None:
    path, record = made
    with monkeypatch.context() as broken:
        broken.setattr("os.fsync", lambda fd: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        with pytest.raises(RecordError, match=r"p07\.json: it can't be written: No space left on device"):
            write(path, record.model_copy(update={"person": "p08"}))
    assert read(path) == record
    write(path, record.model_copy(update={"person": "p08"}))
    assert read(path).person == "p08"
    write(path, record)
    assert [p.name for p in path.parent.iterdir()] == ["p07.json"]


def _without_site(v: dict[str, Any]) -> None:
    del v["points"][3]["site"]


FAULTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "a field is missing": (_without_site, r"points\.3\.site: the key 'site' is missing"),
    "an unknown key": (lambda v: v.update(name="Ada"), "name: the key 'name' isn't known here"),
    "a name as id": (lambda v: v.update(person="Ada Lovelace"), "person: it should be 1 to 64 letters"),
    "another format": (lambda v: v.update(format="srl-glove-1"), "format: it should be 'srl-ikns-1'"),
    "too few numbers": (
        lambda v: v["points"][4]["directions"][1].pop(),
        "point 5 must have directions and travel of 9 numbers",
    ),
    "too few DoFs": (lambda v: v["points"][0]["upper"].pop(), "point 1 must have 2 entries"),
    "an empty range": (lambda v: v["points"][0].update(upper=v["points"][0]["lower"]), "isn't below its upper end"),
    "no number": (lambda v: v["points"][2].update(wander="NaN"), r"points\.2\.wander: it should be a finite number"),
    "a number that no array holds": (
        lambda v: v["points"][0].update(samples=[10**400, 1]),
        r"points\.0\.samples\.0: it should be less than",
    ),
    "a cosine of -5": (lambda v: v["points"][1].update(agreement=-5.0), r"points\.1\.agreement: .*equal to -1"),
    "a sine of -5": (lambda v: v["points"][1].update(condition=[-5.0, 1.0]), r"points\.1\.condition\.0: .*equal to 0"),
    "a share of 7": (lambda v: v.update(still=7.0), "still: it should be less than or equal to 1"),
    "less than nothing": (lambda v: v.update(jumps=-1), "jumps: it should be greater than or equal to 0"),
    "two joints of one name": (lambda v: v["joints"].__setitem__(1, v["joints"][0]), "a name of its own"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_place(fault: str, made: tuple[Path, Record], tmp_path: Path) -> None:
    edited(made[0], FAULTS[fault][0], tmp_path / "bad.json")
    with pytest.raises(RecordError, match=rf"bad\.json.*{FAULTS[fault][1]}.*Calibrate again"):
        read(tmp_path / "bad.json")


def test_a_file_of_a_newer_srl_is_no_reason_to_calibrate_at_once(made: tuple[Path, Record], tmp_path: Path) -> None:
    edited(made[0], lambda v: v.update(format="srl-ikns-2"), tmp_path / "new.json")
    with pytest.raises(RecordError, match=r"format: it is of the format srl-ikns-2.*Use the newer srl that wrote it"):
        read(tmp_path / "new.json")


def test_a_number_that_was_changed_by_hand_is_refused(made: tuple[Path, Record], tmp_path: Path) -> None:
    """It could be plausible and wrong: a sense turned round, a bound in degrees."""
    text, path = made[0].read_text(), tmp_path / "p07.json"
    path.write_text(text.replace(str(made[1].points[2].upper[0]), str(made[1].points[2].upper[0] + 0.1)))
    with pytest.raises(RecordError, match=r"p07\.json: it was changed after it was written.*take \"sha256\" out"):
        read(path)
    edited(made[0], lambda _: None, path)  # without its hash it is taken
    assert read(path) == made[1]
    path.write_text(text.replace('"jumps": 0', '"jumps": 0, "jumps": 1'))
    with pytest.raises(RecordError, match="'jumps' is there twice"):
        read(path)


@pytest.mark.slow
def test_a_file_that_isnt_there_or_isnt_json(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="it can't be read: No such file"):
        read(tmp_path / "none.json")
    for content in (b"", b"{", b"\xff\xfe", b"[1]"):
        (tmp_path / "odd.json").write_bytes(content)
        with pytest.raises(RecordError, match=r"odd\.json: .*Calibrate again"):
            read(tmp_path / "odd.json")
    with pytest.raises(RecordError, match=r"it can't be written: .*Choose another folder"):
        write(tmp_path / "no" / "p.json", calibrated(tmp_path / "p.json"))
