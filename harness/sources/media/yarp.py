"""Folders that YARP's recorder yarpdatadumper writes: images, and ``data.log`` with the time of each.

Its images are numbered as they come, in each folder apart: a camera that starts later or loses an image has the same
numbers at other times. A line has the number of the packet, the sender's time, the receiver's or both, in seconds, and
the image (``src/yarpdatadumper/main.cpp`` of github.com/robotology/yarp, of 2010 and 2021; read, not used)::

    Type: Image:ppm;                                            in older versions
    Source: /icub/cam/left [connected]
    5331 1384952354.273104 00000000.ppm
    5331 1384952354.273104 1384952354.274212 00000000.ppm [rgb]
"""

from __future__ import annotations

import re
from decimal import Decimal
from pathlib import Path

from harness.files.io import read_text
from vfoa.errors import VfoaError

LOG = "data.log"

_IMAGE = re.compile(r"-?\d+ (?P<time>\d+(?:\.\d+)?) (?:\d+(?:\.\d+)? )?(?P<name>[^\s/\\]+\.\w+)(?: \[\w+\])?")
_HEAD = re.compile(r"(?:Type|Source|Stamp): ")


def read_log(path: Path) -> dict[int, Path]:
    """Return the images beside a log by their time, ns, ascending; the sender's time, if it has both.

    Raises
    ------
    VfoaError
        If a line has no image, or a time occurs twice.
    """
    images: dict[int, Path] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip() or _HEAD.match(line):
            continue
        if (match := _IMAGE.fullmatch(line.strip())) is None:
            raise VfoaError(
                f"{path}:{number}: found {line.strip()[:60]!r}; expected a number, a time and an image, as "
                "yarpdatadumper --type image writes"
            )
        time_ns = round(Decimal(match["time"]) * 10**9)
        if time_ns in images:
            raise VfoaError(f"{path}:{number}: the time {match['time']} occurs twice: {images[time_ns].name}")
        images[time_ns] = path.parent / match["name"]
    if not images:
        raise VfoaError(f"{path}: no images; expected lines of a number, a time and an image")
    return dict(sorted(images.items()))
