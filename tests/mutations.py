"""Small faults put into the code one at a time, each of which a test must find: ``python -m tests.mutations``.

A mutation is a piece of a file that occurs once, what takes its place, and the tests that must fail then. It survives
if they pass. The files are changed in a copy of the repository.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile

from tests.repository import REPOSITORY


@dataclass(frozen=True, slots=True)
class Mutation:
    """A fault by name: in ``file``, ``old`` becomes ``new``, and ``tests`` (paths, below ``tests/``) must fail."""

    name: str
    file: str
    old: str
    new: str
    tests: str


MUTATIONS = (
    # intervals and tests
    Mutation(
        "a baseline is beaten on looks that are not joined",
        "harness/score/rows.py",
        "sign_flip_p(gains.merged().values)",
        "sign_flip_p(gains.values)",
        "harness/score/test_score.py",
    ),
    Mutation(
        "percentiles are not expanded for small samples",
        "harness/score/intervals.py",
        "ndtr(math.sqrt(n / df) * stdtrit(df, (1 - LEVEL) / 2))",
        "ndtr(stdtrit(1e9, (1 - LEVEL) / 2))",
        "harness/score/test_intervals.py",
    ),
    Mutation(
        "Holm goes on after the first that it does not reject",
        "harness/score/comparison.py",
        "SIGNIFICANCE / (family - min(rank, rejected))",
        "SIGNIFICANCE / (family - rank)",
        "harness/score/test_comparison.py",
    ),
    Mutation(
        "the interval of no difference is not corrected",
        "harness/score/intervals.py",
        "_clopper_pearson(0.0, len(merged.frames), alpha)[1]",
        "_clopper_pearson(0.0, len(merged.frames))[1]",
        "harness/score/test_intervals.py harness/score/test_comparison.py",
    ),
    Mutation(
        "looks are joined once, not until twice the correlation time",
        "harness/score/judged_subjects.py",
        "least_s = 2 * correlation_time_s(",
        "least_s = 1 * correlation_time_s(",
        "harness/score/test_looks.py harness/score/test_score.py",
    ),
    Mutation(
        "a short rest of looks is a unit of its own",
        "harness/score/looks.py",
        "if unit and length < least:",
        "if False:",
        "harness/score/test_looks.py",
    ),
    Mutation(
        "looks within a clip are resampled as if clips were fixed",
        "harness/score/intervals.py",
        "times[:, place] * len(inside)",
        "np.full(REPLICATES, len(inside))",
        "harness/score/test_intervals.py",
    ),
    Mutation(
        "five clips speak of other clips",
        "harness/score/intervals.py",
        "LEAST_CLIPS = 6",
        "LEAST_CLIPS = 5",
        "harness/score/test_intervals.py harness/score/test_comparison.py",
    ),
    Mutation(
        "the standard error has no small-sample factor",
        "harness/score/intervals.py",
        "total += len(inside) / (len(inside) - 1) * float(",
        "total += float(",
        "harness/score/test_intervals.py",
    ),
    # scoring
    Mutation(
        "the best baseline may have seen the labels",
        "harness/score/rows.py",
        "(name for name in BASELINES if name not in SEES_LABELS)",
        "(name for name in BASELINES)",
        "harness/score/test_score.py",
    ),
    Mutation(
        "the limit of the nearest in angle is chosen on the clip itself",
        "harness/score/judged_subjects.py",
        "clip_at[order] != number",
        "clip_at[order] != -1",
        "harness/score/test_score.py harness/score/test_baselines.py",
    ),
    Mutation(
        "events may overlap at no frame",
        "harness/score/looks.py",
        "true[i].first <= predicted[j].last and predicted[j].first <= true[i].last",
        "true[i].first <= predicted[j].last + 1 and predicted[j].first <= true[i].last + 1",
        "harness/score/test_looks.py",
    ),
    # attention and geometry
    Mutation(
        "objects behind the eyes are hit",
        "vfoa/geometry.py",
        "entry = np.maximum(near.max(axis=0), 0)",
        "entry = near.max(axis=0)",
        "vfoa/test_geometry.py",
    ),
    Mutation(
        "a ray through the middle of a box counts less",
        "vfoa/cones.py",
        "(1.5 * d_max - np.maximum(distance, d_min))",
        "(1.4 * d_max - np.maximum(distance, d_min))",
        "vfoa/test_cones.py",
    ),
    Mutation(
        "gaze and head that differ weigh as much as if they agreed",
        "vfoa/cones.py",
        '"differ": (0.9, 0.1),',
        '"differ": (0.6, 0.4),',
        "vfoa/test_cones.py",
    ),
    Mutation(
        "a track ends at its first gap",
        "vfoa/tracking.py",
        "if track.id in places or track.missed < self._settings.ttl",
        "if track.id in places",
        "vfoa/test_tracking.py",
    ),
    Mutation(
        "a saccade is not held",
        "vfoa/gaze_filter.py",
        "[-settings.hold :]",
        "[-1:]",
        "vfoa/test_gaze_filter.py",
    ),
    Mutation(
        "the frame shown at the end of a label has the label, too",
        "harness/labels/labels.py",
        "bisect_left(self.times_ns, end_ns)",
        "bisect_left(self.times_ns, end_ns + 1)",
        "harness/labels/test_timeline.py harness/labels/formats/test_elan.py",
    ),
    Mutation(
        "p values of a family need not ascend",
        "harness/score/statistics.py",
        "highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))",
        "highest = min(1.0, (len(p_values) - rank) * p_values[index])",
        "harness/score/test_statistics.py harness/score/test_comparison.py",
    ),
    # cache and runs
    Mutation(
        "a cached output does not depend on the code of its stage",
        "harness/pipeline/cache.py",
        '        "code": code,\n',
        "",
        "harness/pipeline/test_cached_run.py harness/pipeline/test_stage_cache.py",
    ),
    Mutation(
        "a clip is marked finished before its recordings are closed",
        "harness/run/answers.py",
        "        self._files.__exit__(*error)\n",
        "        self._files.__exit__(*error)\n        if error[0] is None:\n            self.finish()\n",
        "harness/run/test_recordings_kept.py",
    ),
    Mutation(
        "a missing recording does not make a clip unfinished",
        "harness/run/frame_sink.py",
        "        not path.is_file()\n",
        "        False\n",
        "harness/run/test_recordings_kept.py",
    ),
    Mutation(
        "configurations whose shared recording is lost run again alone",
        "harness/run/jobs.py",
        "if not job.has_scene_files(job.context(prepared.clip)):",
        "if False:",
        "harness/run/test_recordings_kept.py",
    ),
    Mutation(
        "recordings made for some configurations count as whole for others",
        "harness/record/recorder.py",
        "if noted and {*configurations} <= {*noted.configurations} else None",
        "if noted else None",
        "harness/record/test_layers.py",
    ),
    Mutation(
        "a clip is perceived again though its scenes are whole",
        "harness/run/loop.py",
        "    if lacking := job.lacking(decided, context):\n",
        "    if lacking := job.configurations:\n",
        "harness/run/test_failing.py",
    ),
    Mutation(
        "directions in the cache are used with another scene",
        "harness/run/scene_cache.py",
        "{digest_files(_files(scene).items())}.bin",
        "tables.bin",
        "harness/run/test_scene_cache.py",
    ),
    # labels and sources
    Mutation(
        "states of BORIS pair by behaviour alone",
        "harness/labels/formats/boris.py",
        "key = event.subject, event.behaviour, event.modifiers",
        'key = event.subject, event.behaviour, ("",)',
        "harness/labels/formats/test_boris.py",
    ),
    Mutation(
        "the time offset of an observation is not subtracted",
        "harness/labels/formats/boris.py",
        'offset_s = _number(observation, "time offset", where)',
        "offset_s = 0.0",
        "harness/labels/formats/test_boris.py",
    ),
    Mutation(
        "the offset of the first film counts",
        "harness/labels/formats/exchange.py",
        "own = (name for film in self.films for name in names if file_name(name) == composed(film))",
        "own = iter(names)",
        "harness/labels/formats/test_boris.py harness/labels/formats/test_elan.py",
    ),
    Mutation(
        "an annotation of ELAN that is divided has the times of the whole",
        "harness/labels/formats/elan.py",
        "return start + (end - start) * place // count, start + (end - start) * (place + 1) // count",
        "return start, end",
        "harness/labels/formats/test_elan.py",
    ),
    Mutation(
        "parts of a divided annotation overlap",
        "harness/labels/formats/elan.py",
        "start + (end - start) * (place + 1) // count",
        "start + (end - start) * (place + 2) // count",
        "harness/labels/formats/test_elan.py",
    ),
    Mutation(
        "pictures are turned the other way round",
        "harness/sources/media/video.py",
        "np.rot90(mirrored, -self.quarters)",
        "np.rot90(mirrored, self.quarters)",
        "harness/sources/media/test_video.py",
    ),
    Mutation(
        "the height of a head is its width",
        "harness/run/records.py",
        "(head.box_px[2] - head.box_px[0]) * origin[2]",
        "(head.box_px[3] - head.box_px[0]) * origin[2]",
        "harness/run/test_records.py",
    ),
    Mutation(
        "right axes are questioned",
        "harness/clips/axes.py",
        "if share < least or share - as_they_are < LEAST_MORE:",
        "if share < 0.1:",
        "harness/clips/test_axes.py",
    ),
)


def survives(mutation: Mutation, folder: Path) -> bool:
    """Whether the tests of a mutation pass in a copy of the repository that has it.

    Raises
    ------
    SystemExit
        If the piece that it replaces does not occur once.
    """
    path = folder / mutation.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutation.old) != 1:
        raise SystemExit(f"{mutation.name}: {mutation.file}: {mutation.old!r} occurs {text.count(mutation.old)} times")
    path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
    tests = [f"tests/{name}" for name in mutation.tests.split()]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        path.write_text(text, encoding="utf-8")
    if done.returncode not in (0, 1):
        raise SystemExit(f"{mutation.name}: pytest ended with {done.returncode}\n{done.stdout[-2000:]}")
    return done.returncode == 0


def main(words: Sequence[str] | None = None) -> int:
    """Try the mutations; 1 if one survives."""
    options = argparse.ArgumentParser(prog="python -m tests.mutations")
    options.add_argument("--only", default="", help="Only mutations whose name has this.")
    only, left = options.parse_args(words).only, list[str]()
    files = subprocess.run(["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in filter(None, files.split("\0")):
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            copyfile(REPOSITORY / file, folder / file)
        for mutation in (mutation for mutation in MUTATIONS if only in mutation.name):
            began_s = time.monotonic()
            is_left = survives(mutation, folder)
            left += [mutation.name] * is_left
            took_s = time.monotonic() - began_s
            print(f"{'SURVIVES' if is_left else 'found':8} {took_s:4.0f} s  {mutation.name}", flush=True)  # noqa: T201
    print(f"{len(left)} survive: {', '.join(left) or 'none'}")  # noqa: T201
    return int(bool(left))


if __name__ == "__main__":
    raise SystemExit(main())
