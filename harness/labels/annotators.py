"""Which annotation files a clip has.

``annotations/<clip>.csv``, which is scored, ``<clip>@<annotator>.csv``, and ``<clip>.drawn.csv``: what is drawn on its
images.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from harness.data_folders import came_with_program, folders
from harness.files import stands
from vfoa.errors import VfoaError, did_you_mean

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnotationFiles:
    """The annotation files of one clip. An annotator of None means ``<clip>.csv``.

    They are looked for in ``annotations`` beside the manifest's folder, then in that of the working directory. Labels
    that came with the program are taken for clips that did: never for another clip of the same name.
    """

    clip: str
    manifest: Path

    def find(self, annotator: str | None = None) -> Path | None:
        """An annotator's file; None where there is none."""
        return self._find(f"{self._stem(annotator)}.csv")

    def find_drawn(self) -> Path | None:
        """What is drawn on the clip, the same for all annotators; None where there is nothing."""
        return self._find(f"{self.clip}.drawn.csv")

    def place_drawn(self) -> Path:
        """Where what is drawn is written: in the folder of :meth:`place`."""
        return self.place().with_name(f"{self.clip}.drawn.csv")

    def find_speech(self) -> Path | None:
        """Who speaks in the clip, the same for all annotators; None where nobody has said."""
        return self._find(f"{self.clip}.speech.csv")

    def place_speech(self) -> Path:
        """Where speaking turns are written: in the folder of :meth:`place`."""
        return self.place().with_name(f"{self.clip}.speech.csv")

    def _find(self, name: str) -> Path | None:
        return next((folder / name for folder in self._folders if stands(folder / name)), None)

    def expect(self, annotator: str) -> Path:
        """A named annotator's file.

        Raises
        ------
        VfoaError
            If there is none; the message proposes the nearest name.
        """
        if path := self.find(annotator):
            return path
        known = self.annotators()
        hint = did_you_mean(annotator, known) if known else f"expected one of {self.clip}@ANNOTATOR.csv, found none"
        raise VfoaError(f"{self.clip}: no annotations by {annotator!r} ({self._stem(annotator)}.csv); {hint}")

    def place(self, annotator: str | None = None) -> Path:
        """Where an annotator's file is written.

        That is beside the manifest, or in the working directory for a clip that came with the program; never in the
        file of another clip of this name.
        """
        return self._beside / f"{self._stem(annotator)}.csv"

    def annotators(self) -> tuple[str, ...]:
        """Everyone who has a file for this clip, sorted; ``<clip>.csv`` is not counted."""
        stems = (path.stem for folder in self._folders for path in folder.glob(f"{self.clip}@*.csv"))
        return tuple(sorted({stem.partition("@")[2] for stem in stems}))

    @property
    def _beside(self) -> Path:
        if came_with_program(self.manifest):  # the working directory's own labels of such a clip come first
            return Path.cwd() / "annotations"
        return self.manifest.resolve().parent.parent / "annotations"

    @property
    def _folders(self) -> list[Path]:
        """Where files are looked for, the first first."""
        own, *of_program = folders("annotations")
        return [self._beside, own, *(of_program if came_with_program(self.manifest) else ())]

    def _stem(self, annotator: str | None) -> str:
        if annotator is None:
            return self.clip
        if not _NAME.fullmatch(annotator):
            raise VfoaError(f"annotator: found {annotator!r}; expected a name of letters, digits and . _ - alone")
        return f"{self.clip}@{annotator}"
