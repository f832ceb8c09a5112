"""``vfoa fit``: fits settings of the posterior to labelled clips, and scores them on clips that were left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.labels.labels import IGNORED, NOWHERE, Label, Labels
from harness.run.fitted_settings import FitRecord, FittedSettings, FittedValue, HeldOut
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.reliability import BeliefLog, Reliability
from harness.score.replay import replay, to_subject, to_target
from harness.score.verdicts import find_subject, true_targets
from vfoa.attention import boxes_of_others
from vfoa.bayes import BayesSettings, measured_cues
from vfoa.errors import VfoaError
from vfoa.geometry import unit
from vfoa.posterior.belief import Scenery
from vfoa.posterior.fit import Estimate, LabelledFrame, LabelledPerson, fit, settings_from
from vfoa.posterior.settings import PosteriorSettings
from vfoa.visible import views_of


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledRecords:
    """The records of one configuration by clip, the labels, and the settings of attention that the run had."""

    experiment: str
    by_clip: Mapping[str, Sequence[FrameRecord]]
    labels: Mapping[str, Labels]
    attention: Mapping[str, Any]


def fit_posterior(found: LabelledRecords) -> FittedSettings:
    """Fit the settings on all clips; for the calibration after, on all clips but one in turn.

    Raises
    ------
    VfoaError
        If no labelled frame has a person whose directions were measured.
    """
    base = BayesSettings.model_validate({**found.attention, "method": "bayes"})
    people = [
        person
        for clip, records in found.by_clip.items()
        if clip in found.labels
        for person in labelled_people(clip, records, found.labels[clip], base)
    ]
    if not people:
        raise VfoaError(f"fit: {found.experiment}: no labelled frame has measured directions; expected labelled clips")
    clips = list(dict.fromkeys(str(person.clip) for person in people))
    return FittedSettings(
        fit=FitRecord(
            experiment=found.experiment,
            clips=tuple(clips),
            value=tuple(_plain(name, each) for name, each in fit(people).items() if math.isfinite(each.value)),
            held_out=tuple(_held_out(found, clip, people, base) for clip in clips) if len(clips) > 1 else (),
        ),
        attention=_changes(settings_from(people, base), base),
    )


def labelled_people(
    clip: str, records: Sequence[FrameRecord], labels: Labels, settings: BayesSettings
) -> list[LabelledPerson]:
    """Everyone's labelled frames in one clip, without ignored ones and those without a measured direction."""
    frames: dict[str, list[LabelledFrame]] = {}
    for record in records:
        for _, name, label in labels.labelled([record.frame]):
            subject = find_subject(record, name)
            if subject is not None and label.target != IGNORED:
                found = _labelled_frame(record, subject, label, settings)
                if found is not None:
                    frames.setdefault(name, []).append(found)
    return [LabelledPerson(clip=clip, frames=found) for found in frames.values()]


def _labelled_frame(
    record: FrameRecord, found: SubjectRecord, label: Label, settings: BayesSettings
) -> LabelledFrame | None:
    subject = to_subject(found)
    origin, measured = subject.person.eye_origin_left, measured_cues(subject, settings)
    if origin is None or measured is None:
        return None
    targets = tuple(to_target(each) for each in record.targets)
    boxes = boxes_of_others(subject, targets)
    eyes = {
        each.instance_id: np.array(each.eye_origin_m)
        for each in record.subjects
        if each.instance_id is not None and each.eye_origin_m is not None
    }
    views = views_of(origin, tuple(each for each in targets if each.instance.id in boxes), eyes, settings)
    scenery = Scenery(
        keys=(*views.ids, None),
        directions=views.directions,
        variances=views.variances,
        to_camera=unit(-origin if origin.any() else (0, 0, -1)),
    )
    looked_at = None
    if label.target != NOWHERE:
        looked_at = next((each.instance_id for each in true_targets(record, label)), -1)
    return LabelledFrame(time_s=record.time_ns / 1e9, scenery=scenery, measured=measured, looked_at=looked_at)


def _held_out(found: LabelledRecords, clip: str, people: Sequence[LabelledPerson], base: BayesSettings) -> HeldOut:
    before = _reliability(found, clip, base)
    after = _reliability(found, clip, settings_from(people, base, without=clip))
    return HeldOut(
        clip=clip,
        n=before.n,
        right_before=round(before.share_right, 4),
        right_after=round(after.share_right, 4),
        calibration_error_before=round(before.calibration_error, 4),
        calibration_error_after=round(after.calibration_error, 4),
    )


def _reliability(found: LabelledRecords, clip: str, settings: PosteriorSettings) -> Reliability:
    """Calibration on one clip under these settings with forward smoothing."""
    forward = BayesSettings.model_validate({**settings.model_dump(), "smoothing": "forward"})
    log = BeliefLog(["fit"], {clip: found.labels[clip]})
    for _ in log.watch(replay(found.by_clip[clip], forward, "fit")):
        pass
    reliabilities = log.reliabilities()
    if not reliabilities:
        raise VfoaError(f"fit: {clip}: no labelled frame has a prediction")
    return reliabilities[0]


def _changes(fitted: PosteriorSettings, base: PosteriorSettings) -> dict[str, Any]:
    """The settings that differ from ``base``."""
    before = base.model_dump(mode="json")
    return {
        key: round(value, 4) if isinstance(value, float) else value
        for key, value in fitted.model_dump(mode="json").items()
        if value != before[key]
    }


def _plain(name: str, each: Estimate) -> FittedValue:
    low, high = (round(bound, 4) if math.isfinite(bound) else None for bound in (each.low, each.high))
    return FittedValue(name=name, value=round(each.value, 4), n=each.n, low=low, high=high)
