"""Scenes of :mod:`scripts.measure.simulated_scenes` as clips of measurements, and an experiment of every method.

python -m scripts.drawn_clips FOLDER [GENERATOR], then ``vfoa run drawn`` in that folder. Clips are drawn by the
generator "table", which no setting was chosen on, or by "room": one for each gaze error, constant bias and seed. The
gaze claims an error of 11.1 degrees whatever the true one is, as in ``python -m scripts.measure posterior``.
"""

from __future__ import annotations

import itertools
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import harness
from harness.files.io import atomic_write
from harness.files.parsing import toml_key, toml_value
from harness.labels.files import write_annotations
from harness.labels.labels import Label, LabelRange, Labels
from harness.sources.measured.clip import MeasuredFrame, MeasuredObject, MeasuredPerson
from harness.sources.measured.tables import write_measured
from scripts.measure.simulated_scenes import NOWHERE, Errors, Generator, Sequence, draw_sequence
from vfoa.geometry import sigma_rad
from vfoa.types import Box3D, Gaze, HeadPose

ERRORS_DEG, BIASES_DEG, SEEDS = (5.0, 11.0, 20.0, 36.0), (0.0, 10.0, 25.0), range(2)
CLAIMED_DEG, HEAD_DEG = 11.1, 5.0
PERSON = "ann"


def main(folder: Path, generator: Generator = "table") -> None:
    """Write the clips, their manifests and the experiment."""
    clips = []
    for error_deg, bias_deg, seed in itertools.product(ERRORS_DEG, BIASES_DEG, SEEDS):
        rng = np.random.default_rng([int(error_deg), int(bias_deg), seed])
        errors = Errors(gaze_deg=error_deg, bias_deg=bias_deg, gain=float(rng.uniform(0.6, 1.0)))
        clips.append(f"drawn_{error_deg:g}_{bias_deg:g}_{seed}")
        _write_clip(folder, clips[-1], draw_sequence(generator, errors, rng))
    atomic_write(folder / "experiments" / "drawn.toml", _experiment(clips))


def _write_clip(folder: Path, name: str, drawn: Sequence) -> None:
    objects = tuple(
        MeasuredObject(
            name=_thing(row),
            category="thing",
            box=Box3D(center_m=center, half_size_m=np.full(3, radius), left_from_box=np.eye(3)),
        )
        for row, (center, radius) in enumerate(zip(drawn.objects, drawn.radii_m, strict=True))
    )
    directions = zip(drawn.time_s.tolist(), drawn.gaze, drawn.head, strict=True)
    frames = {
        number: MeasuredFrame(
            time_ns=round(1e9 * time_s),
            people=(
                MeasuredPerson(
                    name=PERSON,
                    eyes_m=drawn.eyes,
                    head_pose=HeadPose(direction=head, sigma_rad=sigma_rad(HEAD_DEG)),
                    gaze=Gaze(direction=gaze, sigma_rad=sigma_rad(CLAIMED_DEG)),
                    true_gaze=None,
                ),
            ),
            objects=objects,
        )
        for number, (time_s, gaze, head) in enumerate(directions, start=1)
    }
    write_measured(folder / name, frames)
    ranges = (
        LabelRange(
            first_frame=number,
            last_frame=number,
            subject=PERSON,
            label=Label(target="none" if row == NOWHERE else _thing(row)),
        )
        for number, row in enumerate(drawn.label.tolist(), start=1)
    )
    write_annotations(folder / name / "labels.csv", Labels(ranges))
    manifest = {
        "name": name,
        "adapter": "measured",
        "root": str((folder / name).resolve()),
        "labels_file": "labels.csv",
        "licence": "own work",
        "source": {"objects_file": "objects.csv"},
        "subjects": {PERSON: {"category": "person", "instance": 1}},
        "targets": {_thing(row): {"category": "thing", "instance": row + 2} for row in range(len(objects))},
    }
    atomic_write(folder / "datasets" / f"{name}.toml", _toml(manifest))


def _thing(row: int) -> str:
    return f"thing_{row}"


def _experiment(clips: list[str]) -> str:
    people = tomllib.loads((Path(harness.__file__).parent / "experiments" / "people.toml").read_text(encoding="utf-8"))
    methods = people["grid"]["attention"] | {"logit_unlabelled": {"method": "logit"}}
    notes = [
        f"Drawn scenes: gaze errors of {', '.join(f'{each:g}' for each in ERRORS_DEG)} deg, each with a constant bias "
        f"of {', '.join(f'{each:g}' for each in BIASES_DEG)} deg; {CLAIMED_DEG:g} deg are claimed for all.",
        "logit: fitted to the labels of the other clips; logit_unlabelled: to none.",
    ]
    found = {"clips": clips, "preset": "measured", "recording": "none", "notes": notes, "grid": {"attention": methods}}
    return _toml(found)


def _toml(values: Mapping[str, object]) -> str:
    return "".join(f"{toml_key(key)} = {toml_value(value)}\n" for key, value in values.items())


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
