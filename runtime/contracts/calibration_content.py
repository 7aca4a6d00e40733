"""What a calibration file holds, of whatever kind it is."""

from __future__ import annotations

import json
from typing import Any

from ruamel.yaml.error import YAMLError

from srl.runtime.contracts import yaml_text


def parse(content: bytes) -> dict[str, Any]:
    """What a calibration file holds; nothing, where it is none."""
    try:
        output = json.loads(content)
    except RecursionError:
        return {}
    except ValueError:
        try:
            output = yaml_text.load(content.decode())  # a glove's may be YAML
        except (YAMLError, ValueError, RecursionError):
            return {}
    return output if isinstance(output, dict) else {}
