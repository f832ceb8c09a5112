"""Recognise the adapter and settings for a path; if several fit, one line lists them and the setting that decides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from harness.sources import ADAPTERS, GuidedRecogniser, Recognised, Recogniser
from vfoa.errors import VfoaError

_CALIBRATIONS = ("calibration", "camera")

_ZED = "expected a video or images: the ZED SDK's ZED_SVO_Editor (or its sample svo export) writes them"
_RAW = "expected PNG or JPEG: darktable-cli or dcraw convert camera raw files"
CONVERTED_BY = {
    ".svo": _ZED,
    ".svo2": _ZED,
    ".oni": "expected images: OpenNI 2's Python binding (openni2) or OpenCV built with OpenNI write them as PNG",
    ".heic": "expected PNG or JPEG: ImageMagick (magick in.heic out.png) converts it",
    ".heif": "expected PNG or JPEG: ImageMagick (magick in.heif out.png) converts it",
    ".dng": _RAW,
    ".cr2": _RAW,
    ".nef": _RAW,
    ".arw": _RAW,
    ".insv": "expected a video: ffmpeg -i in.insv -c copy out.mp4 rewraps it",
    ".npz": "expected images: write the arrays as PNG (cv2.imwrite)",
    ".h5": "expected images: export the data set as PNG (h5py and cv2.imwrite)",
    ".hdf5": "expected images: export the data set as PNG (h5py and cv2.imwrite)",
    ".zip": "expected a folder: unpack it first",
    ".tar": "expected a folder: unpack it first",
    ".gz": "expected a folder: unpack it first",
    ".7z": "expected a folder: unpack it first",
}
"""Advice for a file that no adapter reads, by its suffix."""


class Reading(NamedTuple):
    """A way to read a path, and its adapter."""

    adapter: str
    found: Recognised


def recognise(path: Path, adapter: str | None, given: Mapping[str, Any]) -> Reading:
    """Return the only way to read a path that agrees with the given settings, filled in with them.

    Ways without a calibration count only if no other has one.

    Raises
    ------
    VfoaError
        If no or several ways remain, or the calibration is missing.
    """
    readings = _readings(path, adapter, given)
    complete = [each for each in readings if each.found.calibration] or readings
    fitting = [each for each in complete if len(complete) == 1 or _agrees(each.found, given)]
    filled = [Reading(each.adapter, _filled(each.found, given)) for each in fitting]
    distinct = [each for place, each in enumerate(filled) if each not in filled[:place]]
    if len(distinct) != 1:
        raise VfoaError(f"{path}: {_alternatives(fitting or complete)}")
    if distinct[0].found.calibration is None:
        raise VfoaError(f"{path}: {_without_calibration(distinct[0].found)}")
    return distinct[0]


def _without_calibration(found: Recognised) -> str:
    if found.incomplete:
        return f"{found.layout}; {'; '.join(found.incomplete)}"
    return (
        f"{found.layout}; no calibration was found; expected --calibration FILE (formats: datasets/README.md; in the "
        "manifest: calibration = in [source]), or --fx --cx --cy, and --baseline of a rectified pair, in pixels and "
        "metres (the table [source.camera])"
    )


def _readings(path: Path, adapter: str | None, given: Mapping[str, Any]) -> list[Reading]:
    """Return every way in which an adapter can read the path."""
    if not path.exists():
        raise VfoaError(f"{path}: no such file or folder")
    names = [adapter] if adapter else ADAPTERS.names()
    asked = {name: cls for name in names if isinstance(cls := ADAPTERS.load(name), Recogniser)}
    found: list[Reading] = []
    failures: list[VfoaError] = []
    for name, cls in asked.items():
        try:
            seen = cls.recognise_as(path, given) if isinstance(cls, GuidedRecogniser) else cls.recognise(path)
            found += [Reading(name, each) for each in seen]
        except VfoaError as error:
            failures.append(error)
    if found:
        return found
    if failures:
        raise failures[0]
    who = ", ".join(asked or names)
    expected = CONVERTED_BY.get(path.suffix.lower(), "expected one of the sources in datasets/README.md")
    raise VfoaError(f"{path}: not recognised by {who}; {expected}")


def _agrees(found: Recognised, given: Mapping[str, Any]) -> bool:
    return all(found.source.get(key, value) == value for key, value in given.items() if key not in _CALIBRATIONS)


def _filled(found: Recognised, given: Mapping[str, Any]) -> Recognised:
    calibrations = {key: _below(found.root, value) for key, value in given.items() if key in _CALIBRATIONS}
    if not calibrations:
        return replace(found, source={**found.source, **given})
    seen = {key: value for key, value in found.source.items() if key not in _CALIBRATIONS}
    return replace(found, source={**seen, **given, **calibrations}, calibration="as given")


def _below(root: Path, calibration: Any) -> Any:
    """Paths of files relative to the clip's root, if they are below it, so that all can be moved together."""
    if isinstance(calibration, list):
        return [_below(root, each) for each in calibration]
    if isinstance(calibration, str) and Path(calibration).is_relative_to(root):
        return str(Path(calibration).relative_to(root))
    return calibration


def _alternatives(readings: Sequence[Reading]) -> str:
    """The settings in which readings differ, each with its values and the option that decides."""
    if len({each.adapter for each in readings}) > 1:
        layouts = ", ".join(f"--adapter {adapter} ({found.layout})" for adapter, found in readings)
        return f"several adapters can read it; expected one of: {layouts}"
    keys = dict.fromkeys(key for each in readings for key in each.found.source)
    values = {key: [_worded(key, each.found.source.get(key)) for each in readings] for key in keys}
    # One key that distinguishes all of them is enough: the left folder implies the right one.
    deciding = [key for key in keys if len(set(values[key])) == len(readings)][:1]
    choices = [
        f"{_option(key)}({' | '.join(dict.fromkeys(values[key]))})"
        for key in deciding or [key for key in keys if len(set(values[key])) > 1]
    ]
    return f"it can be read in {len(readings)} ways; expected {' and '.join(choices)}"


def _worded(key: str, value: Any) -> str:
    return " --calibration ".join(value) if key == "calibration" and isinstance(value, list) else str(value)


def _option(key: str) -> str:
    return "--calibration " if key == "calibration" else f"--set {key}="
