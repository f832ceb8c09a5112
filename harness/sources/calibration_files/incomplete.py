"""The error for a file that is a calibration and lacks something that the user can add."""

from __future__ import annotations

from vfoa.errors import VfoaError


class IncompleteCalibrationError(VfoaError):
    """The file is of a known kind and cannot be used alone; the message says what is missing and how to give it.

    A search for calibrations passes over files that are none; these it reports.
    """
