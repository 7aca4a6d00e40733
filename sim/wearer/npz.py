"""NPZ files that somebody else wrote: only the wanted arrays, and none that can't be as large as it says."""

from __future__ import annotations

import math
import sys
import zipfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import read_regular

MOST: Final = 1 << 28  # bytes of a file, and of an array in it


def arrays(path: Path, wanted: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Those of the wanted arrays that are there: numbers as float64, texts as they are.

    Raises:
        RecordingError: it is no such file, or an array is damaged, of another kind, or not as large as it says.
    """
    name = ""
    try:
        with zipfile.ZipFile(BytesIO(read_regular(path, MOST + 1))) as file:
            found = {}
            for name in wanted:
                if f"{name}.npy" in file.namelist():
                    found[name] = _array(file, f"{name}.npy")
            return found
    except RecordingError:
        raise
    except Exception as error:  # zipfile, zlib and numpy raise what they please on damaged bytes
        where = f" (array '{name}')" if name else ""
        problem = f"it can't be read as NPZ{where}: {type(error).__name__} {error}"
        raise RecordingError(str(path), problem, "Write it with numpy.savez, without objects") from error


def _array(file: zipfile.ZipFile, name: str) -> NDArray[Any]:
    size = file.getinfo(name).file_size
    if size > MOST:
        raise ValueError(f"{size} bytes, at most {MOST} are read")
    data = BytesIO(file.read(name))
    version = np.lib.format.read_magic(data)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version}")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(data, max_header_size=10_000)
    if dtype.kind not in "biufU" or dtype.itemsize == 0:
        raise ValueError(f"it holds {dtype}, not numbers or names")
    if math.prod(shape) * dtype.itemsize != size - data.tell() or any(n < 0 for n in shape):
        raise ValueError(f"a shape of {shape} is not that of its {size - data.tell()} bytes")
    data.seek(0)
    made: NDArray[Any] = np.lib.format.read_array(data, allow_pickle=False)
    if dtype.kind == "U":
        made = np.ascontiguousarray(made.astype(dtype.newbyteorder("=")))
        if made.size and int(made.view(np.uint32).max()) > sys.maxunicode:
            raise ValueError("it holds what is no text")
        return made
    return made.astype(np.float64)
