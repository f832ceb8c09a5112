"""The harness for scripts and notebooks: run an experiment, load a finished run, tables as pandas DataFrames."""

from __future__ import annotations

import io
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from harness.files.parsing import toml_value
from harness.files.remote import local_folder
from harness.files.safe_names import vfoa_command
from harness.report.comparisons import comparisons_csv
from harness.report.formats import to_csv
from harness.report.frames_csv import run_frames
from harness.report.write import rescore
from harness.run.directory import RunDirectory, out_folder
from harness.run.executors import cores
from harness.run.experiment import RecordingKind, load_experiment
from harness.run.manifest import MOST, Failure
from harness.run.table_files import make_table, read_table
from harness.run.tables import TABLES
from harness.run.timings import read_timings
from harness.score.compared_runs import compare_runs as _compare_runs
from harness.score.finished_run import FinishedRun
from vfoa.errors import VfoaError
from vfoa.types import StereoRig

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from rerun.notebook import Viewer

    from harness.record.composed import Composed

_INTEGERS = {"track": "Int64", "instance": "Int64", "focus": "Int64"}
_WORDS = (
    *("clip", "subject", "configuration", "reference", "target", "truth", "outcome", "error_type"),
    *("interval_unit", "unit", "beats_baselines", "unknown_names"),
)


class IncompleteRunWarning(UserWarning):
    """Some configurations failed on some clips: the tables have only the others.

    ``failures`` has one mapping for each: ``clip``, ``configuration``, ``error``.
    """

    def __init__(self, message: str, failures: Sequence[Mapping[str, str]]) -> None:
        super().__init__(message)
        self.failures = tuple(failures)


class RunResults:
    """A finished run. Its tables of rates are those on disk, as the run or the last ``vfoa score`` wrote them.

    Parameters
    ----------
    path
        The run's directory.

    Raises
    ------
    VfoaError
        If it is not a run's directory, or the run is not finished.
    """

    def __init__(self, path: str | Path) -> None:
        self.directory = RunDirectory(local_folder(path, "load_run:"))
        self._manifest = FinishedRun.read(self.directory).manifest

    def __repr__(self) -> str:
        return f"RunResults({str(self.path)!r})"

    @property
    def path(self) -> Path:
        """The run's directory."""
        return self.directory.path

    @property
    def manifest(self) -> dict[str, Any]:
        """``manifest.json``: what was run, with which versions, on which data, and what failed."""
        return self._manifest.plain()

    @property
    def clips(self) -> tuple[str, ...]:
        """Names of the clips, in the order of the experiment."""
        return tuple(clip.name for clip in self._manifest.clips)

    @property
    def configurations(self) -> tuple[str, ...]:
        """Names of the configurations, in the order of the experiment."""
        return tuple(self._manifest.configurations)

    @cached_property
    def frr(self) -> pd.DataFrame:
        """``frr.csv``: rates with intervals. Columns: :func:`harness.report.csv_tables.frr_columns`.

        Raises
        ------
        VfoaError
            If there is no such file: ``vfoa score`` writes it.
        """
        return self._table("frr.csv")

    @cached_property
    def frames(self) -> pd.DataFrame:
        """Every attention value, judged by the present labels. It takes seconds for minutes of video.

        Columns: :data:`harness.report.frames_csv.FRAMES_COLUMNS`. Raises the errors of :meth:`rescore`.
        """
        return _read(io.StringIO("".join(run_frames(self.directory))), "predicted")

    @cached_property
    def comparisons(self) -> pd.DataFrame:
        """``comparisons.csv``: every two configurations. See :data:`harness.report.csv_tables.COMPARISON_COLUMNS`.

        Raises the errors of :attr:`frr`.
        """
        return self._table("comparisons.csv")

    @cached_property
    def answers(self) -> pd.DataFrame:
        """What everybody looks at: a row per person, frame and configuration.

        Columns: ``TABLES["answers"]`` of :mod:`harness.run.tables`. Integers are nullable.

        Raises
        ------
        VfoaError
            If a table is missing or damaged, or the run is of an earlier version, which wrote none.
        """
        return self._parquet("answers")

    @cached_property
    def scenes(self) -> dict[str, pd.DataFrame]:
        """What the answers come from, by table: frames, instances, objects, people, directions, true_people.

        Columns: :data:`harness.run.tables.TABLES`. ``clip``, ``scene`` and ``frame`` join them with the answers;
        configurations of the same masks, depth and heads share a scene. Clouds, which are large, are only in the files.
        Raises the errors of :attr:`answers`.
        """
        return {name: self._parquet(name) for name in TABLES if name not in ("answers", "clouds")}

    @cached_property
    def timings(self) -> pd.DataFrame:
        """Milliseconds of each stage in each frame: a row per clip, configuration, frame and stage; no result.

        Raises
        ------
        VfoaError
            If the file is damaged. A run without it, as of an earlier version, has no rows.
        """
        return _frame_of(read_timings(self.directory))

    def attend(self, changes: Mapping[str, Any], configurations: str | Collection[str] = ()) -> pd.DataFrame:
        """Return the answers under other settings, from what the run has perceived: no image is read.

        ``run.attend({"attention.cones_cm": [10.0]})`` has the columns of :attr:`answers`. The run is not changed.

        Parameters
        ----------
        changes
            Settings of the tables ``attention`` and ``gaze_filter`` by dotted key. Another ``attention.method`` has the
            defaults of its other settings.
        configurations
            Names of those to change, or the name of one; default: all.

        Raises
        ------
        VfoaError
            If a setting is wrong or decides what is perceived, the run has no clouds of the number of points that the
            method asks for, or a table is missing or damaged.
        """
        import pyarrow as pa

        from harness.run.attend import attend_again

        chosen = (configurations,) if isinstance(configurations, str) else configurations
        parts = [make_table("answers", keys, rows) for keys, rows in attend_again(self.directory, changes, chosen)]
        return _frame_of(pa.concat_tables(parts))

    @property
    def failures(self) -> pd.DataFrame:
        """The wrong frames: clip, configuration, frame, time_s, subject, truth, predicted, error_type.

        Raises the errors of :meth:`rescore`.
        """
        wrong = self.frames[self.frames["outcome"] == "wrong"]
        columns = ["clip", "configuration", "frame", "time_s", "subject", "truth", "predicted", "error_type"]
        return wrong[columns].drop_duplicates(ignore_index=True)

    @property
    def failed(self) -> pd.DataFrame:
        """The configurations that could not be finished on a clip: clip, configuration, error."""
        rows = [failure.plain() for failure in self._manifest.failed]
        return pd.DataFrame(rows, columns=["clip", "configuration", "error"])

    @property
    def recordings(self) -> dict[tuple[str, str], tuple[Path, ...]]:
        """The Rerun recordings of the run by clip and configuration: the files of their layers."""
        return {pair: recording.files for pair, recording in self._recorded().items()}

    def recording(self, clip: str, configuration: str) -> tuple[Path, ...]:
        """The Rerun recording of a clip under a configuration: the files of its layers, which the viewer merges.

        Raises
        ------
        VfoaError
            If there is none.
        """
        return self._recording(clip, configuration).files

    def show(self, clip: str, configuration: str, frame: int | None = None) -> Viewer:
        """Return the Rerun viewer of a notebook with the recording; with ``frame``, it opens there.

        Raises
        ------
        VfoaError
            If there is no such recording, or the notebook viewer is not installed.
        """
        from harness.record.viewer import show_recording

        return show_recording(self._recording(clip, configuration), frame)

    def _recorded(self) -> dict[tuple[str, str], Composed]:
        from harness.record.composed import served_recordings

        return served_recordings(self.path)

    def _recording(self, clip: str, configuration: str) -> Composed:
        recordings = self._recorded()
        if (clip, configuration) not in recordings:
            known = ", ".join(f"{a} under {b}" for a, b in recordings) or "none"
            raise VfoaError(f"{self.path}: no recording of {clip!r} under {configuration!r}; recordings: {known}")
        return recordings[clip, configuration]

    def rescore(self) -> RunResults:
        """Score the run again with the present labels (as ``vfoa score``), and load the new tables.

        Raises
        ------
        VfoaError
            If no configuration ran on every clip, or a clip's manifest or labels cannot be read.
        """
        rescore(self.directory)
        return RunResults(self.path)

    def _table(self, name: str) -> pd.DataFrame:
        path = self.path / name
        if not path.is_file():
            raise VfoaError(f"{path}: no such table; `{vfoa_command('score', self.path)}` writes it")
        return _read(path)

    def _parquet(self, name: str) -> pd.DataFrame:
        return _frame_of(read_table(self.directory, name))


def _frame_of(table: pa.Table) -> pd.DataFrame:
    """A table as a DataFrame with nullable integers."""
    import pyarrow as pa

    nullable = {pa.int32(): pd.Int32Dtype(), pa.int64(): pd.Int64Dtype()}
    frame: pd.DataFrame = table.to_pandas(types_mapper=nullable.get)
    return frame


def load_run(path: str | Path) -> RunResults:
    """Load a finished run, such as ``load_run("runs/demo")``.

    Raises
    ------
    VfoaError
        If it is not a run's directory, or the run is not finished.
    """
    return RunResults(path)


def run_experiment(
    name_or_path: str | Path,
    *,
    clips: str | Iterable[str] = (),
    settings: Mapping[str, Any] | None = None,
    preset: str | None = None,
    out: str | Path | None = None,
    limit: int | None = None,
    workers: int = 1,
    recordings: bool | RecordingKind | None = None,
    cache: bool = True,
) -> RunResults:
    """Run an experiment as ``vfoa run`` does, write its tables and report, and load them.

    Parameters
    ----------
    name_or_path
        An experiment by name or as a ``.toml`` file. ``"default"`` with ``clips`` does the same as ``vfoa run CLIP``.
    clips
        Run these clips instead of the experiment's own; one may be given by its name alone.
    settings
        Values by dotted key, set in every configuration, such as ``{"attention.n_rays": 20}``.
    preset
        A bundle of settings by name, such as ``"realtime"``.
    out
        The run's directory; by default ``runs/<experiment>``.
    limit
        Run only the first ``limit`` frames of each clip, 1 or more.
    workers
        Processes; 0 means one per core.
    recordings
        Whether to write Rerun recordings, or their kind as ``--recording`` of ``vfoa run``; None: as the experiment
        says.
    cache
        Whether to reuse stage outputs of earlier runs, and to store those of this one.

    Warns
    -----
    IncompleteRunWarning
        If some (clip, configuration) failed: each with its error. The others are in the tables.

    Raises
    ------
    VfoaError
        If the experiment, a clip, a setting or a number is wrong, ``out`` holds another run, or nothing could be
        finished.
    """
    from harness.pipeline.cache_store import open_store
    from harness.report.experiment_run import run_whole

    if limit is not None:
        _check_number("limit", limit, 1)
    _check_number("workers", workers, 0)
    chosen = (clips,) if isinstance(clips, str) else tuple(clips)
    overrides = tuple(f"{key}={toml_value(value)}" for key, value in (settings or {}).items())
    experiment = load_experiment(str(name_or_path), clips=chosen, overrides=overrides, preset=preset)
    _, directory = run_whole(
        experiment,
        out_folder(Path("runs") / experiment.name if out is None else out),
        workers=workers or cores(),
        cache=open_store() if cache else None,
        next_free=out is None,
        limit=limit,
        recording=("light" if recordings else "none") if isinstance(recordings, bool) else recordings,
    )
    if failed := directory.read_manifest().failed:  # before scoring, which may find nothing that can be compared
        warnings.warn(_incomplete(directory, failed), stacklevel=2)
    rescore(directory)
    return RunResults(directory.path)


def _check_number(name: str, number: object, least: int) -> None:
    if not (isinstance(number, int | np.integer) and number >= least):
        raise VfoaError(f"run_experiment: {name}: expected a whole number, at least {least}, found {number!r}")


def _incomplete(directory: RunDirectory, failed: Sequence[Failure]) -> IncompleteRunWarning:
    named = "; ".join(directory.line_of(failure) for failure in failed[:MOST])
    more = f"; and {len(failed) - MOST} more" if len(failed) > MOST else ""
    text = f"{directory.path}: {len(failed)} failed: {named}{more}"
    return IncompleteRunWarning(text, [failure.plain() for failure in failed])


def compare_runs(runs: str | Path | Sequence[str | Path], *, baseline: str | Path | None = None) -> pd.DataFrame:
    """Compare configurations on the same frames, as ``vfoa compare`` does.

    Compares every two configurations of one run, those of several runs with the ones of the same name, and with
    ``baseline`` each with that run's of the same name (:func:`harness.score.compared_runs.compare_runs`). Columns:
    :data:`harness.report.csv_tables.COMPARISON_COLUMNS`.

    Raises
    ------
    VfoaError
        If there is no run, a run cannot be scored, or the runs have nothing in common.
    """
    given = [runs] if isinstance(runs, str | Path) else list(runs)
    if not given:
        raise VfoaError("compare_runs: expected at least one run's directory, found none")
    paths = [local_folder(run, "compare_runs:") for run in given]
    compared = _compare_runs(paths, None if baseline is None else Path(baseline))
    return _read(io.StringIO(to_csv(comparisons_csv(compared.comparisons))))


def read_rig(*files: str | Path, size_px: tuple[int, int]) -> StereoRig:
    """Read the rig of a rectified pair from calibration files: OpenCV, ROS, Kalibr, KITTI, ZED, OAK and others.

    Parameters
    ----------
    files
        One file, or two (left and right of ROS, intrinsics and extrinsics of OpenCV).
    size_px
        (width, height) of the images.

    Raises
    ------
    VfoaError
        If the files are of no known kind, or describe images that must be rectified first (``vfoa clips add`` makes a
        clip that rectifies them on reading).
    """
    from harness.sources.calibration import Calibration
    from harness.sources.calibration_files.read import read_cameras

    if not files:
        raise VfoaError("read_rig: expected at least one calibration file, found none")
    cameras = read_cameras([Path(file) for file in files], lambda: size_px)
    if not isinstance(cameras, Calibration):
        raise VfoaError(
            f"{files[0]}: calibrates images that are not rectified; expected the calibration of a rectified pair"
        )
    return cameras.rig(*size_px)


def _read(source: Path | io.StringIO, *words: str) -> pd.DataFrame:
    """Read a table of a run: names (and the columns ``words``) stay text, and only empty cells are missing values."""
    kinds = dict.fromkeys((*_WORDS, *words), "str") | _INTEGERS
    return pd.read_csv(source, keep_default_na=False, na_values=[""], dtype=kinds, encoding="utf-8")
