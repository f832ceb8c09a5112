"""The paper's synthetic cases as recordings: stepping through the frames widens the cone."""

from __future__ import annotations

from pathlib import Path

import rerun.blueprint as rrb

from harness.clips.naming import Names
from harness.record import entities
from harness.record.appearance import Colours
from harness.record.attention import log_attention
from harness.record.blueprint import eye_controls, orbital_eye
from harness.record.layer_file import LayerFile
from harness.record.layers import ClipFiles
from harness.record.reconstruction import log_targets
from harness.run.records import to_record
from vfoa.simulation import CASES, RADII_CM, Case, look

_SUBJECT = "subject"
_CONE = "cone"


def record_cases(folder: Path) -> list[Path]:
    """Write ``<case>.rrd`` for each case: frame k has cones of radius k cm at 1.10 m, with their rays and hits."""
    folder.mkdir(parents=True, exist_ok=True)
    return [_record(folder, case) for case in CASES]


def _record(folder: Path, case: Case) -> Path:
    files = ClipFiles(run=folder, clip=case.name.replace(" ", "_"))
    objects = {number: cube.name for number, cube in enumerate(case.objects, start=1)}
    names, colours = Names(subjects={1: _SUBJECT}, targets=objects), Colours(tuple(objects.values()))
    layer = LayerFile(files.images, files)
    layer.open(_layout(case))
    log = layer.part("case")
    for radius_cm in RADII_CM:
        result = look(case, radius_cm)
        record = to_record(case.name, _CONE, result, names)
        log.begin(radius_cm, 0)
        log_targets(log, _CONE, result.scene, record, colours, "light")
        log_attention(log, _CONE, result, record, colours, tuple(objects.values()), "light")
        log.end()
    layer.close(complete=True)
    return files.images


def _layout(case: Case) -> rrb.Blueprint:
    eye = orbital_eye(*eye_controls(look(case, RADII_CM[0]).scene))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin=entities.WORLD,
                contents=[f"{entities.scene(_CONE)}/**", f"{entities.subject_3d(_CONE)}/**"],
                name=case.name,
                line_grid=False,
                eye_controls=eye,
            ),
            rrb.Vertical(
                *(
                    rrb.TimeSeriesView(
                        origin=entities.curves(_CONE, _SUBJECT, value), name=f"{value} over the radius, cm"
                    )
                    for value in ("total", "gaze", "head")
                )
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="frame", play_state="paused", state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
