"""Parses calibration files of any kind."""

from __future__ import annotations

import json
from typing import Any

from ruamel.yaml.error import YAMLError

from srl.runtime.contracts import yaml_text


def parse(content: bytes) -> dict[str, Any]:
    """Parses the file; returns {} if it isn't a calibration file."""
    try:
        record = json.loads(content)
    except RecursionError:
        return {}
    except ValueError:
        try:
            record = yaml_text.load(content.decode())  # a glove's may be YAML
        except (YAMLError, ValueError, RecursionError):
            return {}
    return record if isinstance(record, dict) else {}
