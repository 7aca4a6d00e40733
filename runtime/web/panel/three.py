"""Gets three.js, with which the picture in the browser is drawn: `python -m srl.runtime.web.panel.three`.

The build of the package does the same (`native/build.py`), so that it is in the wheel. npm fetches it; this checks that
it is the one that was tried. Nothing here imports anything of srl: a build has none of it.
"""

from __future__ import annotations

import base64
import hashlib
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Final

VERSION: Final = "0.184.0"
SHA512: Final = "wtTRjG92pM5eUg/KuUnHsqSAlPM296brTOcLgMRqEeylYTh/CdtvKUvCyyCQTzFuStieWxvZb8mVTMvdPyUpxg=="
FOLDER: Final = Path(__file__).parent / "page" / "three"
FILES: Final = ("build/three.module.min.js", "build/three.core.min.js", "LICENSE")
TIMEOUT: Final = 120.0  # s


def there() -> bool:
    """Whether it is installed."""
    return all((FOLDER / Path(name).name).exists() for name in FILES)


def fetch() -> str:
    """Gets it, if it isn't there. Returns what went wrong; empty if nothing."""
    if there():
        return ""
    if (npm := shutil.which("npm")) is None:
        return "npm isn't installed"
    with tempfile.TemporaryDirectory() as made:
        command = [npm, "pack", f"three@{VERSION}", "--silent", "--prefer-offline", "--fetch-retries=0"]
        try:
            subprocess.run(command, cwd=made, check=True, capture_output=True, text=True, timeout=TIMEOUT)
        except subprocess.CalledProcessError as error:
            return f"npm can't get it: {(error.stderr.strip().splitlines() or ['it does not say why'])[-1]}"
        except (OSError, subprocess.TimeoutExpired) as error:
            return f"npm can't get it: {error}"
        packed = Path(made) / f"three-{VERSION}.tgz"
        found = base64.b64encode(hashlib.sha512(packed.read_bytes()).digest()).decode()
        if found != SHA512:
            return f"what npm gave isn't three {VERSION}: its SHA-512 is {found}"
        FOLDER.mkdir(parents=True, exist_ok=True)
        with tarfile.open(packed) as tar:
            for name in FILES:
                member = tar.extractfile(f"package/{name}")
                assert member is not None, name
                (FOLDER / Path(name).name).write_bytes(member.read())
    return ""


if __name__ == "__main__":
    if problem := fetch():
        sys.exit(f"three.js: {problem}. Without it the panel's picture is flat")
