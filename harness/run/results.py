"""Records of a run: named, plain values per frame, one JSON line each in ``results.jsonl``.

Everything the scores, tables and pages need is here, so that none of them needs images or models. Every line begins
with the version of the format, so that files can be joined line by line.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING

from harness.bounded_parsing import parse_json
from harness.files import check_readable, unreadable
from harness.stages.measures import FrameMeasures
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    import msgspec

VERSION = 1
_START = b'{"version":%d,' % VERSION

Vector = tuple[float, float, float]
BoxPx = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxRecord:
    """A 3D box in the camera frame: centre and half extents in metres, axes as rows (the rotation's columns)."""

    center_m: Vector
    half_size_m: Vector
    axes: tuple[Vector, Vector, Vector]


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetRecord:
    """One instance of a frame. ``name`` is the manifest's name for it, or ``label#id``; it may occur twice.

    ``box_px`` is None where the clip has no images.
    """

    instance_id: int
    name: str
    label: str
    score: float
    box_px: BoxPx | None
    points: int
    box: BoxRecord | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AttentionRecord:
    """A subject's attention to one instance, each in [0, 1]; None: that cue was not measured."""

    instance_id: int
    gaze: float | None
    head: float | None
    total: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionFitRecord:
    """How well a subject's directions fit the posterior, as :class:`vfoa.types.DirectionFit` has it."""

    tail: float
    claimed_error_rad: float | None
    implied_error_rad: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SubjectRecord:
    """One tracked person of a frame.

    ``name`` is the manifest's name, None for a person it does not know. Directions are unit vectors after
    filtering, camera frame. ``missing`` is ``no_eyes_3d``, ``no_direction`` or None. ``focus`` is the instance id
    with the most attention, None for nowhere. ``head_box_px`` is None where the clip has no images.
    ``fit`` is there where the attention is a probability.
    """

    track_id: int
    name: str | None
    instance_id: int | None
    head_box_px: BoxPx | None
    eye_origin_m: Vector | None
    gaze: Vector | None
    gaze_sigma_rad: float | None
    head: Vector | None
    missing: str | None
    attention: tuple[AttentionRecord, ...]
    focus: int | None
    tied: tuple[int, ...]
    fit: DirectionFitRecord | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRecord:
    """All of one frame of one clip under one configuration. ``measures`` is None where the clip knows no truth."""

    clip: str
    configuration: str
    frame: int
    time_ns: int
    targets: tuple[TargetRecord, ...]
    subjects: tuple[SubjectRecord, ...]
    measures: FrameMeasures | None = None

    def __post_init__(self) -> None:
        known = {target.instance_id for target in self.targets}
        if len(known) != len(self.targets):
            raise ValueError(f"frame {self.frame}: expected distinct instance ids in targets")
        for subject in self.subjects:
            named = {value.instance_id for value in subject.attention}
            if subject.focus is not None:
                named.add(subject.focus)
            if not named <= known:
                raise ValueError(
                    f"frame {self.frame}: track {subject.track_id} attends to instances {sorted(named - known)}, "
                    "which are not in targets"
                )

    def target(self, instance_id: int) -> TargetRecord:
        """The target with this instance id."""
        return next(target for target in self.targets if target.instance_id == instance_id)


def to_line(record: FrameRecord) -> str:
    """One frame as a line of ``results.jsonl``, its newline included.

    Raises
    ------
    ValueError
        If reading the line would not give the same record: a number is not finite, or a value is of another type.
    """
    encoder, decoder = _codec()
    line = _START + encoder.encode(record)[1:]
    if decoder.decode(line) != record:
        raise ValueError(f"frame {record.frame} of {record.clip}: a value would not survive the file: {record}")
    return line.decode() + "\n"


def read_results(path: Path) -> Iterator[FrameRecord]:
    """Read a ``results.jsonl``, one record at a time in the order of the file. Nothing is skipped or repaired.

    Raises
    ------
    VfoaError
        If the file is missing, a line is of another version or not a frame's record, the last line is cut, or a
        frame stands in it twice; the message names the file and the line.
    """
    seen: dict[tuple[str, str, int], int] = {}
    check_readable(path)
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                record = _from_line(line, path, number)
                _check_first(seen, record, path, number)
                yield record
    except OSError as error:
        raise unreadable(path, error) from None


def _from_line(line: bytes, path: Path, number: int) -> FrameRecord:
    import msgspec

    _check_form(line, path, number)
    try:
        return _codec()[1].decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise VfoaError(f"{path}:{number}: not a frame's record: {error}") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Consecutive lines of a ``results.jsonl``, of one configuration on one clip: their bytes, and what they hold.

    ``line`` is the number of the first. ``digest`` is of the bytes.
    """

    clip: str
    configuration: str
    line: int
    start: int
    end: int
    frames: tuple[int, ...]
    digest: str


BLOCK_FRAMES = 500
"""Frames of a block at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    clip: str
    configuration: str
    frame: int


def find_blocks(path: Path) -> list[Block]:
    """Cut a ``results.jsonl`` into blocks, of which only the places of the records are read.

    Raises
    ------
    VfoaError
        As :func:`read_results` does for what can be seen so; :func:`read_block` sees the rest.
    """
    seen: dict[tuple[str, str, int], int] = {}
    cut: list[Block] = []
    frames: list[int] = []
    first, start, end = 1, 0, 0
    pair: tuple[str, str] | None = None
    check_readable(path)
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                place = _place(line, path, number)
                _check_first(seen, place, path, number)
                if pair is not None and ((place.clip, place.configuration) != pair or len(frames) == BLOCK_FRAMES):
                    cut.append(_block(path, pair, first, start, end, frames))
                    frames, first, start = [], number, end
                pair = place.clip, place.configuration
                frames.append(place.frame)
                end += len(line)
        return [*cut, _block(path, pair, first, start, end, frames)] if pair else cut
    except OSError as error:
        raise unreadable(path, error) from None


def read_block(path: Path, block: Block) -> Iterator[FrameRecord]:
    """Read the records of a block. Raises as :func:`read_results` does."""
    lines = block_bytes(path, block).splitlines(keepends=True)
    return (_from_line(line, path, number) for number, line in enumerate(lines, start=block.line))


def block_bytes(path: Path, block: Block) -> bytes:
    """The lines of a block, fewer where the file has become shorter."""
    try:
        with path.open("rb") as file:
            file.seek(block.start)
            return file.read(block.end - block.start)
    except OSError as error:
        raise unreadable(path, error) from None


def lines_digest(lines: bytes) -> str:
    """The digest of a block's lines."""
    return hashlib.blake2b(lines, digest_size=16).hexdigest()


def _block(path: Path, pair: tuple[str, str], first: int, start: int, end: int, frames: list[int]) -> Block:
    block = Block(
        clip=pair[0], configuration=pair[1], line=first, start=start, end=end, frames=tuple(frames), digest=""
    )
    return replace(block, digest=lines_digest(block_bytes(path, block)))


def _place(line: bytes, path: Path, number: int) -> _Place:
    import msgspec

    _check_form(line, path, number)
    try:
        return _place_decoder().decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise VfoaError(f"{path}:{number}: not a frame's record: {error}") from None


def _check_form(line: bytes, path: Path, number: int) -> None:
    if not line.endswith(b"\n"):
        raise VfoaError(f"{path}:{number}: cut short: expected a newline at its end")
    if not line.startswith(_START):
        _check_version(line, path, number)


def _check_version(line: bytes, path: Path, number: int) -> None:
    """Accept a line another program wrote (spaces, another order of keys), if it says the right version."""
    value = parse_json(line, f"{path}:{number}")
    version = value.get("version") if isinstance(value, dict) else None
    if version != VERSION:
        raise VfoaError(f"{path}:{number}: expected version {VERSION}, found {version!r}")


def _check_first(seen: dict[tuple[str, str, int], int], record: FrameRecord | _Place, path: Path, number: int) -> None:
    first = seen.setdefault((record.clip, record.configuration, record.frame), number)
    if first != number:
        raise VfoaError(
            f"{path}:{number}: frame {record.frame} of clip {record.clip!r} under {record.configuration!r} "
            f"is on line {first} already"
        )


@cache
def _place_decoder() -> msgspec.json.Decoder[_Place]:
    import msgspec

    return msgspec.json.Decoder(_Place)


@cache
def _codec() -> tuple[msgspec.json.Encoder, msgspec.json.Decoder[FrameRecord]]:
    import msgspec

    return msgspec.json.Encoder(enc_hook=_plain), msgspec.json.Decoder(FrameRecord)


def _plain(value: object) -> int | float:
    """A number of numpy's as Python's own; the encoder knows no other."""
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    raise TypeError(f"expected plain numbers, text and tuples in a record, found {type(value).__name__}")
