"""A study of somebody else's package: trials of pure arithmetic, which can be told to wait, to fail or to die.

`installed` writes the package's metadata and module, so the study, its trial and every worker find it as an installed
one.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

from helpers import ROOT
from helpers.run import ended, srl
from srl.studies.tasks import journal, table

DIFFERENT = ("seconds", "worker")  # from run to run

MODULE = '''
"""The toy study."""
import os, signal, time
from collections.abc import Iterator
from pathlib import Path
import numpy as np
from srl.studies.result import Claim, Result
from srl.studies.tasks.task import TrialTask

TRIALS = 12

def trial(profile, parameters, seed):
    gate, bomb = parameters.get("gate"), parameters.get("bomb")
    if bomb and not Path(bomb).exists():
        if not parameters.get("always"):
            Path(bomb).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    while gate and not Path(gate).exists():
        time.sleep(0.005)
    if parameters.get("wrong"):
        raise ValueError("no such wire\\udcff")
    draw = np.random.default_rng(seed)
    end, total = time.process_time() + parameters.get("cpu", 0.0), 0.0
    while time.process_time() < end:
        total += 1.0
    a = draw.standard_normal((40, 40))
    return {
        "mean": float((a @ a).mean()), "count": int(draw.integers(100)), "name": f"wearer-{seed}-\\u00e9",
        "hit": bool(draw.random() < 0.5), "none": None, "nan": np.nan if seed % 2 else np.float64(-np.inf),
    }

def tasks(folder, **parameters):
    out = []
    for seed in range(int(os.environ.get("TOY_TRIALS", TRIALS))):
        given = dict(parameters, cpu=float(os.environ.get("TOY_CPU", "0")))
        if seed >= 6 and "TOY_GATE" in os.environ:
            given["gate"] = os.environ["TOY_GATE"]
        if seed == 3 and "TOY_BOMB" in os.environ:
            given["bomb"] = os.environ["TOY_BOMB"]
        if seed == 5 and "TOY_ALWAYS" in os.environ:
            given |= {"bomb": "/nowhere", "always": True}
        if seed == 4 and "TOY_WRONG" in os.environ:
            given["wrong"] = True
        out.append(TrialTask.of("toy", "toy", seed, given, profile="sixth-finger"))
    return out

def run(folder, quick, runner):
    rows = runner.rows(tasks(folder), folder)
    done = [row for row in rows if row.done]
    return Result("toy", True, [row.task.seed for row in rows], table=[{"seed": r.task.seed} | r.values for r in done])
'''


def installed(folder: Path) -> dict[str, str]:
    """The environment of processes that have the toy package; it is written into `folder`."""
    info = folder / "toy_study-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "toy_study.py").write_text(MODULE)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-study\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[srl.studies]\ntoy = toy_study:run\n\n[srl.trials]\ntoy = toy_study:trial\n\n"
        "[srl.runners]\ntasks = srl.studies.tasks.runner:runner\n"
    )
    before = os.environ.get("PYTHONPATH", "")
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT), before])}


def kept(folder: Path) -> str:
    """The table of a folder, bit for bit, without what differs from run to run."""
    rows = table.read(folder / table.FILE)
    return repr([{name: value for name, value in row.items() if name not in DIFFERENT} for row in rows])


def lines(folder: Path) -> int:
    """The whole rows in a journal."""
    file = folder / journal.FILE
    return file.read_bytes().count(b"\n") if file.exists() else 0


@contextlib.contextmanager
def started(folder: Path, env: dict[str, str], *more: str) -> Iterator[subprocess.Popen[str]]:
    """`srl study toy` in the background; with its workers it ends with the `with` at the latest."""
    with ended(srl("study", "toy", "--out", str(folder), "--json", *more), env=env) as client:
        yield client
