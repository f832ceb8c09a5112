"""What decides the scene and the directions of a configuration on a clip, and the names of their folders.

SCENE is a digest of the clip, its names and frames, the stages that find objects and heads, and the code that places
and follows them. DIRECTIONS is a digest of SCENE, the stages of head pose and gaze, and their code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.clips.manifest import ClipManifest
from harness.files.digests import code_of, own_code_digest
from harness.pipeline.cache import identify, parts_of_clip, weights_digests
from harness.pipeline.configuration import METHODS, STAGES, Configuration, StageChoice, open_method, reads_clip
from harness.pipeline.drawn_stage import DrawnClip
from harness.run.directory import RunDirectory
from harness.run.tables import directions_tables, scene_tables
from harness.sources import Clip, MeasuredClip
from vfoa.methods import MethodSettings

Identity = Mapping[str, Any]


def identities(
    configuration: Configuration,
    clip: Clip | MeasuredClip,
    manifest: ClipManifest,
    frames: Iterable[int],
    *,
    digest: str | None,
    drawn: DrawnClip | None,
    clouds: Sequence[int],
) -> tuple[Identity, Identity]:
    """Everything that decides the scene, and everything else that decides the directions, as JSON values.

    ``digest`` is that of the clip's content; None if it is not known, as in a job of its own. ``clouds`` are the
    numbers of points that methods use of a cloud.

    Raises
    ------
    VfoaError
        If weights or files of a stage are missing.
    """
    of_clip = parts_of_clip(manifest.name, clip, digest or "unknown")  # type: ignore[arg-type]
    stages = {slot: _stage(choice, of_clip, clip) for slot, choice in configuration.choices.items()}
    scene = {
        **of_clip,
        "frames": list(frames),
        "names": manifest.naming(),
        **{slot: stages[slot] for slot in ("stereo", "segmentation", "heads")},
        "drawn": configuration.drawn.model_dump(mode="json") if drawn and configuration.uses_drawn else None,
        "drawn sha256": drawn.digest if drawn and configuration.uses_drawn else None,
        "reconstruction": configuration.reconstruction.model_dump(mode="json"),
        "tracking": configuration.attend.tracking.model_dump(mode="json"),
        "clouds": list(clouds),
        "answers": _answers(configuration.attend.attention, manifest, clip),
        "code": [code_of(name) for name in _PLACED_BY],
        "own code": own_code_digest(_WRITTEN_BY),
    }
    directions = {
        **{slot: stages[slot] for slot in ("head_pose", "gaze")},
        "code": [code_of("vfoa.gaze.temporal")],
        "own code": own_code_digest(("harness.pipeline.ground_truth", "harness.run.records")),
    }
    return scene, directions


_PLACED_BY = (
    *("vfoa.reconstruction", "vfoa.divided_people", "vfoa.tracking", "vfoa.instance_tracking", "vfoa.drawn"),
    *("vfoa.depth_memory", "vfoa.visible", "harness.clips.naming"),
)
"""Code that decides the values of a scene, with all that it imports."""
_WRITTEN_BY = (
    *("vfoa.pipeline", "harness.pipeline.perception", "harness.pipeline.drawn_stage", "harness.pipeline.measures"),
    *("harness.run.scenes", "harness.run.tables", "harness.run.table_files"),
)
"""Code that decides them alone: among what it imports are the methods of attention, which do not."""


def _answers(settings: MethodSettings, manifest: ClipManifest, clip: Clip | MeasuredClip) -> Identity | None:
    """What a method that reads its answers adds to the scene: people and objects that nothing else has found."""
    if not reads_clip(settings):
        return None
    code, _ = code_of(METHODS.load(settings.method).__module__)
    files = open_method(settings, manifest, clip).digest()
    return {"settings": settings.model_dump(mode="json"), "files": files, "code": code}


def _stage(choice: StageChoice | None, of_clip: Mapping[str, Any], clip: Clip | MeasuredClip) -> Identity | None:
    """What the outputs of a stage depend on beside the clip."""
    if choice is None:
        return None
    if identity := identify(choice, of_clip):
        return {name: value for name, value in identity.parts.items() if name not in of_clip or name == "versions"}
    slot = STAGES[choice.slot]
    code, versions = code_of(slot.stage_class(choice.name).__module__)
    files = None if isinstance(clip, MeasuredClip) else slot.files_digest(choice, clip)
    weights = weights_digests(choice)
    return {"settings": choice.plain(), "files": files, "weights": weights, "code": code, "versions": versions}


Keys = Mapping[str, str]
"""The keys ``scene`` and ``directions`` of a configuration on a clip."""


def keys_of(decided: Mapping[str, tuple[Identity, Identity]]) -> dict[str, Keys]:
    """The keys of each configuration by its :func:`identities`, unless another scene has them already."""
    keys: dict[str, Keys] = {}
    for name, (of_scene, of_directions) in decided.items():
        scene = key_of(of_scene)
        keys[name] = {"scene": scene, "directions": key_of({"scene": scene, **of_directions})}
    return keys


def has_scene(directory: RunDirectory, clip: str, keys: Keys) -> bool:
    """Whether the folders of a scene and of its directions are there. Then they are whole."""
    return all(path.parent.is_dir() for path in paths_of(directory, clip, keys).values())


def paths_of(directory: RunDirectory, clip: str, keys: Keys) -> dict[str, Path]:
    """The files of the tables of a scene and of its directions."""
    scene, directions = keys["scene"], keys["directions"]
    return {**scene_tables(directory.path, clip, scene), **directions_tables(directory.path, clip, directions)}


def key_of(identity: Identity) -> str:
    """The name of a folder with this identity."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:16]
