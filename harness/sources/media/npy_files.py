"""Arrays in NumPy's format, read without trust in the file."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.files.io import read_bytes
from vfoa.errors import VfoaError

_DAMAGED = (ValueError, EOFError, OSError, SyntaxError, TokenError, MemoryError, OverflowError)
"""Errors that NumPy raises for a damaged file: its header is Python."""


def read_npy(path: Path) -> NDArray[Any]:
    """Read an array of numbers; no pickle.

    Raises
    ------
    VfoaError
        If it cannot be read, or is no such file.
    """
    try:
        data = io.BytesIO(read_bytes(path))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file that Python 2 wrote
            return np.lib.format.read_array(data, allow_pickle=False)
    except _DAMAGED as error:
        raise VfoaError(f"{path}: not an npy file: {error}") from None
