"""The files of a run, and the promise that none of them is ever half-written.

While a run is going on, ``parts/`` holds one JSON-lines file per (clip, configuration), called ``.partial`` until it is
finished, and the directory has no tables. When all is done the parts are joined into ``results.jsonl`` and
``timings.csv`` in the order of the experiment, and the tables are written from those. Where a faulty stage ended one,
its traceback stands among the parts.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.files import atomic_write
from harness.runs.parts import Part, open_part
from vfoa.errors import VfoaError, did_you_mean

Pair = tuple[str, str]
"""A clip's name and a configuration's."""


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """Where a run stands."""

    path: Path

    @property
    def results(self) -> Path:
        """One frame's record a line, in the order of the experiment."""
        return self.path / "results.jsonl"

    @property
    def timings(self) -> Path:
        """Milliseconds per clip, configuration, frame and stage. Not a result: it differs from run to run."""
        return self.path / "timings.csv"

    @property
    def manifest(self) -> Path:
        """What was run, with which versions, on which data."""
        return self.path / "manifest.json"

    def failure(self, pair: Pair, error: str) -> dict[str, str]:
        """What the manifest says of a (clip, configuration) that could not be finished, and where its traceback is."""
        row = {"clip": pair[0], "configuration": pair[1], "error": error}
        kept = self.traceback(pair)
        return {**row, "traceback": kept.relative_to(self.path).as_posix()} if kept.is_file() else row

    def told(self, failure: Mapping[str, str]) -> str:
        """A failure in one line."""
        kept = f" (traceback: {self.path / failure['traceback']})" if "traceback" in failure else ""
        return f"{failure['clip']} under {failure['configuration']}: {failure['error']}{kept}"

    @property
    def signals(self) -> Path:
        """What the stages found, where it was asked to be saved (:mod:`harness.signals.saved`)."""
        return self.path / "signals"

    def recording(self, pair: Pair) -> Path:
        """The Rerun recording of one clip under one configuration."""
        return self.path / f"{_stem(pair)}.rrd"

    def recordings(self) -> dict[Pair, Path]:
        """The recordings that the run has: those of its manifest whose files are there. Raises as reading that does."""
        run = self.read_manifest()
        pairs = [(clip["name"], configuration) for clip in run["clips"] for configuration in run["configurations"]]
        return {pair: self.recording(pair) for pair in pairs if self.recording(pair).is_file()}

    def traceback(self, pair: Pair) -> Path:
        """Where the traceback of a (clip, configuration) is kept that ended in a fault of a stage."""
        return self._part(pair, "traceback.txt")

    def has_part(self, pair: Pair) -> bool:
        """Whether a (clip, configuration) is finished."""
        return self._part(pair, "jsonl").exists()

    def read_manifest(self) -> dict[str, Any]:
        """The manifest.

        Raises
        ------
        VfoaError
            If the directory is not a run's.
        """
        try:
            return json.loads(self.manifest.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise VfoaError(f"{self.path}: expected a run's directory, found {self._what_is_there()}") from None
        except ValueError as error:
            raise VfoaError(f"{self.manifest}: not a run's manifest: {error}") from None

    def _what_is_there(self) -> str:
        """Why this is no run's directory, and which ones are in it or, where it is missing, beside it."""
        place = self.path if self.path.is_dir() else self.path.parent
        near = sorted({str(each.parent) for under in ("*", "runs/*") for each in place.glob(f"{under}/manifest.json")})
        if self.path.is_dir():
            return f"no manifest.json in it{'; runs in it: ' if near else ''}{', '.join(near)}"
        return f"nothing there; {did_you_mean(str(self.path), near)}" if near else "nothing there"

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Write the manifest."""
        self.path.mkdir(parents=True, exist_ok=True)
        atomic_write(self.manifest, json.dumps(manifest, indent=2, ensure_ascii=False) + "\n")

    @contextmanager
    def part(self, pair: Pair) -> Iterator[Part]:
        """Open the part of a (clip, configuration) where it was broken off; it is finished when all went well."""
        places = [self._part(pair, "jsonl"), self._part(pair, "csv")]
        drafts = [place.with_suffix(place.suffix + ".partial") for place in places]
        with open_part(drafts[0], drafts[1]) as part:
            yield part
            # the timings first: the results' file is the one that says "finished"
            drafts[1].replace(places[1])
            drafts[0].replace(places[0])

    def join(self, pairs: Iterable[Pair]) -> None:
        """Make ``results.jsonl`` and ``timings.csv`` of the finished parts; they stay."""
        pairs = list(pairs)
        _concatenate([self._part(pair, "csv") for pair in pairs], self.timings, "clip,configuration,frame,stage,ms\n")
        _concatenate([self._part(pair, "jsonl") for pair in pairs], self.results)

    def begin_anew(self, pair: Pair) -> None:
        """Remove what is there of a (clip, configuration) that is not finished."""
        for suffix in ("jsonl.partial", "csv.partial"):
            self._part(pair, suffix).unlink(missing_ok=True)

    def remove_parts(self) -> None:
        """Remove the parts, when nothing will go on with them."""
        shutil.rmtree(self.path / "parts", ignore_errors=True)

    def is_new(self) -> bool:
        """Whether no run stands here; the draft of a first file, left by a kill, is nothing."""
        return not self.path.exists() or all(path.name.startswith(".manifest.json.") for path in self.path.iterdir())

    def _part(self, pair: Pair, suffix: str) -> Path:
        return self.path / "parts" / f"{_stem(pair)}.{suffix}"


def pair_of(stem: str) -> Pair:
    """The (clip, configuration) whose files are called so: no clip's name has two underscores together."""
    clip, _, configuration = stem.partition("__")
    return clip, configuration


def _stem(pair: Pair) -> str:
    return "__".join(pair)


def _concatenate(parts: list[Path], place: Path, header: str = "") -> None:
    draft = place.with_suffix(place.suffix + ".partial")
    with open(draft, "wb") as joined:
        joined.write(header.encode())
        for part in parts:
            with open(part, "rb") as source:
                shutil.copyfileobj(source, joined)
    draft.replace(place)
