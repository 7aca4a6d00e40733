"""One bench in a process of its own: what it breaks, or leaves behind, is no other bench's.

`python -m bench.one MODULE:FUNCTION FILE [ARGUMENT ...]` writes {"rows": [...], "failed": "why, or empty"} to the file.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path
from typing import Any

from bench.pairs import QUICK, PartlyError, Row

LONGEST = 400.0  # s that one bench may take
_ROOT = Path(__file__).resolve().parents[1]
_GRACE = 5.0  # s for what it started to end


def run(
    function: str, arguments: tuple[int, ...] = (), quick: bool = False, longest: float = LONGEST
) -> tuple[list[Row], str]:
    """Runs the bench; returns its rows, and why it failed: raised, crashed, or took longer than `longest` (s).

    Whatever it started has ended then. Some rows may be there all the same.
    """
    with tempfile.TemporaryDirectory(prefix="srl-bench-") as folder:
        out = Path(folder) / "rows.json"
        command = [sys.executable, "-m", "bench.one", function, str(out), *map(str, arguments)]
        environment = os.environ | ({QUICK: "1"} if quick else {})
        child = subprocess.Popen(
            command, cwd=_ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        try:
            code = child.wait(longest)
        except subprocess.TimeoutExpired:
            return [], f"it had no figures after {longest:g} s"
        finally:
            _end(child)
        if not out.exists():
            ended = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            return [], f"its process ended without a word ({ended})"
        found: dict[str, Any] = json.loads(out.read_text())
    return [Row(**row) for row in found["rows"]], str(found["failed"])


def _end(child: subprocess.Popen[bytes]) -> None:
    """Ends the bench and all that it started: they are one session."""
    for how, most in ((signal.SIGTERM, _GRACE), (signal.SIGKILL, 0.5)):
        until = time.monotonic() + most
        try:
            os.killpg(child.pid, how)
            while time.monotonic() < until:
                child.poll()
                os.killpg(child.pid, 0)
                time.sleep(0.02)
        except ProcessLookupError:
            break
    child.wait()


def reason(error: BaseException) -> str:
    """Why a bench failed: the error in words, where in the bench it was, and what the command that failed said last."""
    frames = [
        f
        for f in traceback.extract_tb(error.__traceback__)
        if Path(f.filename).is_relative_to(_ROOT) and f.filename != __file__
    ]
    where = f" (at {Path(frames[-1].filename).relative_to(_ROOT)}:{frames[-1].lineno})" if frames else ""
    if isinstance(error, subprocess.CalledProcessError):
        output = error.stderr or b""
        text = output.decode(errors="replace") if isinstance(output, bytes) else output
        last = next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "nothing")
        command = " ".join(map(str, error.cmd)) if isinstance(error.cmd, list) else str(error.cmd)
        return f"`{command}` ended with {error.returncode} and said: {last}{where}"
    if isinstance(error, SystemExit):
        return f"{error.code}{where}"
    return f"{type(error).__name__}: {error}{where}"


def main(function: str, out: str, *arguments: str) -> int:
    """Runs the bench in this process."""
    module, _, name = function.partition(":")
    try:
        rows, why = getattr(importlib.import_module(module), name)(*map(int, arguments)), ""
    except PartlyError as error:
        rows, why = error.rows, str(error)
    except (Exception, SystemExit) as error:
        rows, why = [], reason(error)
    Path(out).write_text(json.dumps({"rows": [row.metrics() for row in rows], "failed": why}))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
