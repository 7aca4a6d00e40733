"""`srl run --person P08` with another person's calibration is refused, of whatever kind the file is."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srl.runtime.cli.run import _check_owners
from srl.runtime.contracts.errors import RequestError
from srl.runtime.recording.summary import owner

JSON = json.dumps({"format": "srl-emg-1", "person": "P07", "simulated": False}).encode()
YAML = b"person: P07\nhand: right\n"


def check(person: str | None, content: bytes, simulated: tuple[str, ...] = ()) -> None:
    source: Any = SimpleNamespace(files=SimpleNamespace(kept={"p07.json": content}))
    graph: Any = SimpleNamespace(devices=[SimpleNamespace(name="emg")], simulated=list(simulated))
    _check_owners(person, source, graph)


@pytest.mark.parametrize("content", [JSON, YAML])
def test_another_persons_file_is_refused(content: bytes) -> None:
    with pytest.raises(RequestError) as caught:
        check("P08", content)
    assert "the file p07.json was made with P07, the run is P08's" in caught.value.problem
    with pytest.raises(RequestError):
        check("P08", content, simulated=("emg",))  # a real person's file, though the device is simulated


@pytest.mark.parametrize("content", [JSON, YAML])
def test_ones_own_file_and_a_run_of_nobody_pass(content: bytes) -> None:
    check("P07", content)
    check(None, content)


def test_a_simulated_persons_file_serves_where_all_is_simulated() -> None:
    made = json.dumps({"person": "P0", "simulated": True}).encode()
    check("P08", made, simulated=("emg",))
    with pytest.raises(RequestError):
        check("P08", made)


@pytest.mark.parametrize("content", [b"\xff\x00", b"[1, 2]", b"a: [", b'{"person": 7}', b"", b"limb: robot"])
def test_what_names_nobody_belongs_to_nobody(content: bytes) -> None:
    assert owner(content) == ("", False)
    check("P08", content)


def test_the_command_says_it_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from srl.runtime.cli import main

    shipped = Path(__file__).parents[2] / "profiles" / "emg-station.calibration.json"
    record = tmp_path / "run.rrd"
    arguments = ["run", "emg-station", "--record", str(record), "--person", "P08"]
    arguments += ["--set", f"controllers.0.calibration={shipped}"]
    assert main(arguments) == 2  # the device is real, the file a simulated person's
    output = capsys.readouterr().err
    assert "was made with P0, the run is P08's. Name P08's file in the profile, or calibrate P08" in output
    assert not record.exists()
