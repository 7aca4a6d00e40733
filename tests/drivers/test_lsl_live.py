"""liblsl can't be bound to loopback: its tests run in a network namespace of their own, and are refused outside."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.run import environment

from srl.drivers.lsl import Lsl, LslConfig
from srl.runtime.contracts.errors import DeviceError

NAMESPACE = ("unshare", "-rn")
CONFIG = {"stream": {"source_id": "amp-7"}, "rate": 500, "signals": {"emg": {"channels": {"a": "A"}, "unit": "V"}}}


def inside(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    words = [*NAMESPACE, "sh", "-ec", f"ip link set lo up; {command}"]
    paths = {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    return subprocess.run(
        words, env=environment(folder) | paths, cwd=ROOT, capture_output=True, text=True, timeout=110, check=False
    )


needs_namespaces = pytest.mark.skipif(
    shutil.which("unshare") is None
    or subprocess.run([*NAMESPACE, "true"], check=False, capture_output=True).returncode != 0,
    reason="this machine gives no network namespaces",
)


@pytest.mark.slow
@needs_namespaces
def test_against_outlets_of_liblsl(tmp_path: Path) -> None:
    pytest.importorskip("pylsl")
    peers = ROOT / "tests/drivers/in_namespace_lsl.py"
    done = inside(f"{sys.executable} -m pytest -q -p no:cacheprovider {peers}", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.match(r"\.{7} ", done.stdout)  # none was skipped


@needs_namespaces
def test_where_other_machines_could_reach_it_it_refuses(tmp_path: Path) -> None:
    pytest.importorskip("pylsl")
    script = tmp_path / "opens.py"
    script.write_text(
        "from srl.drivers.lsl import Lsl, LslConfig\n"
        f"try:\n    Lsl('amp', LslConfig.model_validate({CONFIG!r})).open()\n"
        "except Exception as error:\n    print(error)\n"
    )
    done = inside(f"ip addr add 10.98.7.6/32 dev lo; {sys.executable} {script}", tmp_path)
    assert "other machines could reach it at 10.98.7.6" in done.stdout, done.stderr
    assert "unencrypted_network: true" in done.stdout


def test_without_the_package_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DeviceError, match=r"pip install 'srl-runtime\[lsl\]'"):
        Lsl("amp", LslConfig.model_validate(CONFIG)).open()
