"""The files of a run; none of them is ever half-written.

``scenes/`` and ``directions/`` get the tables of a clip when it is perceived (:mod:`harness.run.scenes`), ``answers/``
that of a (clip, configuration) when it is finished; drafts are in ``partial/``. There, while a run is on, are also the
times of the stages (:mod:`harness.run.timings`) and the traceback of a faulty stage. Only one run at a time can use the
directory.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from harness.clips.manifest import manifest_of_run
from harness.files.io import atomic_write, naming, read_bytes, take_lock, unreadable
from harness.files.parsing import parse_json
from harness.files.remote import local_folder
from harness.run.manifest import Failure, RunManifest
from vfoa.errors import StageError, VfoaError, did_you_mean
from vfoa.validation import parse

Pair = tuple[str, str]
"""A clip's name and a configuration's."""
LOCK = ".lock"
_HOLDER = 200
"""Most characters of a lock that are read."""
_TRACEBACK = "traceback.txt"


def new_run_id() -> str:
    """A random id for a run: its manifest keeps it when the directory is renamed or copied."""
    return str(uuid.uuid4())


def out_folder(out: str | Path) -> Path:
    """The folder to run in, with a name, which "." and ".." lack: a run beside it is named after it.

    Raises
    ------
    VfoaError
        If it is an address.
    """
    folder = local_folder(out, "--out")
    return folder if folder.name not in ("", "..") else folder.resolve()


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """The directory of a run."""

    path: Path

    @property
    def timings(self) -> Path:
        """Milliseconds per clip, configuration, frame and stage. Not a result: it differs from run to run."""
        return self.path / "timings.parquet"

    @property
    def manifest(self) -> Path:
        """The run's manifest: what was run, with which versions, on which data."""
        return self.path / "manifest.json"

    @property
    def inputs(self) -> Iterator[Path]:
        """The files that scores, exports and fits read, of the run and of its clips: no output may replace them."""
        yield from (self.manifest, self.timings)
        yield from self.path.glob("*.rrd")
        yield from self.path.rglob("*.parquet")
        yield from (self.path / "partial").rglob("*")
        run = self.read_manifest() if self.manifest.is_file() else RunManifest()
        for clip in run.clips:
            with suppress(VfoaError):  # the clip of a finished run may be gone
                yield from manifest_of_run(clip.manifest, clip.name, run.scored_annotator).files

    def failure(self, pair: Pair, error: VfoaError) -> Failure:
        """Return the manifest's row for a (clip, configuration) that failed, and write its traceback."""
        failure = Failure(clip=pair[0], configuration=pair[1], error=str(error))
        if not isinstance(error, StageError):
            return failure
        atomic_write(self.traceback(pair), error.trace)
        return failure.model_copy(update={"traceback": self.traceback(pair).relative_to(self.path).as_posix()})

    def line_of(self, failure: Failure) -> str:
        """Return a failure as one line of text."""
        kept = f" (traceback: {self.path / failure.traceback})" if failure.traceback else ""
        return f"{failure.clip} under {failure.configuration}: {failure.error}{kept}"

    @property
    def noted_inputs(self) -> Path:
        """Digests of the inputs by their files' stamps, to continue and to score (:mod:`harness.files.digests`)."""
        return self.path / "inputs.noted"

    def traceback(self, pair: Pair) -> Path:
        """The file for the traceback of a (clip, configuration) that a stage's fault ended."""
        return self.partial(pair, _TRACEBACK)

    def answers(self, pair: Pair) -> Path:
        """The table of the answers of a (clip, configuration)."""
        return self.path / "answers" / pair[1] / f"{pair[0]}.parquet"

    def is_finished(self, pair: Pair) -> bool:
        """Whether a (clip, configuration) is marked finished: its answers are whole, and so were its other files."""
        return self.partial(pair, "csv").exists() and self.answers(pair).exists()

    @property
    def writer(self) -> str:
        """The process that writes the run, or has been killed while it did; "" if there is none."""
        try:
            return (self.path / LOCK).read_text(encoding="utf-8", errors="replace")[:_HOLDER].strip()
        except OSError:
            return ""

    def unmark(self, pair: Pair) -> None:
        """Remove the results of a finished (clip, configuration), which must run again."""
        for path in (self.partial(pair, "csv"), self.answers(pair)):
            path.unlink(missing_ok=True)

    def read_manifest(self) -> RunManifest:
        """Read the manifest.

        In a project that was moved or copied, the clips are those of the project where it is now: a clip's manifest is
        the file at the same place from the run's directory, if there is one.

        Raises
        ------
        VfoaError
            If the directory is not a run's, or the manifest does not have a run's shape.
        """
        try:
            is_there = self.manifest.exists()
        except (OSError, ValueError) as error:
            raise unreadable(self.path, error) from None
        if not is_there:
            absent = "a file" if self.path.is_file() else "nothing there"
            problem = "no manifest.json in it" if self.path.is_dir() else absent
            runs = {str(path.parent) for at in ("*", "runs/*") for path in Path().glob(f"{at}/manifest.json")}
            hint = f"; {did_you_mean(str(self.path), runs)}" if runs else ""
            raise VfoaError(f"{self.path}: expected a run's directory, found {problem}{hint}")
        manifest = parse(RunManifest, parse_json(read_bytes(self.manifest), self.manifest), str(self.manifest))
        if manifest.directory in ("", self._absolute):
            return manifest
        clips = [
            clip.model_copy(update={"manifest": self._beside(clip.manifest, manifest.directory)})
            for clip in manifest.clips
        ]
        return manifest.model_copy(update={"clips": clips})

    def write_manifest(self, manifest: RunManifest) -> None:
        """Write the manifest."""
        self.path.mkdir(parents=True, exist_ok=True)
        plain = {**manifest.plain(), "directory": self._absolute}
        atomic_write(self.manifest, json.dumps(plain, indent=2, ensure_ascii=False) + "\n")

    @property
    def _absolute(self) -> str:
        return os.path.abspath(self.path)

    def _beside(self, place: str, directory: str) -> str:
        """The file that is to this directory as ``place`` was to ``directory``; ``place`` if there is none."""
        if not place:
            return place
        now = os.path.normpath(os.path.join(self._absolute, os.path.relpath(place, directory)))
        return now if os.path.isfile(now) else place

    def discard(self, pair: Pair) -> None:
        """Remove the partial results of a (clip, configuration) that is not finished."""
        for suffix in ("answers.partial", "csv.partial", _TRACEBACK):
            self.partial(pair, suffix).unlink(missing_ok=True)

    def remove_partial(self) -> None:
        """Remove the partial results once no run will continue them."""
        shutil.rmtree(self.path / "partial", ignore_errors=True)

    def is_new(self) -> bool:
        """Whether no run is here: a killed run's draft of its first file, and a refused run's tracebacks may be."""
        return not self.path.exists() or all(map(_is_left_over, self.path.iterdir()))

    def has_results(self) -> bool:
        """Whether a clip is perceived, or finished under a configuration: the next run goes on from there."""
        return any(path.is_file() for folder in ("scenes", "answers") for path in (self.path / folder).rglob("*"))

    def partial(self, pair: Pair, suffix: str) -> Path:
        """A file of the partial results of a (clip, configuration)."""
        return self.path / "partial" / f"{_stem(pair)}.{suffix}"


def _is_left_over(path: Path) -> bool:
    if path.name == "partial":
        return all(map(_is_traceback, path.iterdir()))
    return path.name == LOCK or path.name.startswith(".manifest.json.")


def _is_traceback(path: Path) -> bool:
    return path.name.endswith(f".{_TRACEBACK}")


def _stem(pair: Pair) -> str:
    return "__".join(pair)


@contextmanager
def locked(folder: Path, tell: Callable[[str], None]) -> Iterator[None]:
    """Lock a folder for this process. The lock of a process that has ended is taken over and reported to ``tell``.

    The file stays when the lock is released, empty: another process may be about to lock it.

    Raises
    ------
    VfoaError
        If another process holds the lock.
    """
    file, is_free = _open_lock(folder)
    with file:
        file.seek(0)
        holder = file.read(_HOLDER).strip()
        if not is_free:
            raise VfoaError(
                f"{folder}: {holder or 'another process'} runs here; expected one run in a directory: wait for it, or "
                "choose another --out"
            )
        if holder:
            tell(f"{folder}: took over the lock of {holder}, which has ended")
        try:
            with naming(folder / LOCK):
                file.truncate(0)
                os.write(file.fileno(), f"process {os.getpid()} on {platform.node()}".encode())
            yield
        finally:
            file.truncate(0)


def _open_lock(folder: Path) -> tuple[IO[str], bool]:
    """The lock of a folder, made if there is none, and whether this process holds it now."""
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("a+", errors="replace")
        is_free = take_lock(file)
        if not is_free or _is_at(file, folder / LOCK):
            return file, is_free
        file.close()  # a refused run has removed it meanwhile


def _is_at(file: IO[str], path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def missing_of(folder: Path) -> list[Path]:
    """What a run in this folder makes before it begins, of what is not there: lock, folder and folders above it."""
    return [path for path in (folder / LOCK, folder, *folder.parents) if not path.exists()]


@contextmanager
def removed_if_refused(directory: RunDirectory, made: Iterable[Path]) -> Iterator[None]:
    """If the block is refused before a clip is perceived, remove what it wrote into a new directory, and ``made``.

    A :class:`VfoaError` refuses it. After a repair the same command is another run, for which the directory would be
    taken. Tracebacks stay: messages name them. The directory is locked; ``made`` is :func:`missing_of` it before it
    was.
    """
    was_new = directory.is_new()
    try:
        yield
    except VfoaError:
        if was_new and not directory.has_results():
            with suppress(OSError):  # a folder that is not empty, or closed: the block's error says what to do
                _remove_refused(directory.path, made)
        raise


def _remove_refused(folder: Path, made: Iterable[Path]) -> None:
    partial = folder / "partial"
    for path in (*folder.iterdir(), *partial.glob("*")):
        if path.is_dir() and path != partial:
            shutil.rmtree(path)
        elif path not in (partial, folder / LOCK) and not _is_traceback(path):
            path.unlink()
    with suppress(OSError):
        partial.rmdir()
    for path in made:
        if path.is_dir():
            path.rmdir()
        else:
            path.unlink()
