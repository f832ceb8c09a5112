"""VideoAttentionTarget (Chong et al., CVPR 2020): a text file per person in a folder, a line per frame.

00000012.jpg,xmin,ymin,xmax,ymax,gazex,gazey        pixels; -1,-1: looks out of the image

A file is named after its person (``s00.txt``), an image after its frame's number in the source. As in the authors'
loader (github.com/ejcgt/attention-target-detection, ``dataset.py``; read, not used), a point with one negative
coordinate was placed beside the image by mistake, and is moved to its edge.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from harness.files.io import write_together
from harness.labels.bodies import Point
from harness.labels.formats.exchange import Exchange, Imported, left_out
from harness.labels.formats.gaze_points import GazePoint, from_points, point_of, to_points
from harness.labels.formats.tables import csv_rows
from harness.labels.labels import IGNORED, Labels
from vfoa.errors import VfoaError

_NUMBER = re.compile(r"(\d+)\D*$")
_OUTSIDE = (-1.0, -1.0)


class VideoAttentionTarget:
    """Reads one person's file, or all ``.txt`` of a folder; writes a folder. A frame without a line is not judged."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read points and name the objects at them."""
        files = sorted(path.glob("*.txt")) if path.is_dir() else [path]
        if not files:
            raise VfoaError(f"{path}: no .txt in this folder; expected one for each person")
        return from_points((each for file in files for each in _lines(file, exchange)), exchange, path)

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write a folder; names and ignored frames are lost."""
        shown, said = to_points(labels, exchange)
        ignored = sum(each.label.target == IGNORED for each in shown)
        files: dict[Path, str | bytes] = {}
        for subject, lines in groupby(shown, key=lambda each: each.subject):
            text = io.StringIO()
            writer = csv.writer(text, lineterminator="\n")
            for each in lines:
                if each.label.target != IGNORED:
                    numbers = (*each.head_px, *(each.point_px or _OUTSIDE))
                    image = f"{each.frame + exchange.first_number:08d}.jpg"
                    writer.writerow([image, *(f"{value:.2f}".removesuffix(".00") for value in numbers)])
            files[path / f"{subject}.txt"] = text.getvalue()
        write_together(files)
        said.append("Names of targets are left out: VideoAttentionTarget holds points.")
        if ignored:
            said.append(f"{ignored} ignored frames have no line: VideoAttentionTarget has no place for them.")
        return (*said, *left_out(labels, "VideoAttentionTarget", points=True))


def _lines(path: Path, exchange: Exchange) -> Iterator[GazePoint]:
    subject = exchange.subject(path.stem, str(path))
    for line, cells in csv_rows(path):
        where, name = f"{path}:{line}", _NUMBER.search(Path(cells[0]).stem)
        if len(cells) != 7 or name is None:
            raise VfoaError(f"{where}: found {','.join(cells)[:80]!r}; expected IMAGE_NUMBER.jpg and six numbers")
        point = point_of(cells[5:], where)
        frame, seen = int(name[1]) - exchange.first_number, None if point == _OUTSIDE else _within(point, exchange)
        yield GazePoint(frame=frame, subject=subject, point_px=seen, where=where)


def _within(point: Point, exchange: Exchange) -> Point:
    _, _, width, height = exchange.image_box
    return min(max(point[0], 0.0), width - 1), min(max(point[1], 0.0), height - 1)
