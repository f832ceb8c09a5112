"""The frames of a run as Parquet files, for programs; what is the same for several configurations is stored once.

    scenes/SCENE/CLIP/{frames,instances,objects,people,clouds}.parquet  what was found in the images
    directions/DIRECTIONS/CLIP/{directions,true_people}.parquet         where people look
    answers/CONFIGURATION/CLIP.parquet                                  what they look at

SCENE and DIRECTIONS are digests of all that decides them (:mod:`harness.run.scenes`). Each table begins with the clip
and these names, so that tables can be joined. The rows of a frame keep their order, a row group has 600 frames, and
null means unknown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from vfoa.types import DirectionFit

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its type ("?": may be null; ``vec3``: a list of three doubles), and what it means."""

    type: str
    meaning: str


NAMES = {
    "clip": Column("string", "Name of the clip."),
    "scene": Column("string", "Digest of all that decides the scene, as in the path."),
    "directions": Column("string", "Digest of all that decides the directions, as in the path."),
    "configuration": Column("string", "Name of the configuration."),
}
"""The columns that name a table."""
_FRAME = Column("int64", "Number of the frame in the source.")
_TRACK = Column("int32", "Number of the person in the clip, from 1.")


def _of(*names: str) -> dict[str, Column]:
    """The columns that name a table, and the frame."""
    return {**{name: NAMES[name] for name in names}, "frame": _FRAME}


TABLES: Mapping[str, Mapping[str, Column]] = {
    "frames": {
        **_of("clip", "scene"),
        "time_ns": Column("int64", "Time of the frame, ns."),
        "masks_from": Column("int64?", "Key frame whose masks were carried to this one; null: found in this one."),
        "masks_age_s": Column("double?", "Seconds from that frame to this one."),
        "has_truth": Column("bool", "Whether stages were measured against ground truth."),
        "disparity_error_px": Column("double?", "Median error of the disparity, px; null: none is known."),
        "disparity_over_2_px": Column("double?", "Share of pixels whose error is above 2 px."),
        "disparity_known": Column("double?", "Share of the pixels with ground truth that have a disparity."),
        "width_px": Column("int32?", "Width of the images; null, as all that follows: the clip has no images."),
        "height_px": Column("int32?", "Height of the images."),
        "fx_px": Column("double?", "Focal length of the left camera, px."),
        "fy_px": Column("double?", "The same along the columns, px."),
        "cx_px": Column("double?", "Principal point of the left camera, px."),
        "cy_px": Column("double?", "The same along the columns, px."),
        "baseline_m": Column("double?", "Distance of the two cameras, m."),
        "cx_right_px": Column("double?", "Principal point of the right camera, px."),
        "has_right": Column("bool", "Whether the frame has a right image."),
        "has_depth": Column("bool", "Whether the frame has a measured depth map."),
    },
    "instances": {
        **_of("clip", "scene"),
        "instance_id": Column("int32", "Number of the object or person; it is followed from frame to frame."),
        "name": Column("string", "The manifest's name, or `label#id`; may repeat."),
        "label": Column("string", "Class."),
        "own_name": Column("string?", "The source's own name, as of a drawn shape; null: it has none."),
        "category_id": Column("int32", "The source's number of the class."),
        "is_thing": Column("bool", "Whether it can be counted, as a cup; sky cannot."),
        "score": Column("double", "Score of the segmenter, 0 to 1."),
        "box_px": Column("vec4?", "Box in the left image: u0, v0, u1, v1, px; null: the clip has no images."),
        "points": Column("int32", "Number of 3D points."),
        "center_m": Column("vec3?", "Centre of the 3D box in the left camera's frame, m; null: no box."),
        "half_size_m": Column("vec3?", "Half extents of the 3D box along its axes, m."),
        "axes": Column("vec9?", "Axes of the 3D box, three unit vectors one after the other."),
        "depth_from": Column("int64?", "Frame whose depth places the 3D box; null: this one's, or there is no box."),
    },
    "objects": {
        **_of("clip", "scene"),
        "truth_id": Column("int32", "Number of the true object or person."),
        "label": Column("string", "Its class."),
        "instance_id": Column("int32?", "Instance found for it; null: none."),
        "mask_iou": Column("double", "IoU of the masks."),
        "box_iou": Column(
            "double?", "IoU of the 3D boxes, along the camera's axes, 0: none was found; null: no true box."
        ),
        "center_error_m": Column("double?", "Distance of the boxes' centres, m."),
    },
    "people": {
        **_of("clip", "scene"),
        "track_id": _TRACK,
        "name": Column("string?", "The manifest's name of the person; null: not known."),
        "instance_id": Column("int32?", "Instance of the person; null: none."),
        "head_box_px": Column("vec4?", "Box of the head in the left image, px; null: the clip has no images."),
        "head_score": Column("double?", "Score of the head's detector."),
        "looked_at": Column(
            "int32?", 'Instance at the point of the image that `attention.method = "answers"` reads; 0: none.'
        ),
    },
    "clouds": {
        **_of("clip", "scene"),
        "instance_id": Column("int32", "Instance whose 3D points these are; one without points has no row."),
        "points": Column("int32", "Number of the points, evenly chosen: one that a method of the run asks for."),
        "points_m": Column("list<float>", "The points in the left camera's frame, m: x, y, z of the first, and so on."),
    },
    "directions": {
        **_of("clip", "scene", "directions"),
        "track_id": _TRACK,
        "eye_origin_m": Column("vec3?", "Point between the eyes in the left camera's frame, m."),
        "gaze": Column("vec3?", "Unit vector of the gaze as measured, in the left camera's frame."),
        "gaze_sigma_rad": Column("double?", "Error that the gaze model claims, rad."),
        "no_gaze": Column("string?", "The gaze model's reason to give none, such as `face_turned_away`."),
        "head": Column("vec3?", "Unit vector of the head's direction as measured."),
        "head_sigma_rad": Column("double?", "Error that the head pose model claims, rad."),
        "head_width_m": Column("double?", "Width of the head's box at the depth of the eyes, m."),
        "depth_from": Column("int64?", "Frame whose depth places the eyes; null: this one's, or none is known."),
    },
    "true_people": {
        **_of("clip", "scene", "directions"),
        "name": Column("string", "Name of the true person."),
        "head_box_iou": Column("double", "IoU of the head boxes; 0: no head was found."),
        "eye_error_m": Column("double?", "Distance of the eye origins, m."),
        "head_error_deg": Column("double?", "Angle between the directions of the head, deg."),
        "gaze_error_deg": Column("double?", "Angle between the gaze directions, deg."),
    },
    "answers": {
        **_of(*NAMES),
        "track_id": _TRACK,
        "missing": Column("string?", "Why there is none, such as `no_eyes_3d`; null: there is one."),
        "focus": Column("int32?", "Instance with the most attention; null: nowhere, or no answer."),
        "tied": Column("list<int32>", "Other instances with exactly the same attention."),
        "targets": Column("list<int32>", "Instances, in the order of the three lists of attention."),
        "gaze": Column("list<double?>", "Attention to each target from the gaze, 0 to 1; null: not measured."),
        "head": Column("list<double?>", "Attention to each target from the head, 0 to 1; null: not measured."),
        "total": Column("list<double>", "Attention to each target, 0 to 1."),
        "fit": Column(
            "fit?", "How well the directions fit the posterior (`vfoa.types.DirectionFit`); null: no posterior."
        ),
        "gaze_filtered": Column(
            "vec3?", "Unit vector of the gaze after `gaze_filter`; null too if gazes are not filtered."
        ),
        "head_filtered": Column("vec3?", "The same of the head's direction."),
    },
}
"""The columns of each table."""

SCENE_TABLES = ("frames", "instances", "objects", "people", "clouds")
DIRECTIONS_TABLES = ("directions", "true_people")
"""The tables in a folder of ``scenes/`` and of ``directions/``."""


def scene_tables(root: Path, clip: str, scene: str) -> dict[str, Path]:
    """The files of the tables of a scene, in a run's folder."""
    return {table: root / "scenes" / scene / clip / f"{table}.parquet" for table in SCENE_TABLES}


def directions_tables(root: Path, clip: str, directions: str) -> dict[str, Path]:
    """The files of the tables of directions, in a run's folder."""
    return {table: root / "directions" / directions / clip / f"{table}.parquet" for table in DIRECTIONS_TABLES}


LENGTHS = {"vec3": 3, "vec4": 4, "vec9": 9}
"""Numbers in the lists of a type."""


@cache
def schema_of(table: str) -> pa.Schema:
    """The schema of a table's file."""
    import pyarrow as pa

    integers = pa.list_(pa.field("element", pa.int32(), nullable=False))
    doubles = pa.list_(pa.field("element", pa.float64(), nullable=False))
    fit = [pa.field(each.name, pa.float64(), nullable=each.name != "tail") for each in fields(DirectionFit)]
    types = {
        **{name: pa.type_for_alias(name) for name in ("string", "int32", "int64", "double", "bool")},
        "list<int32>": integers,
        "list<double>": doubles,
        "list<float>": pa.list_(pa.field("element", pa.float32(), nullable=False)),
        "list<double?>": pa.list_(pa.float64()),
        **dict.fromkeys(LENGTHS, doubles),
        "fit": pa.struct(fit),
    }
    return pa.schema(
        pa.field(name, types[column.type.removesuffix("?")], nullable=column.type.endswith("?"))
        for name, column in TABLES[table].items()
    )
