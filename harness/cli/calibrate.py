"""``vfoa calibrate``: a stereo pair from pictures of a board."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from harness.adapters.stereo_views import Views
    from harness.calibration.boards import Board

LAYOUT = (
    "How the views lie in the files, as a manifest of stereo_folder says it: images, images_side_by_side, video ..."
)


def calibrate(
    folder: Annotated[Path, typer.Argument(metavar="PICTURES", help="The folder of the pictures or videos.")],
    columns: Annotated[int, typer.Option(min=2, help="Chessboard: inner corners along it. ChArUco: squares.")],
    rows: Annotated[int, typer.Option(min=2, help="The same across it.")],
    square_mm: Annotated[float, typer.Option(min=0.001, help="Side of a square.")],
    marker_mm: Annotated[float | None, typer.Option(min=0.001, help="ChArUco: side of a marker.")] = None,
    dictionary: Annotated[str, typer.Option(help="ChArUco: OpenCV's name of the markers.")] = "DICT_5X5_100",
    legacy: Annotated[bool, typer.Option("--legacy", help="ChArUco: printed by OpenCV before 4.6.")] = False,
    left: Annotated[str | None, typer.Option(help="Left pictures: a folder, a glob or a pattern; or a video.")] = None,
    right: Annotated[str | None, typer.Option(help="Right pictures; left*, right* where neither is given.")] = None,
    both: Annotated[str | None, typer.Option(help="Pictures, or a video, that hold both views.")] = None,
    layout: Annotated[str, typer.Option(help=LAYOUT)] = "images",
    every: Annotated[int, typer.Option(min=1, help="Use each so many-th frame of a video.")] = 1,
    max_edge_px: Annotated[float, typer.Option(min=1, help="Wider edges of the board are blurred.")] = 4.0,
    out: Annotated[Path, typer.Option(help="The file to write, .yml or .yaml.")] = Path("stereo.yml"),
) -> None:
    """Calibrate two cameras from pictures of a chessboard or a ChArUco board (--marker-mm).

    Says which pairs were not used, and why. Writes the file that stereo_folder reads, and a rectified pair to look at.
    """
    from harness.adapters.calibration_files.read import read_cameras
    from harness.adapters.rectification import optics
    from harness.calibration.files import write_calibration, write_preview
    from harness.calibration.pictures import Pictures
    from harness.calibration.preview import rectified_preview
    from harness.calibration.solve import solve
    from harness.calibration.views import find_views

    _check_name(out)
    if left is right is both is None:
        left, right = "left*", "right*"
    views = _views(folder, {"layout": layout, "left": left, "right": right, "both": both})
    for note in views.notes:
        typer.echo(note)
    pictures = Pictures(views, every)
    seen, unseen = find_views(pictures, _board(columns, rows, square_mm, marker_mm, dictionary, legacy), max_edge_px)
    for each in sorted((*pictures.dropped, *unseen), key=lambda each: each.number):
        typer.echo(f"frame {each.number} dropped: {each.reason}")
    found = solve(seen, pictures.size_px)
    for each in found.dropped:
        typer.echo(f"frame {each.number} dropped: {each.reason}")
    for number, error in found.errors.items():
        typer.echo(f"frame {number}: RMS {error.rms_px:.3f} px, epipolar error {error.epipolar_px:.3f} px")
    write_calibration(out, found)
    shown = next(iter(found.errors))
    preview = out.with_suffix(".png")
    rectified = optics(read_cameras([out], lambda: pictures.size_px))
    write_preview(preview, rectified_preview(rectified, *views.read(shown)))
    typer.echo(f"{preview}: frame {shown}, rectified")
    errors = f"RMS {found.rms_px:.3f} px, mean epipolar error {found.epipolar_px:.3f} px"
    typer.echo(f"{out}: {len(found.errors)} pairs, {errors}, baseline {rectified.calibration.baseline_m:.4f} m")
    typer.echo(f"next: look at {preview}: the same thing must lie on the same row on both sides")
    typer.echo(f"next: vfoa clips add PATH --calibration {out}")


def _check_name(out: Path) -> None:
    """What is written is YAML, and a calibration is told by its suffix."""
    from vfoa.errors import VfoaError

    if out.suffix.lower() not in (".yml", ".yaml"):
        raise VfoaError(f"--out {out}: found the suffix {out.suffix!r}; expected .yml or .yaml")


def _views(folder: Path, files: dict[str, str | None]) -> Views:
    from harness.adapters.view_files import ViewFiles
    from harness.config_errors import parse

    return parse(ViewFiles, files, "calibrate").views(folder)


def _board(columns: int, rows: int, square_mm: float, marker_mm: float | None, dictionary: str, legacy: bool) -> Board:
    from harness.calibration.boards import CharucoBoard, Chessboard

    square_m = square_mm / 1000
    if marker_mm is None:
        return Chessboard(columns=columns, rows=rows, square_m=square_m)
    return CharucoBoard(
        columns=columns,
        rows=rows,
        square_m=square_m,
        marker_m=marker_mm / 1000,
        dictionary=dictionary,
        is_legacy=legacy,
    )
