"""The protocol of a recording's file format: list its messages, and read one again."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from harness.sources.recordings.index import Index, Window
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError


class Messages(Protocol):
    """Returns messages by their places."""

    def read(self, topic: Topic, place: Place) -> bytes:
        """Read one message again.

        Raises
        ------
        VfoaError
            If the file has changed since it was indexed.
        """
        ...


class Container(Messages, Protocol):
    """One recording of one or several files. It holds no messages, and can be pickled to another process."""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files on which messages depend, in order."""
        ...

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None without messages."""
        ...

    def index(self, window: Window | None, *, by_log_time: bool) -> Index:
        """Read all messages once and index them as :class:`harness.sources.recordings.index.TopicIndex` does.

        Raises
        ------
        VfoaError
            If a file is not of this format, or a camera's message cannot be decoded.
        """
        ...


def open_container(path: Path) -> Container:
    """Open the recording at a path: a file, or a folder of files into which it was split. Its content tells the format.

    Raises
    ------
    VfoaError
        If there is no such file or folder, or no recording in it.
    """
    from harness.sources.bags.container import BagContainer
    from harness.sources.bags.files import is_bag
    from harness.sources.mcap.container import McapContainer, files_in

    if not path.exists():
        raise VfoaError(f"{path}: no such file or folder; expected a recording")
    if is_bag(path):
        return BagContainer(path)
    files = (path,) if path.is_file() else files_in(path)
    if not files:
        raise VfoaError(f"{path}: no .mcap, .bag or .db3 in this folder; expected a recording")
    return McapContainer(files)
