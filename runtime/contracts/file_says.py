"""What a calibration file holds, of whatever kind it is."""

from __future__ import annotations

import json
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError


def file_says(content: bytes) -> dict[str, Any]:
    """What a calibration file holds; nothing, where it is none."""
    try:
        said = json.loads(content)
    except ValueError:
        try:
            said = YAML(typ="safe", pure=True).load(content.decode())  # a glove's may be YAML
        except (YAMLError, ValueError):
            return {}
    return said if isinstance(said, dict) else {}
