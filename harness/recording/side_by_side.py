"""Two recordings of one clip as one: each under its configuration's name, over a common time, side by side.

Two recordings that are open beside each other keep a time cursor each; in one recording there is only one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import LazyChunkStream, RrdReader

from harness.files import replacing
from harness.recording import entities
from harness.recording.blueprint import eye_for, orbital_eye
from harness.recording.reading import reading
from harness.recording.recorder import APPLICATION, recording_id
from vfoa.types import Float

_POSITIONS = "Points3D:positions"
_PROPERTIES = "/__properties/**"
"""Rerun's own place for what describes a whole recording; under a prefix it would mean nothing."""


def write_side_by_side(clip: str, recordings: Mapping[str, Path], path: Path) -> None:
    """Write a recording that holds ``recordings``, by configuration, each under ``/<configuration>``.

    It stands at ``path`` when all of it is written, and replaces what stood there.

    Raises
    ------
    VfoaError
        If one of them is damaged.
    """
    prefixes = {configuration: f"/{rr.escape_entity_path_part(configuration)}" for configuration in recordings}
    eye = orbital_eye(*eye_for([points for each in recordings.values() for points in _first_clouds(each)]))
    columns = [_column(name, prefixes[name], _entities(each), eye) for name, each in recordings.items()]
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id(path, clip, " vs ".join(recordings)))
    with replacing(path) as draft:
        stream.save(draft, default_blueprint=_layout(columns))
        stream.send_recording_name(f"{clip}, {' and '.join(recordings)}")
        for configuration, recording in recordings.items():
            stream.send_chunks(_under(prefixes[configuration], recording))
        stream.flush()
        stream.disconnect()


def _under(prefix: str, recording: Path) -> LazyChunkStream:
    chunks = RrdReader(recording).stream().drop(content=_PROPERTIES)
    return chunks.map(lambda chunk: chunk.with_entity_path(prefix + chunk.entity_path))


def _entities(recording: Path) -> list[str]:
    with reading(recording):
        return sorted({chunk.entity_path for chunk in RrdReader(recording).stream().drop(content=_PROPERTIES)})


def _first_clouds(recording: Path) -> list[Float]:
    """The points (N, 3) of each instance when it is first seen, camera frame, metres."""
    found: dict[str, Float] = {}
    with reading(recording):
        for chunk in RrdReader(recording).stream().filter(content=f"{entities.INSTANCES}/**", components=_POSITIONS):
            clouds = chunk.to_record_batch().column(_POSITIONS).drop_null().to_pylist()
            if chunk.entity_path not in found and clouds:
                found[chunk.entity_path] = np.array(clouds[0], dtype=np.float64).reshape(-1, 3)
    return list(found.values())


def _layout(columns: Sequence[rrb.Vertical]) -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Horizontal(*columns),
        rrb.TimePanel(timeline="frame", play_state="paused", state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _column(configuration: str, prefix: str, paths: Sequence[str], eye: rrb.EyeControls3D) -> rrb.Vertical:
    """One configuration from top to bottom; both columns are alike, so that the eye compares along a line."""
    # as in a single recording: rays would hide the image, and what is drawn in the image has no place in space
    rays = [f"- {prefix}{path}" for path in paths if path.startswith(entities.SUBJECTS) and path.endswith("/rays")]
    camera, subjects, depth = (prefix + path for path in (entities.CAMERA, entities.SUBJECTS, entities.DEPTH))
    flat = (entities.DEPTH, entities.MASKS, entities.TARGETS_2D, entities.HEADS_2D)
    world = [f"{prefix}{entities.WORLD}/**", *(f"- {prefix}{path}/**" for path in flat)]
    return rrb.Vertical(
        rrb.Spatial2DView(
            origin=camera, contents=[f"{camera}/**", f"- {depth}/**", f"{subjects}/**", *rays], name=configuration
        ),
        rrb.Spatial3DView(
            origin=prefix + entities.WORLD,
            contents=world,
            name=f"{configuration}: scene in metres",
            line_grid=False,
            eye_controls=eye,
        ),
        rrb.Tabs(
            rrb.TextDocumentView(origin=prefix + entities.SUMMARY, name=f"{configuration}: this frame"),
            rrb.TimeSeriesView(
                origin=prefix + entities.ATTENTION,
                contents=[prefix + path for path in paths if _is_total(path)],
                name="Attention",
                plot_legend=rrb.PlotLegend(visible=False),  # no room; the colours are those of the boxes
                axis_y=rrb.ScalarAxis(range=(0.0, 1.0)),  # the same for both, or heights could not be compared
            ),
            rrb.TextLogView(origin=prefix + entities.LOG, name="Failures"),
            active_tab=0,
        ),
        rrb.StateTimelineView(origin=prefix + entities.VERDICT, name=f"{configuration}: truth, prediction, verdict"),
        row_shares=[5, 5, 4, 3],
    )


def _is_total(path: str) -> bool:
    """Whether it is the curve of a subject's whole attention: ``/attention/<subject>/total/<target>``."""
    parts = re.split(r"(?<!\\)/", path)  # a name's own slash is escaped
    return path.startswith(f"{entities.ATTENTION}/") and len(parts) == 5 and parts[3] == "total"
