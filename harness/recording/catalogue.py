"""Rerun's catalogue server: recordings that a browser opens at a frame, by their address.

The web viewer takes the time out of an address only where a catalogue serves the recording, and the catalogue does not
read the layout inside a recording by itself: each one is a dataset of its own here, with its own layout.
"""

from __future__ import annotations

import re
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from rerun.catalog import CatalogClient, DatasetEntry, NotFoundError
from rerun.chunk import RrdReader
from rerun.server import Server

from harness.local_server import HOST
from vfoa.errors import VfoaError

_PATIENCE_S = 1.0
_Version = tuple[str, int, int]


class Catalogue:
    """A catalogue in this process and on this machine only, as a context manager; it ends with the process.

    A recording is read when it is first asked for. Several threads may ask.
    """

    def __init__(self) -> None:
        self._datasets: dict[_Version, DatasetEntry] = {}
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
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

    @property
    def origin(self) -> str:
        """Where a browser reaches it: ``http://host:port``."""
        return self._server.url().removeprefix("rerun+")

    def address(self, recording: Path, frame: int | None) -> str:
        """What the viewer opens: ``rerun+http://...`` of a recording, at a frame.

        Raises
        ------
        VfoaError
            If the file is missing, or is no recording.
        """
        with self._lock:
            dataset = self._dataset(recording)
            (segment,) = dataset.segment_ids()
        return dataset.segment_url(segment) if frame is None else dataset.segment_url(segment, "frame", frame)

    def _dataset(self, recording: Path) -> DatasetEntry:
        """The dataset of a recording as its file is now: a run may have written it anew since it was last seen."""
        try:
            stat = recording.stat()
        except OSError:
            raise VfoaError(f"{recording}: found no such recording; was the run made without it?") from None
        version = str(recording), stat.st_mtime_ns, stat.st_size
        if version not in self._datasets:
            try:
                self._datasets[version] = self._register(recording)
            except (ValueError, RuntimeError, NotFoundError) as error:
                raise VfoaError(f"{recording}: not a recording: {str(error).splitlines()[0]}") from None
        return self._datasets[version]

    def _register(self, recording: Path) -> DatasetEntry:
        layouts = RrdReader(recording).blueprints()
        dataset = self._client.create_dataset(self._name(recording))
        uri = recording.resolve().as_uri()
        dataset.register([uri]).wait()
        if layouts:
            dataset.register_blueprint(uri)
        return dataset

    def _name(self, recording: Path) -> str:
        """What the viewer's list says: the file's name with what a name may not hold left out, and not yet taken."""
        name = re.sub(r"[^A-Za-z0-9_. -]", "-", recording.stem)
        taken = self._client.dataset_names()
        number = next(n for n in range(1, len(taken) + 2) if f"{name} {n}" not in taken)
        return f"{name} {number}"
