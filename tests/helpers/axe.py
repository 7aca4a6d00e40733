"""axe-core, which looks for what keeps people from using a page. It is fetched from npm once, and never shipped."""

from __future__ import annotations

import json
import shutil
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import pytest

from helpers.chromium import Page
from srl.runtime.contracts.errors import HostError

VERSION = "4.14.1"
CACHE = Path(__file__).parents[2] / ".cache" / f"axe-core-{VERSION}.js"
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]


def script() -> str:
    """Its script. The test is skipped where there is no npm, or no network."""
    if not CACHE.exists():
        if not shutil.which("npm"):
            pytest.skip("no npm to fetch axe-core")
        CACHE.parent.mkdir(exist_ok=True)
        packed = subprocess.run(
            ["npm", "pack", "--silent", f"axe-core@{VERSION}"], cwd=CACHE.parent, capture_output=True, text=True,
            timeout=120, check=False,
        )  # fmt: skip
        if packed.returncode:
            pytest.skip(f"npm can't fetch axe-core: {packed.stderr.strip()[-200:]}")
        with tarfile.open(CACHE.parent / packed.stdout.strip()) as tar:
            member = tar.extractfile("package/axe.min.js")
            if member is None:
                raise HostError("axe-core", "its package has no axe.min.js", "Choose another version")
            CACHE.write_bytes(member.read())
    return CACHE.read_text()


def faults(page: Page) -> list[str]:
    """What it finds wrong: the rule, what it says, and the first elements."""
    page.value(script())
    found: Any = json.loads(
        page.value(
            f"axe.run(document, {{ runOnly: {json.dumps(RULES)}, resultTypes: ['violations'] }})"
            ".then((r) => r.violations.map((v) => [v.id, v.help, v.nodes.map((n) => n.html).slice(0, 3)]))"
            ".then(JSON.stringify)"
        )
    )
    return [f"{rule}: {words}: {elements}" for rule, words, elements in found]
