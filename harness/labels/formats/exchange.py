"""Mapping of another program's labels to ours: names, frame numbers, times, gaps."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from harness.files.safe_names import composed
from harness.labels.drawn_shapes import Drawn
from harness.labels.labels import (
    IGNORED,
    RESERVED,
    UNLABELLED,
    Label,
    LabelRange,
    Labels,
    Timeline,
    fill_gaps,
    format_seconds,
)
from harness.labels.rows import expected_name
from harness.sources.media.frame_files import count_from_1, counts_from_0, number_names
from vfoa.errors import VfoaError, check_known, counted, did_you_mean

MS = 1_000_000
"""A millisecond in ns."""

_SHOWN = 8
SAME_RATE = 0.05
"""Most by which two rates of the same frames differ, as a share."""
_SEEN = 0.5
"""Frames by which labels must be off to be seen."""
_LARGEST = 1e10
"""Largest offset and rate, seconds or frames per second: seconds since 1970 are below it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """Labels that were read, and a note for everything in the file that they do not hold.

    ``drawn`` are the shapes of a file that has some, drawn on images of the (width, height) ``size_px`` where the file
    says it.
    """

    labels: Labels
    notes: tuple[str, ...] = ()
    drawn: Drawn = field(default_factory=Drawn)
    size_px: tuple[int, int] | None = None


class ReadOnly:
    """A format that cannot be written."""

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Raise :class:`VfoaError`."""
        raise VfoaError(f"{path}: this format cannot be written; expected another --format")


@dataclass(slots=True, kw_only=True)
class NameLog:
    """Translates names by ``renamed`` (theirs -> ours) and records those that it could not translate.

    ``SUBJECT:NAME`` renames the targets called ``NAME`` of one subject, whose name is ours or theirs. The labels of a
    name without one of ours ("") are left out.
    """

    renamed: Mapping[str, str]
    former: Mapping[str, str] = field(default_factory=dict)
    _seen: set[str] = field(default_factory=set)
    _unknown: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)
    """By kind and name: the first place, and the suggestion."""
    _left_out: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self.renamed = {composed(theirs): composed(ours) for theirs, ours in self.renamed.items()}

    def translate(self, name: str, subject: str | None = None) -> str:
        """Our name for theirs, of a target of ``subject`` (ours) if one is given; unchanged without a rename."""
        name = composed(name)
        self._seen.add(name)
        if subject is not None:
            theirs = (their_name for their_name, ours in self.renamed.items() if ours == subject)
            for key in (f"{spelling}:{name}" for spelling in (subject, *theirs)):
                if key in self.renamed:
                    self._seen.add(key)
                    return self.renamed[key]
        return self.renamed.get(name, name)

    def leaves_out(self, subject: str | None, target: str, *, is_ours: bool = False) -> bool:
        """Whether a label of their names is left out, which is counted; subject None: its name is not in the file.

        ``is_ours``: the subject's name is ours already.
        """
        ours = subject if is_ours or subject is None else self.translate(subject)
        names = [subject] if subject is not None and ours == "" else []
        names += [target] if target and not self.translate(target, ours) else []
        self._left_out.update(names[:1])
        return bool(names)

    def expect(self, name: str, known: Collection[str], kind: str, where: str, subject: str | None = None) -> str:
        """Our name for theirs. An unknown one is recorded; :meth:`check` reports all of them at once."""
        ours = self.translate(name, subject)
        if ours.endswith(f":{composed(name)}"):  # of a tier that is called as its target: --rename mug=anna:mug
            ours = composed(name)
        if ours not in known:
            former = self.former if kind == "target" else {}
            self._unknown.setdefault((kind, name), (where, f"{ours!r}; {expected_name(ours, known, former)}"))
        return ours

    def check(self, path: object) -> tuple[str, ...]:
        """Reject unknown names; return notes on labels that are left out, and on renames that the file does not have.

        Raises
        ------
        VfoaError
            One line that lists the unknown names, and where the first one is.
        """
        if self._unknown:
            where, _ = next(iter(self._unknown.values()))
            listed = " | ".join(f"{kind} {problem}" for (kind, _), (_, problem) in [*self._unknown.items()][:_SHOWN])
            raise VfoaError(f"{where}: unknown {listed} (--rename THEIRS=OURS, or THEIRS= to leave their labels out)")
        left_out = (
            f"{path}: left out: {counted(n, 'label')} of {name!r} (--rename)." for name, n in self._left_out.items()
        )
        unseen = (
            f"{path}: --rename {name}: no such name in it; {did_you_mean(name, self._seen)}"
            for name in self.renamed
            if name not in self._seen
        )
        return (*left_out, *unseen)


@dataclass(frozen=True, kw_only=True)
class Exchange:
    """The mapping between the other program's names, frames and times and ours.

    Parameters
    ----------
    timeline, rate_hz
        The clip's frames and times; None: the frame rate is not known.
    subjects, targets
        The manifest's names.
    former
        The present names of renamed targets by earlier name, for messages.
    has_images
        Whether the other program can show the clip's frames. A film of a clip without images is another camera's.
    fps
        The rate at which the other program shows the clip's frames, or of the frames of another camera's film; None: at
        the clip's own times.
    offset
        Time of the clip's first frame in the other program, seconds; None: as the file and the film say.
    films
        The names of the films from which the clip is read, the left view first, each with the time at which a player
        shows the clip's first frame, seconds. Frames have the numbers of their pictures, from 0.
    renamed
        The other program's name -> ours, or "" to leave its labels out; ``SUBJECT:NAME`` -> ours for targets of one
        subject.
    gaps
        Meaning of frames without a label between two labels of a subject.
    until_next
        Whether a row of a table has a beginning alone, and holds until the next one of its subject.
    film
        In ELAN, BORIS, Datavyu, Label Studio and VIA: the film that shows the clip, if a file has several.
    observation
        In BORIS and The Observer XT: the observation to read, if a file has several. In Pupil Cloud: the id or name of
        the recording, in a table what its column has. In Label Studio: the id of the annotation.
    modifier
        What names the targets. In BORIS and The Observer XT: the set of modifiers, "none" for behaviours with
        modifiers that do not count. In Datavyu: the code, of columns with several. In CVAT and VIA: the attribute.
    """

    timeline: Timeline
    rate_hz: float | None
    subjects: Collection[str]
    targets: Collection[str]
    former: Mapping[str, str] = field(default_factory=dict)
    has_images: bool = True
    fps: float | None = None
    offset: float | None = None
    films: Mapping[str, float] = field(default_factory=dict)
    renamed: Mapping[str, str] = field(default_factory=dict)
    gaps: Literal["ignore", "none"] = "ignore"
    until_next: bool = False
    film: str | None = None
    observation: str | None = None
    modifier: str | None = None

    def __post_init__(self) -> None:
        for option, value in (("--fps", self.fps), ("--offset", self.offset)):
            if value is not None and not abs(value) <= _LARGEST:
                raise VfoaError(f"{option}: found {value:g}; expected a number within {_LARGEST:g}")

    @cached_property
    def names(self) -> NameLog:
        """The names found while a file is read."""
        return NameLog(renamed=self.renamed, former=self.former)

    @cached_property
    def frames(self) -> Sequence[int]:
        """The clip's frame numbers, by position; position 0 is its first frame."""
        return tuple(self.timeline.frames)

    @cached_property
    def places(self) -> Sequence[int]:
        """How many pictures after the clip's first frame each frame is shown: those of films may be left out."""
        return [number - self.frames[0] for number in self.frames] if self.films else range(len(self.frames))

    @cached_property
    def shown(self) -> Timeline:
        """The clip's frames at their times in the other program, to the millisecond of its formats.

        Raises
        ------
        VfoaError
            If neither the clip nor ``fps`` gives the frame rate, or, as in a run by an earlier version, the times.
        """
        own = self.timeline.times_ns
        begin_s = next(iter(self.films.values()), 0.0) if self.offset is None else self.offset
        if self.fps is not None and self.has_images:
            times_ns = [round(place * 1e9 / self.fps) for place in self.places]
        elif own and (self.fps or self.rate_hz):
            times_ns = [time - own[0] for time in own]
        else:
            unknown = "clip's frame rate is" if own else "times of the clip's frames are"
            raise VfoaError(f"--fps: missing; expected it, since the {unknown} not known and this format holds times")
        begin_ns = round(Decimal(str(begin_s)) * 10**9)  # a float of ns since 1970 is off by up to 128 ns
        times_ns = [time + begin_ns for time in times_ns]
        return in_ms(replace(self.timeline, frames=self.frames, times_ns=times_ns))

    def frames_of_images(self, names: Iterable[str], where: str) -> tuple[dict[str, int], list[str]]:
        """The frame of each image by its name, whether or not the clip has it, and a note on what is not certain.

        With :attr:`fps` it is the number in the name.

        Raises
        ------
        VfoaError
            If ``fps`` is not the clip's rate: pictures at another rate are not its frames; and as
            :func:`harness.sources.media.frame_files.number_names`.
        """
        if self.fps and self.rate_hz and abs(self.fps / self.rate_hz - 1) > SAME_RATE:
            raise VfoaError(
                f"{where}: --fps {self.fps:g}: found images, whose numbers are those of the clip's frames, and a clip "
                f"of {self.rate_hz:.4g} frames per second; expected the times (time_s) of pictures at another rate"
            )
        numbers, known = number_names(names, where), self.frames if self.fps is None else ()
        is_from_1 = count_from_1(numbers, known)
        frames = {name: number - is_from_1 for number, name in numbers.items()}
        if is_from_1 or 0 in numbers or not (numbers and self.films and counts_from_0(known)):
            return frames, []
        first = min(numbers)
        note = f"{where}: {numbers[first]} is read as frame {first} of the film, whose first one is 0"
        return frames, [f"{note}; ffmpeg calls its first picture 1, and counts those that it writes (-r, fps=)."]

    def film_of(
        self,
        names: Sequence[str],
        where: object,
        *,
        has_own_times: bool = False,
        begin: Callable[[str], object] = lambda name: None,
    ) -> str | None:
        """The film of a document that shows the clip, out of their paths or addresses; None if it has no film.

        ``has_own_times``: each film has times of its own, so that an ``offset`` does not choose between them. ``begin``
        is when a film begins in the times of all.

        Raises
        ------
        VfoaError
            If there are several, and neither their names nor ``film`` tell, or those of one name begin at other times;
            or if when the clip begins in it is not known: it is no film of the clip's, which begins within its own.
        """
        film = self._chosen_film(names, where, has_own_times)
        alike = [name for name in names if film is not None and file_name(name) == file_name(film)]
        if self.offset is None and len({*map(begin, alike)}) > 1:
            raise VfoaError(
                f"{where}: found films of one name that begin at different times, {', '.join(alike)}; expected "
                "--offset SECONDS, where the clip begins"
            )
        own, begin_s = next(iter(self.films.items()), ("", 0.0))
        if film is None or self.offset is not None or abs(begin_s) * (self.rate_hz or 0) < _SEEN:
            return film
        if any(file_name(film).endswith(composed(name)) for name in self.films):
            return film
        raise VfoaError(
            f"{where}: found the film {file_name(film)}; expected {own}, in which the clip begins at {begin_s:g} s, or "
            f"--offset SECONDS: 0 of a film by `vfoa clips export`, {begin_s:g} of a copy of {own}"
        )

    def _chosen_film(self, names: Sequence[str], where: object, has_own_times: bool) -> str | None:
        if self.film is not None:
            check_known(composed(self.film), [file_name(name) for name in names], f"{where}: --film: no")
            return next(name for name in names if file_name(name) == composed(self.film))
        if (self.offset is not None and not has_own_times) or len(names) < 2:
            return next(iter(names), None)
        own = (name for film in self.films for name in names if file_name(name) == composed(film))
        if (film := next(own, None)) is None:
            listed = ", ".join(dict.fromkeys(map(file_name, names)))
            raise VfoaError(f"{where}: found the films {listed}; expected --film NAME, the one that shows the clip")
        return film

    def media_offset(self, offset_ms: int, path: object) -> tuple[int, list[str]]:
        """The milliseconds to add to the times of a file to get times of the clip's film, with a note.

        Nothing beside a given ``offset``, which says where the clip begins in the file's own times.
        """
        offset_s = format_seconds(offset_ms * MS)
        if offset_ms and self.offset is not None:
            return 0, [f"{path}: the offset of {offset_s} s in it is not used: --offset says where the clip begins."]
        return offset_ms, [f"{path}: an offset of {offset_s} s is added to its times."] if offset_ms else []

    def positions(self, row: LabelRange) -> range:
        """The positions of a range's frames in the clip."""
        return range(bisect_left(self.frames, row.first_frame), bisect_right(self.frames, row.last_frame))

    def subject(self, name: str, where: str) -> str:
        """Our name of a subject; :meth:`labels` raises for all unknown names, each with its first ``where``."""
        return self.names.expect(name, self.subjects, "subject", where)

    def target(self, name: str, subject: str, where: str) -> str:
        """Our name of a subject's target, as :meth:`subject`; :class:`VfoaError` if it is the subject itself."""
        ours = self.names.expect(name, self._known_targets, "target", where, subject)
        if ours == subject:
            raise VfoaError(f"{where}: {subject!r} looks at {subject!r}; expected another target, or none")
        return ours

    def names_of_row(self, subject: str, target: str) -> tuple[str, str] | None:
        """Our names for those of a label, known or not; None if it is left out."""
        if self.names.leaves_out(subject, target):
            return None
        ours = self.names.translate(subject)
        return ours, self.names.translate(target, ours)

    def looks_of(self, *spellings: str) -> tuple[str, str] | None:
        """Subject and target of looks with a name of their own, ``SUBJECT:TARGET`` by ours; None of any other name.

        Of the spellings, the first one counts that the user renames; else the last one, if the clip has the target:
        people call a tier ``girl:speech``, too.
        """
        renamed = [ours for theirs in spellings if (ours := self.names.translate(theirs)) != composed(theirs)]
        subject, _, target = (*renamed, composed(spellings[-1]))[0].partition(":")
        if not target or subject not in self.subjects:
            return None
        is_known = self.names.translate(target, subject) in self._known_targets
        return (subject, target) if renamed or is_known else None

    @property
    def _known_targets(self) -> set[str]:
        return {*self.targets, *self.subjects, *RESERVED}

    def labels(self, rows: Iterable[LabelRange], path: object) -> Imported:
        """Return labels with filled gaps, with notes: the number of filled frames, renames that matched nothing.

        Raises
        ------
        VfoaError
            For unknown names.
        """
        rows = list(rows)  # they may be read from the file only now, with their names
        notes, labels = list(self.names.check(path)), Labels(rows)
        filled = fill_gaps(
            labels, self.frames, Label(target=self.gaps, note=UNLABELLED if self.gaps == IGNORED else "")
        )
        for subject in labels.subjects:
            added = {*filled.of(subject)} - {*labels.of(subject)}
            if frames := sum(len(self.positions(row)) for row in added):
                notes.append(
                    f"{path}: {subject}: {counted(frames, 'frame')} without a label, between "
                    f"labels: {self.gaps!r} (--gaps)."
                )
        return Imported(labels=filled, notes=tuple(notes))


def in_ms(timeline: Timeline) -> Timeline:
    """The frames at their times to the millisecond, rounded by :func:`rounded_ms` as the ends of spans are."""
    return replace(timeline, times_ns=[rounded_ms(time_ns) * MS for time_ns in timeline.times_ns])


def rounded_ms(time_ns: int) -> int:
    """The nearest millisecond; of two, the later one."""
    return (time_ns + MS // 2) // MS


def file_name(address: str) -> str:
    """The name of the file at a path, also of another system, or at an address such as ``file:///C:/a%20b.mp4``."""
    return composed(re.split(r"[/\\]", unquote(address))[-1])


def one_line(text: str | None) -> str:
    """Text for a note: each run of white space and line breaks becomes one space."""
    return " ".join((text or "").split())
