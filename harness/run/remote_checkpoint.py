"""Checkpoints of a job on object storage: if its worker is lost, a worker on another machine continues from there.

The files of a job only grow until it is finished, so each publication uploads what was added since the last one:

    <run's address>/.unfinished/<job>/index.json    by file: the objects that make it up, and the bytes of each
    <run's address>/.unfinished/<job>/<unique>      a part of a file

The index is written last, and refers to nothing that another worker writes. So it is always of one piece, even if a
worker that has lost its connection still works on the same job.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import PurePosixPath
from uuid import uuid4

from harness.bounded_parsing import parse_json
from harness.files import replacing
from harness.mirror import is_hidden
from harness.remote import Remote
from harness.run.checkpoint import Checkpoint
from harness.run.clip_job import ClipJob, checkpoints
from vfoa.errors import VfoaError

UNFINISHED = ".unfinished"
"""Folder below the run's address; hidden, so that no copy of the run's directory has it."""

SECONDS = 30.0
"""Least time between two publications of a job."""

_INDEX = "index.json"

Part = tuple[str, int]
"""An object's name, and its number of bytes."""


class RemoteCheckpoint:
    """The published checkpoints of a job, whose directory is a folder of this machine."""

    def __init__(self, address: str, job: ClipJob) -> None:
        key = hashlib.sha256("\0".join(name for pair in job.pairs for name in pair).encode()).hexdigest()[:16]
        self._job, self._folder = job, job.directory.path
        self._run, self._remote = Remote(address), Remote(f"{address}/{UNFINISHED}/{key}")
        self._parts: dict[str, list[Part]] = {}
        self._uploaded = set[str]()
        self._published_s = time.monotonic()

    def fetch(self) -> None:
        """Write the published files into the job's directory, unless there are none, or it has a checkpoint.

        Raises
        ------
        VfoaError
            If the storage cannot be read, or the index is none of this program.
        """
        content = None if checkpoints(self._job) else self._remote.read(_INDEX)
        if content is None:
            return
        index = _checked(parse_json(content, f"{self._remote.address}/{_INDEX}"), self._remote.address)
        for name, parts in index.items():
            with replacing(self._folder / name) as draft, draft.open("wb") as file:
                for part, _ in parts:
                    file.write(self._remote.read(part) or b"")  # one that is missing shows in the checkpoint's checksum
        continued = _extents(checkpoints(self._job).values())
        self._parts = {name: parts for name, parts in index.items() if name in continued}

    def offer(self) -> None:
        """Publish the checkpoint of a job that was begun on this machine, unless there is one already.

        Raises
        ------
        VfoaError
            If the storage cannot be read or written.
        """
        if checkpoints(self._job) and not self._remote.has(_INDEX):
            self.publish()

    def publish_if_due(self) -> None:
        """Publish the last checkpoint, if ``SECONDS`` have passed; a storage that cannot be reached is tried again."""
        if time.monotonic() - self._published_s >= SECONDS:
            self._published_s = time.monotonic()
            with suppress(VfoaError):
                self.publish()

    def publish(self) -> None:
        """Publish the last checkpoint, if there is one.

        Raises
        ------
        VfoaError
            If the storage cannot be written.
        """
        found = checkpoints(self._job)
        if not found:
            return
        self._upload_complete()
        grown = {name: self._grown(name, size) for name, size in _extents(found.values()).items()}
        whole = {name: [self._upload((self._folder / name).read_bytes())] for name in self._names(found)}
        before, self._parts = self._parts, grown | whole
        self._remote.write(_INDEX, json.dumps(self._parts, ensure_ascii=False).encode())
        self._remote.remove(_objects(before) - _objects(self._parts))

    def _upload_complete(self) -> None:
        """Upload the files that are complete already, such as pictures of frames, to their places in the run."""
        found = (path.relative_to(self._folder) for path in self._folder.rglob("*") if path.is_file())
        complete = {path.as_posix() for path in found if path.parts[0] != "partial" and ".partial" not in path.name}
        new = sorted(name for name in complete - self._uploaded if not is_hidden(name))
        self._run.upload(new, self._folder)
        self._uploaded.update(new)

    def remove(self) -> None:
        """Remove all that was published: the job is finished."""
        self._remote.remove([_INDEX])
        self._remote.remove_all()

    def _names(self, found: Iterable[str]) -> list[str]:
        """The names of the checkpoint files of configurations, which are replaced as a whole."""
        clip = self._job.manifest.name
        paths = [self._job.directory.checkpoint((clip, name)) for name in found]
        return [path.relative_to(self._folder).as_posix() for path in paths]

    def _grown(self, name: str, size: int) -> list[Part]:
        """The parts of the first ``size`` bytes of a file; those not published yet are uploaded."""
        parts = self._parts.get(name, [])
        begin = sum(part_bytes for _, part_bytes in parts)
        if begin == size:
            return parts
        with (self._folder / name).open("rb") as file:
            file.seek(begin)
            return [*parts, self._upload(file.read(size - begin))]

    def _upload(self, content: bytes) -> Part:
        part = uuid4().hex
        self._remote.write(part, content)
        return part, len(content)


def _extents(found: Iterable[Checkpoint]) -> dict[str, int]:
    """How many bytes of each file belong to the checkpoints; configurations that share a file agree on it."""
    extents: dict[str, int] = {}
    for state in (state for each in found for state in each.sinks.values()):
        for name, size in state.files.items():
            extents[name] = max(size, extents.get(name, 0))
    return extents


def _objects(parts: Mapping[str, Iterable[Part]]) -> set[str]:
    return {name for each in parts.values() for name, _ in each}


def _checked(index: object, address: str) -> dict[str, list[Part]]:
    """The index, if it names only files inside the folder.

    Raises
    ------
    VfoaError
        If it is of another shape.
    """
    try:
        parts = {str(name): [(str(part), int(size)) for part, size in each] for name, each in dict(index).items()}  # type: ignore[call-overload]
    except (TypeError, ValueError):
        raise VfoaError(f"{address}/{_INDEX}: expected the files of a job and their parts; remove it") from None
    for name in (*parts, *_objects(parts)):
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise VfoaError(f"{address}/{_INDEX}: names {name!r}; expected only names inside the run's directory")
    return parts
