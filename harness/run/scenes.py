"""What was perceived of a clip, written frame by frame: a folder of tables for each distinct scene and directions.

Configurations that see the same share a folder (:mod:`harness.run.tables`), whose name follows from what decides it
(:mod:`harness.run.scene_identity`). ``identity.json`` in a folder has what was digested.
"""

from __future__ import annotations

import filecmp
import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from itertools import count
from operator import attrgetter
from pathlib import Path
from typing import Self
from uuid import uuid4

import numpy as np

from harness.pipeline.measures import FrameMeasures, Measurer, PersonMeasure, TargetMeasure
from harness.pipeline.perception import FollowedFrame, SharedFrame
from harness.pipeline.stage_runner import timed
from harness.run.directory import RunDirectory
from harness.run.records import head_width_m
from harness.run.scene_identity import Identity, Keys, key_of, keys_of
from harness.run.table_files import Row, TableWriter, find_tables, write_again
from harness.run.tables import DIRECTIONS_TABLES, SCENE_TABLES, directions_tables, scene_tables
from vfoa.errors import VfoaError
from vfoa.types import Person, Scene, StereoFrame, StereoRig, Target
from vfoa.visible import spaced


class FolderWriter:
    """Writes the tables of a scene or of directions into a draft folder; :meth:`finish` gives it its name.

    Parameters
    ----------
    keys
        ``clip`` and ``scene``; for directions, ``directions`` as well.
    identity
        What the last of these keys is a digest of.
    """

    def __init__(self, directory: RunDirectory, keys: Mapping[str, str], identity: Identity) -> None:
        self._root, self._keys, self._own = directory.path, dict(keys), list(keys)[-1]
        self._draft = directory.partial((keys["clip"], uuid4().hex), "tables")
        self._paths = {table: self._draft / path.name for table, path in self._placed(keys[self._own]).items()}
        self._tables = TableWriter(self._paths, keys)
        text = json.dumps(identity, indent=1, sort_keys=True)
        (self._draft / "identity.json").write_text(text, encoding="utf-8")
        self._final: str | None = None

    def add(self, rows: Mapping[str, Iterable[Row]]) -> None:
        """Add the rows of the next frame, as :meth:`TableWriter.add` does."""
        self._tables.add(rows)

    def finish(self, **above: str) -> str:
        """Give the folder its name, and return its final key; directions need the final key ``scene``.

        If the folder is there with the same content, the draft is removed. If it has another content, this one gets
        another key: a stage may answer differently when it is asked twice.
        """
        if self._final is None:
            self._tables.close()
            keys = {**self._keys, **above}
            for attempt in count():
                if attempt or keys != self._keys:
                    keys[self._own] = key_of({"of": self._keys[self._own], **above, "attempt": attempt})
                    for table, path in self._paths.items():
                        write_again(path, table, keys)
                if self._is_placed(keys[self._own]):
                    break
            self._final = keys[self._own]
        return self._final

    def discard(self) -> None:
        """Remove the draft, unless it is finished."""
        if self._final is None:
            self._tables.abandon()
            shutil.rmtree(self._draft, ignore_errors=True)

    def _is_placed(self, key: str) -> bool:
        """Rename the draft, or remove it if the same is there; False if the name is taken by another content."""
        folder = next(iter(self._placed(key).values())).parent
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._draft.rename(folder)
        except OSError:
            if not folder.is_dir():
                raise
            _, differing, failed = filecmp.cmpfiles(self._draft, folder, _names(self._draft), shallow=False)
            if differing or failed:
                return False
            shutil.rmtree(self._draft)
        return True

    def _placed(self, key: str) -> dict[str, Path]:
        """The files under their final names."""
        return (scene_tables if self._own == "scene" else directions_tables)(self._root, self._keys["clip"], key)


def _names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


class SceneWriters:
    """Writes the scenes and directions of a clip under several configurations: each distinct one once.

    It is a context manager: at its end, what is not finished is removed.

    Parameters
    ----------
    decided
        The :func:`~harness.run.scene_identity.identities` of each configuration, by name.
    measurer
        Measures the stages against the ground truth; None for a clip of recorded poses.
    clouds
        The numbers of points that methods use of a target's cloud.
    """

    def __init__(
        self,
        directory: RunDirectory,
        clip: str,
        decided: Mapping[str, tuple[Identity, Identity]],
        measurer: Measurer | None = None,
        clouds: Sequence[int] = (),
    ) -> None:
        self._measurer, self._clouds = measurer, clouds
        self._folders: dict[str, FolderWriter] = {}
        self._keys: dict[str, tuple[str, str]] = {}
        for name, keys in keys_of(decided).items():
            of_scene, of_directions = decided[name]
            scene, directions = keys["scene"], keys["directions"]
            if scene not in self._folders:
                self._folders[scene] = FolderWriter(directory, {"clip": clip, "scene": scene}, of_scene)
            if directions not in self._folders:
                of_directions = {"scene": scene, **of_directions}
                self._folders[directions] = FolderWriter(directory, {"clip": clip, **keys}, of_directions)
            self._keys[name] = scene, directions

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        for folder in self._folders.values():
            folder.discard()

    def write(self, shared: SharedFrame) -> None:
        """Write the next frame as the configurations have perceived it.

        A scene that none of them has perceived lacks the frame, and is not to be finished.
        """
        written = set[str]()
        for name, followed in shared.by_configuration.items():
            keys = [key for key in self._keys[name] if key not in written]
            if isinstance(followed, VfoaError) or not keys:
                continue
            with timed(followed.timings, "measures"):
                measured = self._measure(followed)
            with timed(followed.timings, "recording"):
                rows = {
                    **_scene_rows(shared.frame, followed, measured, self._clouds),
                    **_directions_rows(followed, measured),
                }
                for key in keys:
                    tables = SCENE_TABLES if key == self._keys[name][0] else DIRECTIONS_TABLES
                    self._folders[key].add({table: rows[table] for table in tables})
            written.update(keys)

    def finish(self, name: str) -> Keys:
        """Give the folders of a configuration their names; return its final keys ``scene`` and ``directions``."""
        scene, directions = (self._folders[key] for key in self._keys[name])
        final = scene.finish()
        return {"scene": final, "directions": directions.finish(scene=final)}

    def _measure(self, followed: FollowedFrame) -> FrameMeasures | None:
        if self._measurer is None or followed.percepts is None:
            return None
        return self._measurer.measure(followed.percepts, followed.scene)


_TRUE_OBJECT = attrgetter(*(each.name for each in fields(TargetMeasure)))
_TRUE_PERSON = attrgetter(*(each.name for each in fields(PersonMeasure)))
_RIG = attrgetter(*(each.name for each in fields(StereoRig)))


def _scene_rows(
    frame: StereoFrame | None, followed: FollowedFrame, measured: FrameMeasures | None, clouds: Sequence[int]
) -> dict[str, Iterable[Row]]:
    """The rows of a frame in the tables of a scene."""
    scene, names = followed.scene, followed.names
    disparity = measured.disparity if measured else None
    about = (
        *(scene.index, scene.time_ns, scene.masks_from, scene.masks_age_s, measured is not None),
        *((disparity.error_px, disparity.over_2_px, disparity.known) if disparity else (None,) * 3),
        *(_RIG(followed.percepts.rig) if followed.percepts else (None,) * len(fields(StereoRig))),
        *(frame is not None and frame.right is not None, frame is not None and frame.depth_m is not None),
    )
    return {
        "frames": [about],
        "instances": (_instance(scene.index, target, names.targets[target.instance.id]) for target in scene.targets),
        "objects": ((scene.index, *_TRUE_OBJECT(each)) for each in (measured.targets if measured else ())),
        "people": (
            _person(scene, track, person, names.subjects.get(track))
            for track, person in followed.tracked.people(scene.people)
        ),
        "clouds": (
            (scene.index, target.instance.id, count, spaced(target.points_left, count).astype(np.float32).ravel())
            for target in scene.targets
            if len(target.points_left)
            for count in clouds
        ),
    }


def _instance(frame: int, target: Target, name: str) -> Row:
    instance, box = target.instance, target.box
    solid = (box.center_m, box.half_size_m, box.left_from_box.T.ravel()) if box else (None, None, None)
    return (
        *(frame, instance.id, name, instance.label, instance.name, instance.category_id, instance.is_thing),
        *(instance.score, target.box_px, len(target.points_left), *solid, target.depth_from),
    )


def _person(scene: Scene, track: int, person: Person, name: str | None) -> Row:
    head = (person.head.box_px, person.head.score) if person.head else (None, None)
    return (scene.index, track, name, person.instance_id, *head, scene.looked_at.get(name or ""))


def _directions_rows(followed: FollowedFrame, measured: FrameMeasures | None) -> dict[str, Iterable[Row]]:
    """The rows of a frame in the tables of directions."""
    number, fx_px = followed.scene.index, followed.percepts.rig.fx_px if followed.percepts else None
    return {
        "directions": (
            _looks(number, track, person, fx_px) for track, person in followed.tracked.people(followed.scene.people)
        ),
        "true_people": ((number, *_TRUE_PERSON(each)) for each in (measured.people if measured else ())),
    }


def _looks(frame: int, track: int, person: Person, fx_px: float | None) -> Row:
    gaze, head, no_gaze = person.view.gaze, person.view.head_pose, person.view.no_gaze
    return (
        *(frame, track, person.eye_origin_left),
        *((gaze.direction, gaze.sigma_rad) if gaze else (None, None)),
        no_gaze.cause if no_gaze else None,
        *((head.direction, head.sigma_rad) if head else (None, None)),
        head_width_m(person, fx_px),
        person.depth_from,
    )


def remove_unused(directory: RunDirectory) -> None:
    """Remove drafts, and answers, scenes and directions of what was interrupted.

    Scenes and directions stay as long as something has failed, for the next try.
    """
    used = [path for _, paths in find_tables(directory) for path in paths.values()]
    folders = {path.parent for path in used}
    places = () if directory.read_manifest().failed else ("scenes", "directions")
    for folder in (folder for place in places for folder in directory.path.glob(f"{place}/*/*")):
        if folder not in folders:
            shutil.rmtree(folder)
            with suppress(OSError):  # other clips have the same key
                folder.parent.rmdir()
    for path in {*directory.path.glob("answers/*/*")} - {*used}:
        path.unlink()
    for draft in directory.path.glob("partial/*.tables"):
        shutil.rmtree(draft)
