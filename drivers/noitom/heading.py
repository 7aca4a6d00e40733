"""Reads a suit's calibration: the heading that is taken back."""

from __future__ import annotations

import json

from pydantic import ValidationError

from srl.runtime.contracts.checksummed import HASH, ChangedError, opened
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.suit_record import SuitRecord
from srl.runtime.contracts.validation import refusal

_AGAIN = "Calibrate again: `srl calibrate PROFILE suit`"


def load(file: KeptFile) -> SuitRecord:
    """Reads what `srl calibrate PROFILE suit` wrote. Raises ProfileError: it was changed, or is something else."""
    place = str(file.path)
    try:
        return SuitRecord.model_validate_json(json.dumps(opened(file.content)))
    except ChangedError as error:
        remedy = f'{_AGAIN}; if you changed it on purpose, take "{HASH}" out'
        raise ProfileError(place, str(error), remedy) from None
    except ValidationError as error:
        first = refusal(error)
        raise ProfileError(first.at(place), first.problem, first.remedy_or(_AGAIN)) from None
    except (ValueError, RecursionError) as error:
        problem = f"it is no JSON: {error}" if isinstance(error, ValueError) else "it is nested too deeply"
        raise ProfileError(place, problem, _AGAIN) from None
