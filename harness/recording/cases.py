"""The paper's synthetic cases as recordings: to scrub through the frames is to widen the cone."""

from __future__ import annotations

import uuid
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from harness.clips.naming import Names
from harness.recording import entities
from harness.recording.attention import log_attention
from harness.recording.blueprint import eye_controls, orbital_eye
from harness.recording.frame_log import FrameLog
from harness.recording.labels import Colours
from harness.recording.recorder import APPLICATION
from harness.recording.scene import log_targets
from harness.recording.stages import class_context
from harness.runs.records import to_record
from vfoa.simulation import CASES, RADII_CM, Case, look

_SUBJECT = "subject"


def record_cases(folder: Path) -> list[Path]:
    """Write ``<case>.rrd`` for each case: frame k has cones of radius k cm at 1.10 m, with their rays and hits."""
    folder.mkdir(parents=True, exist_ok=True)
    return [_record(folder, case) for case in CASES]


def _record(folder: Path, case: Case) -> Path:
    path = folder / f"{case.name.replace(' ', '_')}.rrd"
    partial = path.with_name(f"{path.name}.partial")
    things = {number: cube.name for number, cube in enumerate(case.objects, start=1)}
    names, colours = Names(subjects={1: _SUBJECT}, targets=things), Colours(tuple(things.values()))
    stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid5(uuid.NAMESPACE_URL, f"vfoa:case/{case.name}"))
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.save(partial, default_blueprint=_layout(case))
    stream.send_recording_name(case.name)
    stream.log(entities.WORLD, rr.ViewCoordinates.RDF, static=True)
    stream.log(entities.WORLD, class_context(colours.known), static=True)
    log = FrameLog(stream)
    for radius_cm in RADII_CM:
        result = look(case, radius_cm)
        record = to_record(case.name, "cone", result, names)
        log.begin(radius_cm, 0)
        log_targets(log, result.scene, record, colours, "light")
        log_attention(log, result, record, colours)
        log.end()
    log.close()
    stream.flush()
    stream.disconnect()
    partial.replace(path)
    return path


def _layout(case: Case) -> rrb.Blueprint:
    eye = orbital_eye(*eye_controls(look(case, RADII_CM[0]).scene))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin=entities.WORLD,
                contents=[f"{entities.INSTANCES}/**", f"{entities.SUBJECTS}/**"],
                name=case.name,
                line_grid=False,
                eye_controls=eye,
            ),
            rrb.Vertical(
                *(
                    rrb.TimeSeriesView(origin=entities.curves(_SUBJECT, value), name=f"{value} over the radius, cm")
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
