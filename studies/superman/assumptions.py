"""The assumptions of the SUPER-MAN studies: values fixed before they run, each with its source."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML

FILE: Final = Path(__file__).with_suffix(".yaml")


def assumed(study: str) -> dict[str, Any]:
    """Returns the values of a study's section of assumptions.yaml, by name."""
    section = YAML(typ="safe", pure=True).load(FILE)[study]
    return {name: entry["value"] for name, entry in section.items()}
