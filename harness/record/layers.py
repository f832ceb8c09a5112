"""The layers of a clip's recording: the files that a run writes, and those that show one configuration.

All files of a clip have one recording id and one application id, so that the viewer and Rerun's catalogue merge them::

    CLIP.rrd                              images, and the masks of each distinct segmentation
    CLIP__RECONSTRUCTION.scene.rrd        disparity, clouds and boxes of each distinct reconstruction
    CLIP__CONFIGURATION.rrd               cones, rays, hits and attention of each configuration
    CLIP__CONFIGURATION.verdicts.rrd      ground truth, verdicts and error types, rewritten by each scoring

A layer that several configurations share is named after the first of them.
"""

from __future__ import annotations

import json
import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

Plain = Mapping[str, Any]
"""A configuration as JSON values, as in the manifest of a run."""

_UNNAMED, _LONGEST = re.compile(r"[^0-9A-Za-z_-]"), 100
"""What Rerun allows in no name of an application, and the most characters of a clip's name in one."""
_MASKS = ("segmentation",)
_RECONSTRUCTION = ("stereo", "segmentation", "heads", "drawn", "reconstruction")


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerNames:
    """The layers that show one configuration, by name."""

    configuration: str
    masks: str
    reconstruction: str


def layer_names(configurations: Mapping[str, Plain]) -> dict[str, LayerNames]:
    """The layers of each configuration of a run, by the configuration's name.

    Configurations share a layer if their settings are equal in the tables on which it depends; where masks are drawn,
    depth cuts them out, so that they depend on the matcher, too.
    """
    names: dict[str, LayerNames] = {}
    first: dict[str, str] = {}
    for name, plain in configurations.items():
        drawn = plain.get("drawn") or {}
        also = ("drawn", "stereo") if drawn.get("targets") or drawn.get("heads") else ()
        masks, reconstruction = (
            first.setdefault(json.dumps([(table, plain.get(table)) for table in (*tables, *also)]), name)
            for tables in (_MASKS, _RECONSTRUCTION)
        )
        names[name] = LayerNames(configuration=name, masks=masks, reconstruction=reconstruction)
    return names


class RecordingIds(NamedTuple):
    """What all layers of a recording share: files of one ``recording`` are merged.

    The viewer keeps a layout for each ``application``.
    """

    application: str
    recording: str


def recording_ids(run_id: str, clip: str) -> RecordingIds:
    """The ids of a clip in the run with this random id: wherever its directory is, and whatever its name."""
    recording = str(uuid.uuid5(uuid.UUID(run_id), clip))
    return RecordingIds(application=f"vfoa {_UNNAMED.sub('-', clip)[:_LONGEST]} {recording[:8]}", recording=recording)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipFiles:
    """The files of one clip's recording in the directory of a run.

    All layers of the clip have the ``ids``; they are needed to write one, not to find them.
    """

    run: Path
    clip: str
    ids: RecordingIds = field(default_factory=lambda: RecordingIds("vfoa", str(uuid.uuid4())), compare=False)

    @property
    def images(self) -> Path:
        """Images and masks."""
        return self.run / f"{self.clip}.rrd"

    def reconstruction(self, name: str) -> Path:
        """Disparity, clouds and boxes of a reconstruction."""
        return self.run / f"{self.clip}__{name}.scene.rrd"

    def attention(self, configuration: str) -> Path:
        """Cones, rays, hits and attention of a configuration."""
        return self.run / f"{self.clip}__{configuration}.rrd"

    def verdicts(self, configuration: str) -> Path:
        """Ground truth and verdicts of a configuration."""
        return self.run / f"{self.clip}__{configuration}.verdicts.rrd"

    @property
    def noted(self) -> Path:
        """While a run is not finished: what images and reconstructions were made with."""
        return self.run / "partial" / f"{self.clip}.recorded.noted"

    def of(self, layers: LayerNames) -> tuple[Path, ...]:
        """Every existing file that shows a configuration."""
        files = (
            self.images,
            self.reconstruction(layers.reconstruction),
            self.attention(layers.configuration),
            self.verdicts(layers.configuration),
        )
        return tuple(file for file in files if file.is_file())
