"""Rerun's catalogue server: recordings that a browser opens at a frame, by their address.

The web viewer takes the time out of an address only where a catalogue serves the recording, and the catalogue does not
read the layout inside a recording by itself: each one is a dataset of its own here, with its own layout, and its files
are the layers of one segment.
"""

from __future__ import annotations

import re
import tempfile
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from rerun.catalog import CatalogClient, DatasetEntry, NotFoundError
from rerun.chunk import RrdReader
from rerun.server import Server

from harness.local_server import HOST
from harness.record.composed import Composed
from harness.record.reading import reading
from vfoa.errors import VfoaError

_PATIENCE_S = 1.0
_Version = tuple[str, int, int]


class Catalogue:
    """A catalogue in this process and on this machine only, as a context manager; it ends with the process.

    A recording is read when it is first asked for. Several threads may ask.
    """

    def __init__(self) -> None:
        self._datasets: dict[tuple[_Version, ...], DatasetEntry] = {}
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        self._scratch = tempfile.TemporaryDirectory()
        self._layouts = Path(self._scratch.name)
        self._server = Server(host=HOST)  # its default is every network interface
        self._client: CatalogClient = self._server.client()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # it waits for every viewer that is still connected, and a viewer connects for good: that is not waited for
        ending = threading.Thread(target=self._server.shutdown, daemon=True)
        ending.start()
        ending.join(timeout=_PATIENCE_S)
        self._scratch.cleanup()

    @property
    def origin(self) -> str:
        """Where a browser reaches it: ``http://host:port``."""
        return self._server.url().removeprefix("rerun+")

    def address(self, recording: Composed, frame: int | None) -> str:
        """What the viewer opens: ``rerun+http://...`` of a recording, at a frame.

        Raises
        ------
        VfoaError
            If a file is missing, or is no recording.
        """
        with self._lock:
            dataset = self._dataset(recording)
            (segment,) = dataset.segment_ids()
        return dataset.segment_url(segment) if frame is None else dataset.segment_url(segment, "frame", frame)

    def _dataset(self, recording: Composed) -> DatasetEntry:
        """The dataset of a recording as its files are now: a run or a scoring may have written them anew."""
        version = tuple(_version(file) for file in recording.files)
        if version not in self._datasets:
            try:
                self._datasets[version] = self._register(recording)
            except (ValueError, RuntimeError, NotFoundError) as error:
                names = ", ".join(map(str, recording.files))
                raise VfoaError(f"{names}: not a recording: {str(error).splitlines()[0]}") from None
        return self._datasets[version]

    def _register(self, recording: Composed) -> DatasetEntry:
        for file in recording.files:
            with reading(file):
                RrdReader(file).recordings()
        dataset = self._client.create_dataset(self._name(recording))
        uris = [file.resolve().as_uri() for file in recording.files]
        dataset.register(uris, layer_name=[f"layer {number}" for number in range(len(uris))]).wait()
        if (layout := recording.layout()) is not None:
            place = self._layouts / f"{len(self._datasets)}.rbl"
            layout.save(recording.application_id, place)
            dataset.register_blueprint(place.as_uri())
        elif RrdReader(recording.files[0]).blueprints():
            dataset.register_blueprint(uris[0])
        return dataset

    def _name(self, recording: Composed) -> str:
        """What the viewer's list says: the name with what a name may not hold left out, and not yet taken."""
        name = re.sub(r"[^A-Za-z0-9_. -]", "-", recording.name)
        taken = self._client.dataset_names()
        number = next(n for n in range(1, len(taken) + 2) if f"{name} {n}" not in taken)
        return f"{name} {number}"


def _version(file: Path) -> _Version:
    try:
        stat = file.stat()
    except OSError:
        raise VfoaError(f"{file}: found no such recording; was the run made without it?") from None
    return str(file), stat.st_mtime_ns, stat.st_size
