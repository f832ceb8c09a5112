"""Small frames' records and labels for the tests of scores and tables."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.labels.labels import RESERVED, Label, LabelRange, Labels
from harness.report.stages import stage_times
from harness.report.write import Scored, render_tables, run_tables, scored, write_scores
from harness.run.columns import PairColumns, Words
from harness.run.directory import Pair, RunDirectory
from harness.run.fitted import FitRecord
from harness.run.manifest import ClipOfRun, RunManifest
from harness.run.records import AttentionRecord, BoxPx, BoxRecord, FrameRecord, SubjectRecord, TargetRecord, Vector
from harness.score.reference import Reference
from harness.score.score import Scores
from harness.score.score import score as score_columns
from tests.disk import LABELS_HEADER, write_text
from tests.record_tables import SizePx, columns_of, write_tables
from vfoa import __version__

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def target_record(
    instance_id: int,
    name: str,
    *,
    box_px: BoxPx | None = (0.0, 0.0, 10.0, 10.0),
    center: Vector | None = (0.0, 0.0, 2.0),
) -> TargetRecord:
    """A target with a 3D box about ``center``; without one if that is None."""
    box = None if center is None else BoxRecord(center_m=center, half_size_m=(0.1, 0.1, 0.1), axes=AXES)
    return TargetRecord(
        instance_id=instance_id, name=name, label="thing", score=0.9, box_px=box_px, points=100, box=box
    )


def subject_record(
    name: str | None,
    *,
    totals: Mapping[int, float] | None = None,
    focus: int | None = None,
    missing: str | None = None,
    instance_id: int | None = None,
    track_id: int = 1,
    eyes: Vector | None = (0.0, 0.0, 1.0),
) -> SubjectRecord:
    """A subject with these attention values by instance, all of them from gaze."""
    attention = tuple(
        AttentionRecord(instance_id=each, gaze=total, head=None, total=total) for each, total in (totals or {}).items()
    )
    return SubjectRecord(
        track_id=track_id,
        name=name,
        instance_id=instance_id,
        head_box_px=(0.0, 0.0, 5.0, 5.0),
        eye_origin_m=eyes,
        gaze=(0.0, 0.0, 1.0),
        gaze_sigma_rad=None,
        head=None,
        missing=missing,
        attention=attention,
        focus=focus,
        tied=(),
    )


def frame_record(
    targets: Iterable[TargetRecord] = (),
    subjects: Iterable[SubjectRecord] = (),
    *,
    frame: int = 1,
    clip: str = "clip",
    configuration: str = "one",
) -> FrameRecord:
    """A frame's record, 25 frames a second."""
    return FrameRecord(
        clip=clip,
        configuration=configuration,
        frame=frame,
        time_ns=frame * 40_000_000,
        targets=tuple(targets),
        subjects=tuple(subjects),
    )


def answers(
    names: Sequence[str | None], *, subject: str = "girl", clip: str = "clip", configuration: str = "one"
) -> list[FrameRecord]:
    """Frames 1, 2, ... in which the subject looks at these targets; ``none``: at nothing, None: is not there."""
    things = sorted({name for name in names if name not in (None, "none")})
    targets = [target_record(each, str(name)) for each, name in enumerate(things, start=1)]
    found: dict[str | None, list[SubjectRecord]] = {None: []}
    for name in {*names} - {None}:
        focus = things.index(name) + 1 if name in things else None
        found[name] = [subject_record(subject, totals={focus: 0.5} if focus else {}, focus=focus)]
    return [
        frame_record(targets, found[name], frame=frame, clip=clip, configuration=configuration)
        for frame, name in enumerate(names, start=1)
    ]


def labels(*targets: str, subject: str = "girl") -> Labels:
    """Labels of frames 1, 2, ..."""
    label = {target: Label(target=target) for target in {*targets}}
    return Labels(
        LabelRange(first_frame=frame, last_frame=frame, subject=subject, label=label[target])
        for frame, target in enumerate(targets, start=1)
    )


def run_manifest(clips: Iterable[str]) -> RunManifest:
    """The manifest of a run of these clips, as far as a page needs it."""
    about = {"licence": None, "frames": [], "rate_hz": None}
    return RunManifest(experiment="test", clips=[ClipOfRun(name=clip, **about) for clip in clips])


def write_manifest(directory: RunDirectory, manifest: Mapping[str, Any]) -> None:
    """Write the manifest of a run with just these keys, right or wrong."""
    write_text(directory.manifest, json.dumps(manifest))


def fit_record(**given: Any) -> FitRecord:
    """What weights were fitted to, by default 20.5 s of two people; ``given`` are other fields."""
    plain = {"experiment": "talk", "configuration": "logit", "clips": ("one", "two"), "people": 2, "labelled_s": 20.5}
    return FitRecord.model_validate({**plain, "version": __version__, **given})


def write_run(folder: Path, records: Iterable[FrameRecord], **about: Any) -> RunDirectory:
    """A finished run of these records, by clip and configuration: its tables, and its manifest if there is none.

    ``about`` are more keys of the manifest, or others for the same keys.
    """
    directory, by_pair = RunDirectory(folder), _by_pair(records)
    if about or not directory.manifest.exists():
        frames = {clip: [each.frame for each in of_pair] for (clip, _), of_pair in by_pair.items()}
        clips = [{"name": clip, "frames": numbers} for clip, numbers in frames.items()]
        configurations = {name: dict[str, Any]() for _, name in by_pair}
        write_manifest(directory, {"clips": clips, "configurations": configurations, "finished": "now", **about})
    write_tables(directory, by_pair)
    return directory


def _by_pair(records: Iterable[FrameRecord]) -> dict[Pair, list[FrameRecord]]:
    by_pair: dict[Pair, list[FrameRecord]] = {}
    for record in records:
        by_pair.setdefault((record.clip, record.configuration), []).append(record)
    return by_pair


def write_clip(
    root: Path, name: str, targets: Sequence[str], notes: Sequence[str] = (), tags: Sequence[str] = ()
) -> dict[str, Any]:
    """Write a clip's manifest and its labels of frames 1, 2, ... of a girl; return its entry in a run's manifest."""
    named = {"subjects.girl": "girl", **{f'targets."{target}"': target for target in sorted({*targets} - {*RESERVED})}}
    tables = "".join(f'[{table}]\ncategory = "{category}"\n' for table, category in named.items())
    rows = [*zip(targets, notes or [""] * len(targets), strict=True)]
    if tags:
        rows = [(target, f"{note},{tag}") for (target, note), tag in zip(rows, tags, strict=True)]
    labelled = "".join(f"{frame},{frame},girl,{target},{note}\n" for frame, (target, note) in enumerate(rows, start=1))
    head = LABELS_HEADER.replace("note\n", "note,tag\n") if tags else LABELS_HEADER
    for path, text in (
        (root / "datasets" / f"{name}.toml", f'name = "{name}"\nadapter = "studio"\nlicence = "MIT"\n{tables}'),
        (root / "annotations" / f"{name}.csv", head + labelled),
    ):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    frames = list(range(1, len(targets) + 1))
    times_ns = [frame * 40_000_000 for frame in frames]
    manifest = str(root / "datasets" / f"{name}.toml")
    return {"name": name, "manifest": manifest, "rate_hz": 25.0, "frames": frames, "times_ns": times_ns}


def tables_of(directory: RunDirectory) -> dict[str, bytes]:
    """The content of every table of frames of a run, by its path; without the times, which differ from run to run."""
    paths = sorted(directory.path.glob("*/**/*.parquet"))
    return {path.relative_to(directory.path).as_posix(): path.read_bytes() for path in paths}


def score_run(folder: Path, records: Iterable[FrameRecord], reference: Reference) -> None:
    """Score records, and write the tables and the page into the folder."""
    directory = RunDirectory(folder)
    found = scored_records(records, reference)
    write_scores(directory, found, run_manifest(reference.labels), stage_times(directory))


def columns_by_pair(records: Iterable[FrameRecord], size_px: SizePx = (None, None)) -> list[PairColumns]:
    """The columns of every (clip, configuration), in the order in which records name them, with images of a size."""
    words = Words()
    return [columns_of(of_pair, words, size_px) for of_pair in _by_pair(records).values()]


def scored_records(records: Iterable[FrameRecord], reference: Reference) -> Scored:
    """The scores of records, and what else a page shows."""
    return scored(columns_by_pair(records), reference)


def score(records: Iterable[FrameRecord], reference: Reference) -> Scores:
    """The scores of records."""
    return score_columns(columns_by_pair(records), reference)


def texts_of(scores: Scores) -> dict[str, str]:
    """Every table of a run, by file name."""
    return render_tables(scores, run_tables(scores))
