"""Copies of what was perceived, in the cache: a later run that sees the same reads no image of the clip.

    <root>/stages/scene/SCENE/tables.bin              the folder of a scene (:mod:`harness.run.scenes`)
    <root>/stages/directions/DIRECTIONS/CONTENT.bin   that of directions, and the times of the stages
    <root>/stages/pictures/PICTURES/files.bin         what a sink has written of the images alone

CONTENT is a digest of the scene's tables: a stage may answer differently when it is asked twice, and directions belong
to the scene that they were measured with.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from harness.files.digests import digest_files
from harness.files.folders import warn_not_stored
from harness.pipeline.cache_store import Store
from harness.run.directory import RunDirectory
from harness.run.frame_sink import ClipContext, PictureSinkFactory
from harness.run.scene_identity import Identity, Keys, has_scene, key_of, keys_of, paths_of
from vfoa.errors import VfoaError

_TIMES = "times.csv"
_OF_IMAGES = ("clip", "clip sha256", "clip code", "versions", "frames")
"""The entries of a scene's identity that decide the images."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneCache:
    """The copies of what a run's configurations see of one clip.

    ``decided`` holds the :func:`harness.run.scene_identity.identities` of each configuration by its name.
    """

    store: Store
    directory: RunDirectory
    clip: str
    decided: Mapping[str, tuple[Identity, Identity]]

    def fetch(self) -> bool:
        """Copy the scenes that the run lacks into its folder; return whether some were copied."""
        lacking = {
            name: keys for name, keys in keys_of(self.decided).items() if not has_scene(self.directory, self.clip, keys)
        }
        return sum(self._fetch(name, keys) for name, keys in lacking.items()) > 0

    def fetch_pictures(self, sinks: Iterable[PictureSinkFactory], context: ClipContext) -> None:
        """Copy the files of these sinks into the run's folder, if they are not whole there."""
        for sink in sinks:
            with self._draft() as draft:
                if not sink.is_whole(context) and self.store.unpack(self._of_pictures(sink), draft):
                    shutil.rmtree(sink.folder(context), ignore_errors=True)  # a part, of an interrupted run
                    _place(draft, sink.folder(context))

    def keep(self, final: Mapping[str, Keys], sinks: Iterable[PictureSinkFactory], context: ClipContext) -> None:
        """Copy the scenes with these keys into the cache, and the files of these sinks.

        If the cache cannot be written, this is logged, and a later run perceives the clip again.
        """
        try:
            for name, keys in keys_of(self.decided).items():
                if final.get(name) == keys:  # otherwise, a stage has answered differently than before
                    self._keep(name, keys)
            for sink in sinks:
                path, folder = self._of_pictures(sink), sink.folder(context)  # none is there of a clip without images
                if not path.exists() and folder.is_dir() and sink.is_whole(context):
                    self._pack(path, _files(folder), "files", self._images())
        except (OSError, VfoaError) as error:
            warn_not_stored(self.store.root, error)

    def _fetch(self, name: str, keys: Keys) -> bool:
        """Copy the scene and the directions of a configuration, and the times of its stages: all, or none."""
        scene, directions = self._folders(keys)
        with self._draft() as draft:
            seen, looks = draft / "scene", draft / "directions"
            if scene.is_dir():
                seen = scene
            elif not self.store.unpack(self._of_scene(keys), seen):
                return False
            if not self.store.unpack(self._of_directions(keys, seen), looks) or not (looks / _TIMES).is_file():
                return False
            start = f"{self.clip},{name},".encode()
            rows = (looks / _TIMES).read_bytes().splitlines(keepends=True)
            self._times(name).write_bytes(b"".join(start + row.split(b",", 2)[2] for row in rows))
            (looks / _TIMES).unlink()
            _place(seen, scene)
            _place(looks, directions)
        return True

    def _keep(self, name: str, keys: Keys) -> None:
        scene, directions = self._folders(keys)
        path = self._of_directions(keys, scene)
        if not path.exists() or not self._of_scene(keys).exists():
            of_scene, of_directions = self.decided[name]
            self._pack(self._of_scene(keys), _files(scene), "tables", of_scene)
            self._pack(path, {**_files(directions), _TIMES: self._times(name)}, "tables", of_directions)

    def _pack(self, path: Path, files: Mapping[str, Path], kind: str, identity: Identity) -> None:
        slot, key = path.parts[-3:-1]
        self.store.describe(slot, key, {**identity, "stage": kind, "clip": self.clip})
        self.store.pack(path, files)

    def _of_scene(self, keys: Keys) -> Path:
        return self.store.folder("scene", keys["scene"]) / "tables.bin"

    def _of_directions(self, keys: Keys, scene: Path) -> Path:
        """The copy of the directions that were measured in the scene of this folder."""
        return self.store.folder("directions", keys["directions"]) / f"{digest_files(_files(scene).items())}.bin"

    def _of_pictures(self, sink: PictureSinkFactory) -> Path:
        return self.store.folder("pictures", key_of({**self._images(), "code": sink.code()})) / "files.bin"

    def _images(self) -> Identity:
        """What the images of the clip depend on."""
        of_scene, _ = next(iter(self.decided.values()))
        return {name: of_scene[name] for name in _OF_IMAGES}

    def _folders(self, keys: Keys) -> tuple[Path, Path]:
        """The folders of a scene and of its directions in the run."""
        paths = paths_of(self.directory, self.clip, keys)
        return paths["frames"].parent, paths["directions"].parent

    def _times(self, name: str) -> Path:
        return self.directory.partial((self.clip, name), "scene.csv")

    @contextmanager
    def _draft(self) -> Iterator[Path]:
        """The path of a folder that is removed at the end, if it is still there."""
        draft = self.directory.partial((self.clip, uuid4().hex), "tables")
        try:
            yield draft
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def _files(folder: Path) -> dict[str, Path]:
    return {path.name: path for path in sorted(folder.iterdir())}


def _place(draft: Path, folder: Path) -> None:
    """Give a folder its name, unless the same is there."""
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft.rename(folder)
