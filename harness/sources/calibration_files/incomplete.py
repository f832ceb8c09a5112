"""The error for a calibration file that lacks something that the user can add."""

from __future__ import annotations

from vfoa.errors import VfoaError


class IncompleteCalibrationError(VfoaError):
    """The file is of a known kind and cannot be used alone; the message says what is missing and how to give it.

    A search for calibrations ignores files of other kinds; it reports these.
    """
