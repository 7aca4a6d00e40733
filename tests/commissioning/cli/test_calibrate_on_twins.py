"""`srl calibrate --twin`: a person's whole session on the devices' twins, by one command."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, get_args

import pytest
from helpers.run import call, environment, refused, srl
from helpers.srl_twin import TwinProcess, twins_of
from helpers.wait import until
from hypothesis import given
from hypothesis import strategies as st

from srl.commissioning.calibration import session
from srl.recordings import read
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.wearer import Follow, Hold, Instruction, Perform, Rest, Shape, instruction_of, written
from srl.runtime.ipc.run_folder import running
from srl.runtime.recording.summary import summarize

NUMBER = st.floats(-10.0, 10.0)


@given(
    st.one_of(
        st.builds(Shape, st.dictionaries(st.text(min_size=1), NUMBER)),
        st.builds(Hold, st.lists(NUMBER, min_size=3, max_size=3), turn=st.none() | st.lists(NUMBER, min_size=4)),
        st.builds(Perform, st.sampled_from(["squat", "carry"])),
        st.builds(Follow, st.lists(NUMBER), st.lists(st.lists(NUMBER)), st.just(["swivel"])),
        st.just(Rest()),
    )
)
def test_an_instruction_survives_its_line(instruction: Instruction) -> None:
    line = written(instruction)
    assert "\n" not in line
    assert instruction_of(line) == instruction


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"Jump": {}}', '{"Rest": {}, "Walk": {}}', '{"Shape": {"joints": 1}}']
)
def test_what_is_no_instruction_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected|fields|Expecting"):
        instruction_of(text)
    assert len(get_args(Instruction)) == 14


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--twin", "--sim"], "a world of their own"),
        (["--twin", "--recording", "a.rrd"], "opens no device"),
        (["--twin", "finger"], "glove"),
    ],
)
def test_what_contradicts_twins_is_refused(more: list[str], words: str) -> None:
    assert words in refused("calibrate", "sixth-finger", "glove", "--person", "P07", "-o", "p07.json", *more)


@pytest.mark.slow
def test_a_simulated_hand_does_on_the_twin_what_the_session_asks(tmp_path: Path) -> None:
    options = [word for each in ("read=1", "hold=1", "settle=0.5") for word in ("--option", each)]
    hidden = 'sim.devices.glove.characteristic={"index_mpj": {"gain": -0.02, "offset": 190.0}}'
    done = call(
        tmp_path, "calibrate", "sixth-finger", "glove", "--person", "P07", "--twin", "-o", "p07.json", "--json",
        "--record", "p07.rrd", "--set", hidden, *options,
    )  # fmt: skip
    assert "glove-marks.mark" not in done.stderr  # the person is told what to do, not of marks
    found = json.loads((tmp_path / "p07.json").read_text())
    assert found["simulated"]
    assert found["sensors"]["index_mpj"]["gain"] == pytest.approx(-0.02, rel=0.03)
    recording = read(tmp_path / "p07.rrd")
    assert recording.layout.meta["twins"] == ["glove"]
    assert recording.layout.simulated == ["glove"]
    assert summarize(tmp_path / "p07.rrd").simulated
    call(tmp_path, "calibrate", "sixth-finger", "glove", "--recording", "p07.rrd", "-o", "again.json", "--json")
    assert json.loads((tmp_path / "again.json").read_text()) == found
    assert running() == []


@pytest.mark.slow
def test_a_world_whose_person_takes_no_instructions_is_refused_before_it_begins(tmp_path: Path) -> None:
    done = call(
        tmp_path,
        "calibrate",
        "human-srl-task",
        "independent-operation",
        "--person",
        "P07",
        "--twin",
        "-o",
        "p.json",
        code=2,
    )
    assert "no person who takes instructions" in done.stderr
    assert not (tmp_path / "p.json").exists()


@pytest.mark.slow
def test_twins_that_die_end_the_session(tmp_path: Path) -> None:
    command = srl("calibrate", "sixth-finger", "glove", "--person", "P07", "--twin", "-o", "p07.json")
    run = subprocess.Popen(command, cwd=tmp_path, env=environment(tmp_path), stderr=subprocess.PIPE, text=True)
    try:
        found = until(lambda: twins_of(run.pid), timeout=60)
        until(lambda: bool(list(tmp_path.glob("run/*/rows*"))), timeout=60)
        os.kill(found[0], signal.SIGKILL)
        _, said = run.communicate(timeout=60)
    finally:
        run.kill()
    assert run.returncode == 2, said
    assert "the twins have ended. Begin again; nothing was written" in said


@pytest.mark.slow
def test_no_line_ends_the_twins() -> None:
    with TwinProcess("sixth-finger", "glove", "--control") as twin:
        for line in ("wearer {}", "wearer " + "[" * 100_000, 'wearer {"Shape": {"angles": 3}}', 'wearer {"Rest": {}}'):
            assert twin.process.stdin is not None
            twin.process.stdin.write(f"{line}\n")
        assert twin.control("close glove")["control"] == "close"


@pytest.mark.parametrize(("earlier", "now"), [(True, False), (False, True)])
def test_what_is_simulated_isnt_mixed_with_what_isnt(earlier: bool, now: bool) -> None:
    """Of a servo on its port beside a ring on its twin, too: what counts is what the run itself says."""
    source: Any = SimpleNamespace(channel_map=SimpleNamespace(simulated=now))
    with pytest.raises(RequestError, match="Don't mix a person"):
        session._check_alike(source, cast(Any, SimpleNamespace(simulated=earlier)))
    session._check_alike(source, cast(Any, SimpleNamespace(simulated=now)))
    session._check_alike(source, None)
