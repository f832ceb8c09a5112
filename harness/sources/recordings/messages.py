"""Contents of camera messages: time stamp, pixels, calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.sources.recordings.decoding import fields_of, reading
from harness.sources.recordings.message_types import IMAGES, MessageType
from harness.sources.rectification import MODELS, RawCamera
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class RawPicture:
    """Pixels as a driver sent them: ``step`` bytes per row, ``encoding`` as ROS and Foxglove name it."""

    width_px: int
    height_px: int
    encoding: str
    step: int
    is_bigendian: bool
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class CompressedPicture:
    """A compressed image, or a packet of a video; ``form`` is the message's description of its compression.

    ``is_key`` is the packet's own flag for a key frame; None if it has none.
    """

    form: str
    data: bytes
    is_key: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """An image's description: encoding or format, (width, height) if given, and the name of its coordinate frame."""

    form: str
    size_px: tuple[int, int] | None
    frame_id: str


def stamp_ns(kind: MessageType, data: bytes, where: str) -> int:
    """Time at which the picture was taken: the header's stamp, nanoseconds.

    Raises
    ------
    VfoaError
        If the message is not of its type, or an image's stamp was not set.
    """
    with reading(kind, where):
        stamp = _stamp_ns(kind, fields_of(kind, data, where))
    if stamp == 0 and kind.kind in IMAGES:  # a calibration that is sent once may be valid for all times
        raise VfoaError(
            f"{where}: a {kind.name} without time stamp; expected one, images are joined by it "
            '(stamps = "log" in [source] joins them by the time of recording)'
        )
    return stamp


def sight(kind: MessageType, data: bytes, where: str) -> Sight:
    """The description in an image's or a calibration's message, without its content."""
    with reading(kind, where):
        field = fields_of(kind, data, where)
        frame_id = _frame_id(kind, field)
        names = {"raw": "encoding", "calibration": "distortion_model", "video": _form(kind)}
        form = str(field(names.get(kind.kind or "", "format")))
        size = (int(field("width")), int(field("height"))) if kind.kind in ("raw", "calibration") else None
        return Sight(form=form, size_px=size, frame_id=frame_id.removeprefix("/"))  # tf's old names began with a slash


def picture(kind: MessageType, data: bytes, where: str) -> RawPicture | CompressedPicture:
    """Return the pixels of a raw image, or the bytes of a compressed one or of a packet of a video.

    Raises
    ------
    VfoaError
        If the message is not of its type.
    """
    with reading(kind, where):
        field = fields_of(kind, data, where)
        if kind.kind == "compressed":
            return CompressedPicture(form=str(field("format")), data=bytes(field("data")))
        if kind.kind == "video":
            says_key = _form(kind) == "encoding"
            return CompressedPicture(
                form=str(field(_form(kind))),
                data=bytes(field("data")),
                is_key=bool(int(field("flags")) & 1) if says_key else None,  # FFmpeg's AV_PKT_FLAG_KEY
            )
        return RawPicture(
            width_px=int(field("width")),
            height_px=int(field("height")),
            encoding=str(field("encoding")),
            step=int(field("step")),
            is_bigendian=not _is_flat(kind) and bool(field("is_bigendian")),
            data=bytes(field("data")),
        )


def camera(kind: MessageType, data: bytes, where: str) -> RawCamera:
    """Return the calibration of one camera.

    Raises
    ------
    VfoaError
        If the distortion model is unknown, or the matrices have another number of entries.
    """
    with reading(kind, where):
        field = fields_of(kind, data, where)
        model = str(field("distortion_model"))
        if model not in MODELS:
            known = ", ".join(filter(None, MODELS))
            raise VfoaError(f"{where}: distortion model {model!r}; expected one of {known}")
        if not _is_flat(kind):
            _check_full_size(field, where)
        k, d, r, p = (np.array(field(name), dtype=np.float64).reshape(-1) for name in ("k", "d", "r", "p"))
        if (k.size, r.size, p.size) != (9, 9, 12):
            raise VfoaError(f"{where}: found {k.size}, {r.size}, {p.size} numbers in K, R, P; expected 9, 9, 12")
        return RawCamera(
            size_px=(int(field("width")), int(field("height"))),
            k=k.reshape(3, 3),
            d=d,
            r=r.reshape(3, 3),
            p=p.reshape(3, 4),
            model=MODELS[model],
        )


def _check_full_size(field: Callable[[str], Any], where: str) -> None:
    """Check that a calibration is of the whole sensor: binning and regions of interest are not supported."""
    roi, binning = field("roi"), (int(field("binning_x")), int(field("binning_y")))
    if max(binning) > 1 or int(roi.x_offset) or int(roi.y_offset):
        raise VfoaError(
            f"{where}: binning {binning}, region of interest from ({roi.x_offset}, {roi.y_offset}); "
            "expected the whole image, or calibration = (a file) in [source]"
        )


def _is_flat(kind: MessageType) -> bool:
    """Whether stamp and frame are fields of the message itself, as in Foxglove's types, and not of a header."""
    return not kind.is_ros or kind.name.startswith("foxglove_msgs/")


def _frame_id(kind: MessageType, field: Callable[[str], Any]) -> str:
    """The name of the coordinate frame; empty for a message in JSON without one."""
    if not _is_flat(kind):
        return str(field("header").frame_id)
    try:
        return str(field("frame_id"))
    except VfoaError:
        return ""


def _form(kind: MessageType) -> str:
    """The field of a packet that names its codec."""
    return "encoding" if kind.name.startswith("ffmpeg_image_transport_msgs/") else "format"


def _stamp_ns(kind: MessageType, field: Callable[[str], Any]) -> int:
    """The stamp in nanoseconds; 0 if it was not set, or is missing in JSON."""
    if kind.message_encoding == "json":
        try:
            time = field("timestamp")
        except VfoaError:
            return 0
        return int(time.get("sec", 0)) * 10**9 + int(time.get("nsec", 0))
    stamp = field("timestamp") if _is_flat(kind) else field("header").stamp
    if kind.is_ros:
        return int(stamp.sec) * 10**9 + int(stamp.nanosec)
    return int(stamp.seconds) * 10**9 + int(stamp.nanos)
