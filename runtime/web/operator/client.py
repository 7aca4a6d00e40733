"""The panel's process, as `srl panel` starts it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel.client import PageProcess


class OperatorPage(PageProcess):
    """The operator's panel of a running instance; a context manager."""

    called: ClassVar = "the panel"
    module: ClassVar = "srl.runtime.web.operator"

    def __init__(self, run_folder: RunFolder, recordings: Path | None = None, port: int = 0) -> None:
        """Starts the process. `recordings`: the folder whose recordings are shown. Raises HostError."""
        super().__init__(run_folder, ["--recordings", str((recordings or Path()).absolute())], port)
