"""``results.jsonl``: the records of a run, one JSON line per frame.

Every line begins with the version of the format, so that files can be joined line by line.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec

from harness.clips.manifest import ClipManifest
from harness.files.io import opened
from harness.pipeline.frame_measures import FrameMeasures, TargetMeasure
from harness.run.directory import Pair, RunDirectory
from harness.run.grid import base_of
from harness.run.records import FrameRecord, renamed
from vfoa.errors import VfoaError, check_known

T = TypeVar("T")
VERSION = 1
_START = b'{"version":%d,' % VERSION
"""The first bytes of each line."""


def to_line(record: FrameRecord) -> str:
    """Encode one frame as a line of ``results.jsonl``, with its newline.

    Raises
    ------
    ValueError
        If reading the line would not give the same record: a number is not finite, or a value is of another type.
    """
    line = _START + _ENCODER.encode(record)[1:]
    if _RECORDS.decode(line) != record:
        raise ValueError(f"frame {record.frame} of {record.clip}: a value would not survive the file: {record}")
    return line.decode() + "\n"


def read_results(path: Path) -> Iterator[FrameRecord]:
    """Read a ``results.jsonl``, one record at a time in the order of the file. Nothing is skipped or repaired.

    Raises
    ------
    VfoaError
        If the file is missing, a line has another version or is no record of a frame, the last line is cut, or a
        frame occurs twice; the message names the file and the line.
    """
    for block in find_blocks(path):
        yield from read_block(path, block)


def _decoded(decoder: msgspec.json.Decoder[T], line: bytes, path: Path, number: int) -> T:
    if not line.endswith(b"\n"):
        raise VfoaError(f"{path}:{number}: cut short: expected a newline at its end")
    if not line.startswith(_START):
        raise VfoaError(f"{path}:{number}: expected a record that begins with {_START!r}, found {line[:20]!r}")
    try:
        return decoder.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise VfoaError(f"{path}:{number}: not a frame's record: {error}") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Consecutive lines of a ``results.jsonl``, of one configuration on one clip: their bytes, and their frames.

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
"""Most frames of a block."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    clip: str
    configuration: str
    frame: int


def find_blocks(path: Path) -> list[Block]:
    """Divide a ``results.jsonl`` into blocks. Of each record only the clip, configuration and frame are read.

    Raises
    ------
    VfoaError
        For the errors of :func:`read_results` that show in these values; :func:`read_block` finds the rest.
    """
    seen: dict[tuple[str, str, int], int] = {}
    cut: list[Block] = []
    frames: list[int] = []
    first, start, end = 1, 0, 0
    pair: tuple[str, str] | None = None
    with opened(path) as file:
        for number, line in enumerate(file, start=1):
            place = _decoded(_PLACES, line, path, number)
            if (earlier := seen.setdefault((place.clip, place.configuration, place.frame), number)) != number:
                raise VfoaError(
                    f"{path}:{number}: frame {place.frame} of clip {place.clip!r} under {place.configuration!r} is "
                    f"on line {earlier} already"
                )
            if pair is not None and ((place.clip, place.configuration) != pair or len(frames) == BLOCK_FRAMES):
                cut.append(_block(path, pair, first, start, end, frames))
                frames, first, start = [], number, end
            pair = place.clip, place.configuration
            frames.append(place.frame)
            end += len(line)
    return [*cut, _block(path, pair, first, start, end, frames)] if pair else cut


def read_block(path: Path, block: Block) -> Iterator[FrameRecord]:
    """Read the records of a block. Raises the errors of :func:`read_results`."""
    lines = block_bytes(path, block).splitlines(keepends=True)
    return (_decoded(_RECORDS, line, path, number) for number, line in enumerate(lines, start=block.line))


def block_bytes(path: Path, block: Block) -> bytes:
    """Read the lines of a block; fewer if the file has become shorter."""
    with opened(path) as file:
        file.seek(block.start)
        return file.read(block.end - block.start)


def lines_digest(lines: bytes) -> str:
    """The digest of a block's lines."""
    return hashlib.blake2b(lines, digest_size=16).hexdigest()


def _block(path: Path, pair: tuple[str, str], first: int, start: int, end: int, frames: list[int]) -> Block:
    block = Block(
        clip=pair[0], configuration=pair[1], line=first, start=start, end=end, frames=tuple(frames), digest=""
    )
    return replace(block, digest=lines_digest(block_bytes(path, block)))


def _plain(value: object) -> int | float:
    """Convert a NumPy number to a Python number; the encoder knows no other."""
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    raise TypeError(f"expected plain numbers, text and tuples in a record, found {type(value).__name__}")


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)
_RECORDS, _PLACES = msgspec.json.Decoder(FrameRecord), msgspec.json.Decoder(_Place)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipRecords:
    """The configuration's name, its records by frame number, and the records of all configurations.

    Attention values are probabilities with ``has_probabilities``. Without ``says_nowhere``, no focus is no answer.
    """

    configuration: str
    by_frame: dict[int, FrameRecord]
    all: list[FrameRecord]
    has_probabilities: bool
    says_nowhere: bool


class Answers(NamedTuple):
    """What the answers of a method are: probabilities, and whether no focus is the answer "looks at nothing"."""

    probabilistic: bool
    says_nowhere: bool


def answers_of(manifest: Mapping[str, Any], configuration: str, path: Path) -> Answers:
    """Return what the answers of a configuration are, by its run's manifest, a file at ``path``.

    Raises
    ------
    VfoaError
        If the manifest does not say it: an earlier version of this program wrote it.
    """
    of_method = manifest.get("methods", {}).get(configuration)
    if of_method is not None:
        return Answers(of_method["probabilistic"], of_method["says_nowhere"])
    if "method" in manifest.get("configurations", {}).get(configuration, {}).get("attention", {}):
        raise VfoaError(
            f"{path}: methods.{configuration}: missing, as in runs of earlier versions; run the experiment again"
        )
    return Answers(probabilistic=False, says_nowhere=False)


def has_images(configurations: Collection[Mapping[str, Any]]) -> bool:
    """Whether a run has images, by its manifest: the stages of perception are off (null) for a clip of measurements."""
    return not configurations or any(configuration.get("stereo", True) for configuration in configurations)


def read_clip_records(run: Path, clip: ClipManifest | str, configuration: str | None) -> ClipRecords:
    """Read the records from a run's directory; ``configuration`` may be None if the run has only one for the clip.

    With the clip's manifest, renamed targets have their present names.

    Raises
    ------
    VfoaError
        If the run has no such clip or configuration, or several configurations and none was chosen.
    """
    directory = RunDirectory(run)
    manifest: Mapping[str, Any] = directory.read_manifest() if directory.manifest.is_file() else {}
    name, names_now = clip, dict[str, str]()
    if isinstance(clip, ClipManifest):
        clips = manifest.get("clips", [])
        then: dict[str, Any] = next((entry.get("names", {}) for entry in clips if entry["name"] == clip.name), {})
        name, names_now = clip.name, clip.names_now(then.get("targets", {}))
    records = [renamed(frame, names_now) for frame in read_results(directory.results) if frame.clip == name]
    if not records:
        raise VfoaError(f"{run}: the run has no frames of clip {name!r}")
    names = list(dict.fromkeys(record.configuration for record in records))
    chosen = _choose(names, configuration, run)
    by_frame = {record.frame: record for record in records if record.configuration == chosen}
    answers = answers_of(manifest, chosen, directory.manifest)
    return ClipRecords(
        configuration=chosen,
        by_frame=by_frame,
        all=records,
        has_probabilities=answers.probabilistic,
        says_nowhere=answers.says_nowhere,
    )


def _choose(names: list[str], wanted: str | None, run: Path) -> str:
    if wanted is None and len(names) == 1:
        return names[0]
    if wanted is None:
        raise VfoaError(f"{run}: has several configurations; choose one with --config: {', '.join(names)}")
    check_known(wanted, names, f"{run}: no configuration")
    return wanted


@dataclass(slots=True)
class MeasuredPart:
    """The measures of a configuration's frames on a clip, and the run's names of the true objects in them."""

    frames: list[FrameMeasures] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)

    def take(self, record: FrameRecord) -> None:
        """Add a record's measures, and the names of the instances that were matched with true objects."""
        if record.measures is None:
            return
        self.frames.append(record.measures)
        names = {target.instance_id: target.name for target in record.targets}
        for target in record.measures.targets:
            if target.instance_id in names:
                self.names.setdefault(target.truth_id, names[target.instance_id])


def pooled_measures(parts: Mapping[Pair, MeasuredPart]) -> dict[tuple[str | None, str], list[FrameMeasures]]:
    """The measures of each (clip, configuration) and, of several clips, of all together under the clip None.

    The seeds of a configuration are taken together, here and below.
    """
    pooled: dict[tuple[str | None, str], list[FrameMeasures]] = {}
    for (clip, configuration), part in parts.items():
        if part.frames:
            pooled.setdefault((clip, base_of(configuration)), []).extend(part.frames)
    if len({clip for clip, _ in pooled}) > 1:
        for (_, name), frames in list(pooled.items()):
            pooled.setdefault((None, name), []).extend(frames)
    return pooled


def measures_by_thing(parts: Mapping[Pair, MeasuredPart]) -> dict[tuple[str, str, str], list[TargetMeasure]]:
    """The measures of each (clip, true object, configuration), the object by the run's own name for it."""
    names: dict[tuple[str, int], str] = {}
    for (clip, _), part in parts.items():
        for number, name in part.names.items():
            names.setdefault((clip, number), name)
    by_thing: dict[tuple[str, str, str], list[TargetMeasure]] = {}
    for (clip, configuration), part in parts.items():
        by_id: dict[int, list[TargetMeasure]] = {}
        for target in (target for frame in part.frames for target in frame.targets):
            by_id.setdefault(target.truth_id, []).append(target)
        for number, measures in by_id.items():
            name = names.get((clip, number), f"{measures[0].label}#{number}")
            by_thing.setdefault((clip, name, base_of(configuration)), []).extend(measures)
    return dict(sorted(by_thing.items(), key=lambda item: item[0][:2]))
