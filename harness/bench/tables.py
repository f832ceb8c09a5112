"""The benchmark's rows as tables."""

from __future__ import annotations

from collections.abc import Sequence

from harness.bench.attention import AttentionTiming
from harness.bench.realtime import BASELINE, Speed
from harness.bench.stages import STAGES, StageCosts
from harness.bench.stereo import OFF_PX, StereoQuality
from harness.report.formats import UNKNOWN, Table


def stages_table(clip: str, rows: Sequence[StageCosts]) -> Table:
    """Milliseconds per stage, median and 95th percentile, frames per second and bytes per frame: a column each."""
    present = [stage for stage in STAGES if any(stage in row.stages_ms for row in rows)]
    return Table(
        title=f"Milliseconds a frame on {clip}",
        columns=("stage", *(row.configuration for row in rows)),
        rows=(
            *((stage, *(_ms(row.stages_ms.get(stage)) for row in rows)) for stage in present),
            ("whole frame", *(_ms(row.frame_ms) for row in rows)),
            ("frames/s", *(f"{row.frames_per_second:.1f}" for row in rows)),
            ("recording, kB a frame", *(_kilobytes(row.recording_bytes) for row in rows)),
        ),
        words=1,
        notes=(
            "Median / 95th percentile of a real run in one process with one thread, each configuration as if alone.",
        ),
    )


def stereo_table(clip: str, rows: Sequence[StereoQuality]) -> Table:
    """Disparity compared with the ground truth."""
    return Table(
        title=f"Disparity against the truth on {clip}",
        columns=("matcher of", "frames", "known", "median error px", f"off by > {OFF_PX:g} px", "known and right"),
        rows=tuple(
            (
                row.configuration,
                str(row.frames),
                f"{row.known_share:.1%}",
                f"{row.median_error_px:.2f}",
                f"{row.off_share:.1%}",
                f"{row.right_share:.1%}",
            )
            for row in rows
        ),
        words=1,
        notes=(
            "Known: share of the pixels with a true disparity that got one. Errors are over the known pixels, "
            "known and right is over all.",
        ),
    )


def attention_table(rows: Sequence[AttentionTiming]) -> Table:
    """Vectorised attention compared with the plain loop."""
    return Table(
        title="Attention, milliseconds a frame",
        columns=("rays per subject", "boxes", "subjects", "vectorised", "plain loop", "times faster"),
        rows=tuple(
            (
                str(row.rays_per_subject),
                str(row.boxes),
                str(row.subjects),
                f"{row.vectorised_ms:.2f}",
                f"{row.plain_ms:.1f}",
                f"{row.times_faster:.0f}",
            )
            for row in rows
        ),
        words=0,
    )


def speed_table(clip: str, threads: int, rows: Sequence[Speed], notes: Sequence[str] = ()) -> Table:
    """Matching alone, and the pipeline."""
    baseline = next(row for row in rows if row.what == BASELINE)
    return Table(
        title=f"Frames a second on {clip}, one process with {threads} threads",
        columns=("configuration", "match ms", "frames/s", "ratio", "CPU ms", "known", "error px", "off"),
        rows=tuple(
            (
                row.what,
                _ms(row.match_ms),
                f"{row.fps:.1f}",
                f"{row.fps / baseline.fps:.2f}",
                f"{row.cpu_ms:.0f}",
                *_quality(row.stereo),
            )
            for row in rows
        ),
        words=1,
        notes=(
            "From images and masks in memory to attention: frames/s of the whole pipeline, and CPU ms a frame over all "
            f"threads. Ratio: frames/s over those of {BASELINE}. Rows without models have no head detector, head pose "
            "and gaze. All rows are measured in turn, three times; the best of three counts.",
            "Known: share of the pixels of the image with a true disparity that got one. Errors are over the known "
            f"pixels: the median, and the share of those that are off by more than {OFF_PX:g} px.",
            *notes,
        ),
    )


def _quality(quality: StereoQuality | None) -> tuple[str, str, str]:
    if quality is None:
        return UNKNOWN, UNKNOWN, UNKNOWN
    return f"{quality.known_share:.1%}", f"{quality.median_error_px:.3f}", f"{quality.off_share:.1%}"


def _ms(pair: tuple[float, float] | None) -> str:
    return UNKNOWN if pair is None else f"{pair[0]:.1f} / {pair[1]:.1f}"


def _kilobytes(size: float | None) -> str:
    return UNKNOWN if size is None else f"{size / 1e3:.0f}"
