"""`srl study ikns-tracking --person`: beside a run, trial by trial, resumed where it was."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import re
import signal
import subprocess
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import aiohttp
import numpy as np
import pytest
from helpers.panel import shown
from helpers.run import Running, environment, refused, srl

from srl.runtime.ipc.header import State
from srl.studies.ikns import people
from srl.studies.ikns.tracking_order import Entry, ordered
from srl.studies.ikns.tracking_person import session
from srl.studies.tasks import journal
from srl.studies.tasks.task import DONE, Row, TrialTask

ORDER: list[Entry] = [*ordered([1], 1)]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the command runs."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def stored(folder: Path) -> Path:
    """The person's folder with an order that begins with IKNS."""
    own = folder / "out" / "ikns-tracking" / "P07"
    own.mkdir(parents=True)
    order = sorted(ORDER, key=lambda entry: entry[0] != "ikns")
    (own / "order.json").write_text(json.dumps({"person": "P07", "seed": 1, "order": order}))
    return own


@pytest.mark.parametrize(
    ("options", "words"),
    [(["--person", "Anna"], "anonymous"), (["--profile", "ikns-finger"], "--person"),
     (["--person", "P07", "--profile", "no-such"], "no-such")],
)  # fmt: skip
def test_what_cannot_be_is_said(here: Path, options: list[str], words: str) -> None:
    assert words in refused("study", "ikns-tracking", *options)


def test_other_studies_have_no_people(here: Path) -> None:
    assert "simulated persons" in refused("study", "passivity", "--person", "P07")


def test_a_session_goes_on_as_it_was_begun(here: Path) -> None:
    stored(here)
    assert "--quick" in refused("study", "ikns-tracking", "--person", "P07")


@pytest.mark.slow
def test_three_people_who_are_through_give_claims_and_nobody_else_counts(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for who, count in (("P01", 6), ("P02", 6), ("P03", 6), ("P04", 5)):
        own = tmp_path / who
        own.mkdir()
        (own / "order.json").write_text(json.dumps({"person": who, "seed": 1, "order": ORDER}))
        with journal.opened(own) as kept:
            kept.append(row(who, entry, float(rng.uniform(3, 4))) for entry in ORDER[:count])
    result = session(tmp_path, "P03", quick=True)
    assert {claim.id for claim in result.claims} >= {"rmse-t1", "no-difference-from-gamepad", "hand-still"}
    assert all(line["n"] == 3 for line in result.table)
    assert result.simulated is False
    assert all((tmp_path / "P03" / file).stat().st_size > 0 for file in result.files)
    assert not list((tmp_path / "P04").glob("*.png"))


def row(who: str, entry: Entry, rmse: float) -> Row:
    """A trial that was done."""
    condition, name, repetition = entry
    hand = {"ikns": 0.004, "gamepad": math.nan}[condition]
    parameters = {"wearer": who, "condition": condition, "model": "person", "curve": name, "repetition": repetition}
    values = {"rmse": rmse, "mean_error": rmse, "worst_step": 1.0, "hand_rms": hand, "hand_p95": hand, "hand_max": hand,
              "outside": 0.0, "held": 0.0, "simulated": False, "path": json.dumps([0.5] * 250)}  # fmt: skip
    task = TrialTask("ikns-tracking", "person", 1, parameters, "ikns-finger")
    return Row(people.key("ikns-tracking", who, entry), task, "", DONE, values, "", 30.0, "", {})


@pytest.mark.exhaustive
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_trial_is_stored_as_it_ends_and_the_session_resumes_after_it(tmp_path: Path) -> None:
    own = stored(tmp_path)
    with Running(tmp_path, "ikns-finger", "--sim", "--confirm", instance="ikns-finger") as run:
        run.started()
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        with study(tmp_path) as address:
            first = asyncio.run(trials(address, 2))
        assert [t["number"] for t in first] == [1, 2]  # the second is offered once the first is stored
        with journal.opened(own) as kept:
            (row,) = kept.rows.values()
        assert row.values["rows"] > 2000
        assert 0.0 < row.values["rmse"] < 100.0
        assert 0.0 < row.values["hand_rms"] < 0.1
        assert row.values["simulated"] is True
        assert math.isfinite(row.values["held"])
        assert len(json.loads(row.values["path"])) == 250
        assert row.task.parameters["wearer"] == "P07"
        assert {p.name for p in own.glob("01-*")} == {f"01-ikns-{row.task.parameters['curve']}-1{end}" for end in
                                                      (".json", "-samples.parquet", "-frames.parquet")}  # fmt: skip
        with study(tmp_path) as address:
            again = asyncio.run(trials(address, 1))
        assert [t["number"] for t in again] == [2]


@contextlib.contextmanager
def study(folder: Path) -> Any:
    """The command, until it gives the page's address; interrupted at the end."""
    command = srl("study", "ikns-tracking", "--person", "P07", "--quick", "--out", "out")
    with subprocess.Popen(command, env=environment(folder), cwd=folder, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        output = ""
        try:
            while not (found := re.search(r"http://127\S+", output)):
                line = process.stderr.readline()
                assert line, output
                output += line
            yield found.group()
        finally:
            process.send_signal(signal.SIGINT)
            rest = process.stderr.read()
    assert "Traceback" not in rest, rest
    assert "give the same command again" in rest


async def trials(address: str, count: int) -> list[dict[str, Any]]:
    """Begins each trial that is offered, as a participant's page does, until `count` of them were offered."""
    place = f"{urlsplit(address).scheme}://{urlsplit(address).netloc}"
    jar = aiohttp.CookieJar(unsafe=True)  # for an address without a name
    offered: list[dict[str, Any]] = []
    async with aiohttp.ClientSession(headers={"Origin": place}, cookie_jar=jar) as session:
        async with session.get(address) as answer:
            page = await answer.text()
        async with session.ws_connect(f"{place}/socket", headers=shown(page)) as socket:
            waiting, heard = False, 0
            while True:
                message = await socket.receive_json()
                heard += 1
                if message["kind"] == "state":
                    waiting = message["phase"] == "waiting"
                    if waiting and message["trial"]["number"] not in [t["number"] for t in offered]:
                        offered.append(message["trial"])
                        if len(offered) == count:
                            return offered
                if waiting and heard % 25 == 0:  # a break may not be over, or the pointer not live yet
                    await socket.send_json({"kind": "begin"})
