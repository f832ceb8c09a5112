"""Annotation files: which a clip has, and who looks at what in them, read strictly and written canonically.

    # vfoa annotations 1
    first_frame,last_frame,subject,target,note[,u_px,v_px][,tag][,state]

``annotations/<clip>.csv`` is scored, ``<clip>@<annotator>.csv`` is an annotator's, and ``<clip>.drawn.csv`` is what is
drawn on the clip's images. Ranges of frames are inclusive, in the source's own numbers; with ``start_s,end_s`` in their
place a row holds for the frames whose time lies in [start, end). ``annotations/README.md`` tells it to those who label.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.files.digests import digest_files
from harness.files.folders import came_with_program, folders
from harness.files.io import atomic_write, is_file_or_link
from harness.files.remote import expand
from harness.files.tables import csv_rows, format_rows
from harness.labels.labels import Labels, Timeline, format_seconds
from harness.labels.rows import (
    FRAME_COLUMNS,
    POINT_COLUMNS,
    STATE_COLUMN,
    SUGGESTED,
    TAG_COLUMN,
    TIME_COLUMNS,
    WORD_COLUMNS,
    RowReader,
    Translation,
    as_they_are,
    check_sequence,
    check_text,
)
from vfoa.errors import VfoaError, did_you_mean

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")

VERSION_LINE = "# vfoa annotations 1"
_IMPORT = "; a table of your own: move it elsewhere, then vfoa labels import TABLE --clip CLIP --format table"


def read_annotations(
    path: Path,
    *,
    timeline: Timeline | None,
    subjects: Iterable[str],
    targets: Iterable[str],
    former: Mapping[str, str] | None = None,
    allow_gaps: bool = False,
    translate: Translation = as_they_are,
) -> Labels:
    """Read a clip's annotations.

    Parameters
    ----------
    path
        The file. What spreadsheet programs make of it is accepted (:func:`harness.files.tables.csv_rows`), a byte-order
        mark and CRLF line ends; blank lines are skipped.
    timeline
        The clip's frames and times; None if the clip cannot be opened: then frame numbers are not checked, and a
        file whose ranges are times cannot be read.
    subjects, targets
        The manifest's names. Subjects can be targets of others.
    former
        The present names of renamed targets by earlier name, for messages.
    allow_gaps
        Accept unfinished labelling: frames without a label between two labels of a subject.
    translate
        Gives the manifest's names of a row's subject and target; None leaves the row out.

    Raises
    ------
    VfoaError
        For the first error, with file and line: another version or header, a wrong number, an unknown name, a
        frame outside the clip, a range that ends before it begins or holds no frame, an overlap, or a gap between
        the first and the last label of a subject.
    """
    lines = csv_rows(path, VERSION_LINE, _IMPORT)
    line, header = next(lines, (2, None))
    if header is None:
        raise VfoaError(f"{path}:2: no header; expected {','.join(FRAME_COLUMNS + WORD_COLUMNS)}")
    _check_header(header, f"{path}:{line}")
    reader = RowReader(header, timeline, set(subjects), targets, former or {}, translate)
    if reader.in_time and not (timeline and timeline.times_ns):
        raise VfoaError(f"{path}:{line}: ranges of time need the clip's frame times, which are not known")
    places = ((f"{path}:{line}", cells) for line, cells in lines)
    rows = [(where, row) for where, cells in places if (row := reader.read(cells, where)) is not None]
    check_sequence(rows, timeline, allow_gaps=allow_gaps)
    return Labels(row for _, row in rows)


def target_names(path: Path) -> tuple[str, ...]:
    """Every name in the column of targets, whether or not the manifest has it; none for a damaged file."""
    try:
        header, *rows = [cells for _, cells in csv_rows(path, VERSION_LINE)]
        place = header.index("target")
        return tuple(dict.fromkeys(cells[place] for cells in rows))
    except (VfoaError, ValueError, IndexError):
        return ()


def write_annotations(path: Path, labels: Labels) -> None:
    """Write a clip's annotations atomically, in the form of :func:`format_annotations`. Raises as it does."""
    atomic_write(path, format_annotations(labels, str(path)))


def format_annotations(labels: Labels, where: str = "annotations") -> str:
    """Return the text of an annotation file.

    The form is canonical: rows by first frame and subject, LF; times if every range was given by time; the columns for
    points, tags and states only if a label has one. Reading and writing such a file again gives the same bytes.

    Raises
    ------
    VfoaError
        If a name or note holds a line break or another control character; ``where`` starts the message.
    """
    in_time = bool(labels.ranges) and all(row.span_ns is not None for row in labels.ranges)
    columns, rows = (*(TIME_COLUMNS if in_time else FRAME_COLUMNS), *WORD_COLUMNS, *_OPTIONAL), list[list[object]]()
    for row in labels.ranges:
        words = row.subject, row.label.target, row.label.note
        check_text(words, where)
        ends = map(format_seconds, row.span_ns or ()) if in_time else (row.first_frame, row.last_frame)
        point = map(_number, row.label.point_px) if row.label.point_px else ("", "")
        rows.append([*ends, *words, *point, " ".join(row.label.tags), SUGGESTED if row.label.is_suggested else ""])
    given = [place for place, name in enumerate(columns) if name not in _OPTIONAL or any(row[place] for row in rows)]
    table = format_rows([columns[place] for place in given], [[row[place] for place in given] for row in rows])
    return f"{VERSION_LINE}\n{table}"


_OPTIONAL = (*POINT_COLUMNS, TAG_COLUMN, STATE_COLUMN)


def _check_header(header: list[str], where: str) -> None:
    ends = TIME_COLUMNS if TIME_COLUMNS[0] in header else FRAME_COLUMNS
    further = [name for name in _OPTIONAL if name in header]
    if header != [*ends, *WORD_COLUMNS, *further] or len({*POINT_COLUMNS} & {*further}) == 1:
        raise VfoaError(
            f"{where}: header {','.join(header)[:120]!r}; expected {','.join(FRAME_COLUMNS + WORD_COLUMNS)} "
            f"(or {','.join(TIME_COLUMNS)} for the frames; then any of {','.join(POINT_COLUMNS)}, {TAG_COLUMN}, "
            f"{STATE_COLUMN}, in this order)"
        )


def _number(value: float) -> str:
    return repr(float(value)).removesuffix(".0")


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnotationFiles:
    """The annotation files of one clip. An annotator of None means ``<clip>.csv``.

    They are searched in ``annotations`` beside the manifest's folder, then in that of the working directory, if no
    other clip has this name there. Labels that came with the program belong only to clips that did, never to another
    clip of the same name. ``with_clip`` are the clip's root and the path of labels below it, as configured, which are
    searched last. Files beside a manifest's folder that another manifest of the same name would share are refused, when
    they are found and when they are written; those of a manifest in a folder ``datasets`` are not.
    """

    clip: str
    manifest: Path
    with_clip: tuple[str, str] | None = None

    def find(self, annotator: str | None = None) -> Path | None:
        """Return an annotator's file; None if there is none.

        Raises
        ------
        VfoaError
            If the labels among the clip's files are not there, or their path needs a variable that is not set.
        """
        path = self._find(f"{self._stem(annotator)}.csv")
        if path is not None or annotator is not None or self.with_clip is None:
            return path
        root, below = self.with_clip
        path = expand(f"{root}/{below}", self.manifest.parent, f"{self.manifest}: root")
        if is_file_or_link(path):
            return path
        if expand(root, self.manifest.parent, f"{self.manifest}: root").exists():
            raise VfoaError(
                f"{self.manifest}: labels_file: {path}: no such file; expected labels there, {self.place()}, or no "
                "labels_file"
            )
        return None  # the clip is not here at all

    def digest(self, annotator: str | None = None) -> str | None:
        """Return the sha256 of an annotator's file; None if there is none. Raises as :meth:`find` does."""
        path = self.find(annotator)
        return digest_files([("labels", path)]) if path else None

    def find_drawn(self) -> Path | None:
        """Return the file of drawn shapes, the same for all annotators; None if there is none."""
        return self._find(f"{self.clip}.drawn.csv")

    def place_drawn(self) -> Path:
        """The path for writing drawn shapes: in the folder of :meth:`place`."""
        return self.place().with_name(f"{self.clip}.drawn.csv")

    def _find(self, name: str) -> Path | None:
        found = next((folder / name for folder in self._folders if is_file_or_link(folder / name)), None)
        if found is not None and found.parent == self._beside:
            self._check_namesakes()
        return found

    def expect(self, annotator: str | None) -> Path:
        """Return an annotator's file.

        Raises
        ------
        VfoaError
            If there is none; the message suggests the nearest name.
        """
        if path := self.find(annotator):
            return path
        if annotator is None:
            raise VfoaError(f"{self.clip}: no annotations; expected {self.place()}")
        known = self.annotators()
        hint = did_you_mean(annotator, known) if known else f"expected one of {self.clip}@ANNOTATOR.csv, found none"
        raise VfoaError(f"{self.clip}: no annotations by {annotator!r} ({self._stem(annotator)}.csv); {hint}")

    def place(self, annotator: str | None = None) -> Path:
        """The path for writing an annotator's labels.

        It is beside the manifest, or in the working directory for a clip that came with the program; never the file of
        another clip of this name.
        """
        self._check_namesakes()
        return self._beside / f"{self._stem(annotator)}.csv"

    def present(self) -> tuple[Path, ...]:
        """Every file of the clip: labels of all annotators, and drawn shapes."""
        labels = (self._find(f"{self._stem(annotator)}.csv") for annotator in (None, *self.annotators()))
        return tuple(path for path in (*labels, self.find_drawn()) if path is not None)

    def annotators(self) -> tuple[str, ...]:
        """Everyone who has a file for this clip, sorted; ``<clip>.csv`` is not counted.

        Raises
        ------
        VfoaError
            If the name of a file has another one than :meth:`place` takes.
        """
        paths = [path for folder in self._folders for path in folder.glob(f"{self.clip}@*.csv")]
        for path in paths:
            _check_annotator(path.stem.partition("@")[2], str(path))
        return tuple(sorted({path.stem.partition("@")[2] for path in paths}))

    @property
    def _beside(self) -> Path:
        if came_with_program(self.manifest):  # the working directory's own labels of such a clip come first
            return Path.cwd() / "annotations"
        return self.manifest.resolve().parent.parent / "annotations"

    def _check_namesakes(self) -> None:
        """Raise a :class:`VfoaError` if the clip's files beside its manifest would be those of another clip, too."""
        manifest = self.manifest.resolve()
        if manifest.parent.name == "datasets" or came_with_program(self.manifest):
            return
        namesakes = manifest.parent.parent.glob(f"*/{manifest.name}")
        if other := next((path for path in namesakes if path.resolve() != manifest), None):
            raise VfoaError(
                f"{self.manifest}: its labels would be in {self._beside / self.clip}.csv, as those of {other}; "
                "expected a name of its own for each: rename one of the two, in the file, too"
            )

    @property
    def _folders(self) -> list[Path]:
        """The folders that are searched, in order."""
        own, *of_program = folders("annotations")
        if came_with_program(self.manifest):
            return [own, *of_program]
        namesake = own.with_name("datasets") / f"{self.clip}.toml"
        is_other = namesake.is_file() and not namesake.samefile(self.manifest)
        return [self._beside, *([] if is_other else [own])]

    def _stem(self, annotator: str | None) -> str:
        if annotator is None:
            return self.clip
        _check_annotator(annotator, "annotator")
        return f"{self.clip}@{annotator}"


def _check_annotator(name: str, where: str) -> None:
    if not _NAME.fullmatch(name):
        raise VfoaError(f"{where}: found the annotator {name!r}; expected a name of letters, digits and . _ - only")
