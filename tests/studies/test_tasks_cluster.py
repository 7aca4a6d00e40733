"""Trials on a Dask scheduler over loopback: the rows of one machine, whatever is killed."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import pytest
from helpers.dask_cluster import DaskCluster
from helpers.toy_trials import installed, kept, lines, started
from helpers.wait import until
from helpers.zenoh import certificates

from srl.runtime.contracts.errors import RequestError
from srl.studies.tasks import cluster, runner
from srl.studies.tasks.cluster import Cluster

pytestmark = pytest.mark.slow


def finished(folder: Path, env: dict[str, str], *more: str, code: int = 0) -> str:
    """Runs the toy study to its end; what it said on standard error."""
    with started(folder, env, *more) as client:
        output = client.communicate(timeout=90)[1]
    assert client.returncode == code, output
    assert "Traceback" not in output, output
    return output


def test_a_worker_and_then_the_client_are_killed_and_the_rows_are_those_of_one_machine(tmp_path: Path) -> None:
    env = installed(tmp_path / "toy") | {"TOY_BOMB": str(tmp_path / "bomb"), "TOY_GATE": str(tmp_path / "gate")}
    out = tmp_path / "out" / "toy"
    with DaskCluster(tmp_path / "dask", env) as dask:
        workers = [dask.worker(), dask.worker()]
        dask.ready(2)
        with started(tmp_path / "out", env, "--on", dask.address) as client:
            # One dies of its trial. The other may come to wait for the gate before it has done what the first one left.
            until(lambda: lines(out) and any(w.poll() is not None for w in workers), what="a row, and a worker's death")
            client.send_signal(signal.SIGKILL)
            client.communicate()
        there = lines(out)
        assert 0 < there < 12
        (tmp_path / "gate").touch()
        assert f"{there} of 12 trials" in finished(tmp_path / "out", env, "--on", dask.address)
        assert sorted(w.poll() is None for w in workers) == [False, True]
    finished(tmp_path / "local", env, "--workers", "1")
    assert kept(out) == kept(tmp_path / "local" / "toy")


@pytest.mark.exhaustive
def test_a_scheduler_that_dies_ends_the_study_with_what_is_kept(tmp_path: Path) -> None:
    env = installed(tmp_path / "toy") | {"TOY_GATE": str(tmp_path / "gate")}
    with DaskCluster(tmp_path / "dask", env) as dask:
        dask.worker()
        with started(tmp_path / "out", env, "--on", dask.address) as client:
            until(lambda: lines(tmp_path / "out" / "toy") == 6, what="six rows")
            dask.stop_scheduler()
            output = client.communicate(timeout=90)[1]
    assert client.returncode == 2, output
    assert "the scheduler was lost" in output
    assert "Traceback" not in output
    (tmp_path / "gate").touch()
    assert "6 of 12 trials" in finished(tmp_path / "out", env)


def test_a_worker_with_another_program_is_named_before_any_work(tmp_path: Path) -> None:
    env = installed(tmp_path / "here")
    other = installed(tmp_path / "there")
    file = tmp_path / "there" / "toy_study.py"
    file.write_text(file.read_text().replace("(40, 40)", "(41, 41)"))
    with DaskCluster(tmp_path / "dask", other) as dask:
        dask.worker()
        output = finished(tmp_path / "out", env, "--on", dask.address, code=2)
    assert "program: " in output
    assert "Install the same there" in output
    assert lines(tmp_path / "out" / "toy") == 0


def test_a_worker_without_the_package_is_named(tmp_path: Path) -> None:
    env = installed(tmp_path / "toy")
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "srl.py").write_text("raise ImportError('no such package')\n")  # hides an installed one
    without = os.environ | {"PYTHONPATH": str(bare)}
    with DaskCluster(tmp_path / "dask", without) as dask:
        dask.worker()
        output = finished(tmp_path / "out", env, "--on", dask.address, code=2)
    assert "no srl-runtime that runs trials" in output


def test_over_mutual_tls_the_rows_are_the_same_and_nobody_without_a_certificate_gets_in(tmp_path: Path) -> None:
    env = installed(tmp_path / "toy")
    folders = {}
    (tmp_path / "keys").mkdir()
    for name, files in certificates(tmp_path / "keys", ["cluster", "client"]).items():
        folders[name] = tmp_path / name
        folders[name].mkdir()
        for file, path in (("ca", files.ca), ("certificate", files.certificate), ("key", files.key)):
            shutil.copy(path, folders[name] / f"{file}.pem")
    with DaskCluster(tmp_path / "dask", env, folders["cluster"]) as dask:
        dask.worker()
        assert dask.address.startswith("tls://")
        plain = dask.address.replace("tls://", "tcp://")
        finished(tmp_path / "out", env, "--on", plain, "--tls", str(folders["client"]))
        finished(tmp_path / "named", env | {"SRL_STUDY_TLS": str(folders["client"])}, "--on", dask.address)
        output = finished(tmp_path / "none", env, "--on", plain, code=2)
        assert "no scheduler answers" in output
        (tmp_path / "strange").mkdir()
        (tmp_path / "strangers").mkdir()
        stranger = certificates(tmp_path / "strangers", ["stranger"])["stranger"]
        for file, path in (("ca", stranger.ca), ("certificate", stranger.certificate), ("key", stranger.key)):
            shutil.copy(path, tmp_path / "strange" / f"{file}.pem")
        output = finished(tmp_path / "none", env, "--on", plain, "--tls", str(tmp_path / "strange"), code=2)
        assert "no scheduler answers" in output
    finished(tmp_path / "local", env)
    assert kept(tmp_path / "out" / "toy") == kept(tmp_path / "named" / "toy") == kept(tmp_path / "local" / "toy")


def test_where_nobody_answers_it_is_said_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    with pytest.raises(RequestError, match="no scheduler answers"):
        list(Cluster("tcp://127.0.0.1:1").run({}))
    with DaskCluster(tmp_path / "dask", dict(os.environ)) as dask, pytest.raises(RequestError, match="has no workers"):
        list(Cluster(dask.address).run({}))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"on": "tcp://10.2.3.4:8786"}, "whoever reaches a scheduler without TLS"),
        ({"on": "tls://127.0.0.1:8786"}, "TLS needs certificates"),
        ({"on": "127.0.0.1:8786"}, "this isn't an address"),
        ({"on": "tcp://127.0.0.1"}, "this isn't an address"),
        ({"on": "tcp://127.0.0.1:port"}, "this isn't an address"),
        ({"on": "tcp://127.0.0.1:8786", "tls": Path("/nowhere")}, "it has no ca.pem, certificate.pem, key.pem"),
        ({"tls": Path("/nowhere")}, "none is named"),
        ({"workers": 0}, "0 can't work"),
    ],
)
def test_options_that_cant_be_meant_are_refused(options: dict, words: str) -> None:
    with pytest.raises(RequestError, match=words):
        runner.runner(**options)
