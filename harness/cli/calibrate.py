"""``vfoa calibrate``: a stereo pair from pictures of a board."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import Replace
from harness.cli.terminal import say
from vfoa.errors import VfoaError
from vfoa.validation import parse

if TYPE_CHECKING:
    from harness.sources.calibrate.solve import StereoCalibration

LAYOUT = "Layout of the views in the files, as in a manifest of stereo_folder: images, images_side_by_side, video ..."


def calibrate(
    folder: Annotated[
        Path,
        typer.Argument(metavar="PICTURES", help="The folder of the pictures or videos."),
    ],
    square_mm: Annotated[float, typer.Option(metavar="MM", min=0.001, help="Side of a square, millimetres.")],
    columns: Annotated[
        int, typer.Option(metavar="N", min=2, help="Columns: inner corners of a chessboard, squares of ChArUco.")
    ],
    rows: Annotated[int, typer.Option(metavar="N", min=2, help="Rows, counted in the same way.")],
    marker_mm: Annotated[
        float | None, typer.Option(metavar="MM", min=0.001, help="ChArUco: side of a marker, millimetres.")
    ] = None,
    dictionary: Annotated[
        str, typer.Option(metavar="NAME", help="ChArUco: OpenCV's name of the marker dictionary.")
    ] = "DICT_5X5_100",
    left: Annotated[
        str | None, typer.Option(metavar="FILES", help="Left pictures: a folder, a glob or a pattern; or a video.")
    ] = None,
    right: Annotated[
        str | None, typer.Option(metavar="FILES", help="Right pictures. Default: sides by names, as in clips add.")
    ] = None,
    both: Annotated[
        str | None, typer.Option(metavar="FILES", help="Pictures, or a video, that hold both views.")
    ] = None,
    layout: Annotated[str, typer.Option(metavar="LAYOUT", help=LAYOUT)] = "images",
    every: Annotated[int, typer.Option(metavar="N", min=1, help="Use every Nth frame of a video.")] = 1,
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write, .yml or .yaml.")] = Path("stereo.yml"),
    replace: Replace = False,
) -> None:
    """Calibrate two cameras from pictures of a chessboard or a ChArUco board (--marker-mm).

    Prints the pairs that were not used, with the reason. Writes the file that stereo_folder reads, and a rectified pair
    to look at.
    """
    from harness.files.io import check_new, write_together
    from harness.sources.calibrate.solve import (
        format_calibration,
        rectified_preview,
        solve,
    )
    from harness.sources.calibrate.views import charuco_board, chessboard, find_views
    from harness.sources.media.images import encode_rgb
    from harness.sources.rectification import Rectifier
    from harness.sources.stereo_pairs import PairFiles

    if out.suffix.lower() not in (".yml", ".yaml"):  # calibrations are recognised by their suffix
        raise VfoaError(f"--out {out}: found the suffix {out.suffix!r}; expected .yml or .yaml")
    check_new(out, replace=replace, hint=", or another --out")
    if marker_mm is None:
        board = chessboard(columns, rows, square_mm / 1000)
    else:
        board = charuco_board(columns, rows, square_mm / 1000, marker_mm / 1000, dictionary)
    preview = out.with_suffix(".png")
    of_user = () if out.exists() else folder.rglob("*")  # beside a calibration, the picture of its name is the preview
    check_new(preview, replace=replace, hint=", or another --out", inputs=of_user)
    if left is right is both is None:
        left, right = _sides(folder)
    files = {"layout": layout, "left": left, "right": right, "both": both}
    views = parse(PairFiles, files, "calibrate").views(folder)
    for note in views.notes:
        say(note)
    seen, unseen, size_px = find_views(views.frames[::every], views.read, board)
    for number, reason in unseen.items():
        say(f"frame {number} dropped: {reason}")
    calibration = solve(seen, size_px)
    for number, reason in calibration.dropped.items():
        say(f"frame {number} dropped: {reason}")
    for number, error in calibration.errors.items():
        say(f"frame {number}: RMS {error.rms_px:.3f} px, epipolar error {error.epipolar_px:.3f} px")
    rectifier = Rectifier(calibration.rectification)
    shown = next(iter(calibration.errors))
    picture = rectified_preview(rectifier, *views.read(shown))
    write_together({out: format_calibration(calibration), preview: encode_rgb(picture, ".png")})
    _print_result(out, preview, shown, calibration, rectifier.calibration.baseline_m)


def _print_result(out: Path, preview: Path, shown: int, calibration: StereoCalibration, baseline_m: float) -> None:
    from harness.clips.camera import MAX_BASELINE_M, MIN_BASELINE_M

    say(f"{preview}: frame {shown}, rectified")
    errors = f"RMS {calibration.rms_px:.3f} px, mean epipolar error {calibration.epipolar_px:.3f} px"
    say(f"{out}: {len(calibration.errors)} pairs, {errors}, baseline {baseline_m:.4f} m")
    if not MIN_BASELINE_M <= baseline_m <= MAX_BASELINE_M:
        say(
            f"next: measure a square of the board: {baseline_m:.4f} m is an unusual distance of two cameras "
            f"({MIN_BASELINE_M:g} to {MAX_BASELINE_M:g} m); if --square-mm was wrong, calibrate again with --replace"
        )
    say(f"next: look at {preview}: the same object must be on the same row on both sides")
    say(f"next: vfoa clips add PATH --calibration {out}")


def _sides(folder: Path) -> tuple[str, str]:
    """The only two sides of pictures in the folder, by their names; else ``left*`` and ``right*``."""
    from harness.sources.stereo_layouts import find_layouts

    sources = [layout.source for layout in find_layouts(folder) if layout.source["layout"] == "images"]
    return (sources[0]["left"], sources[0]["right"]) if len(sources) == 1 else ("left*", "right*")
