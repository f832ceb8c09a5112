"""``vfoa calibrate``: a stereo pair from pictures of a chessboard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def calibrate(
    folder: Annotated[Path, typer.Argument(help="The folder of the pictures.")],
    columns: Annotated[int, typer.Option(min=2, help="Inner corners along the board.")],
    rows: Annotated[int, typer.Option(min=2, help="Inner corners across the board.")],
    square_mm: Annotated[float, typer.Option(min=0.001, help="Side of a square.")],
    left: Annotated[str, typer.Option(help="Left pictures: a folder, a glob or a pattern.")] = "left*",
    right: Annotated[str, typer.Option(help="Right pictures.")] = "right*",
    out: Annotated[Path, typer.Option(help="The file to write.")] = Path("stereo.yml"),
) -> None:
    """Calibrate two cameras from pictures of a chessboard, and write the file that stereo_folder reads."""
    from harness.adapters.calibration_files.read import read_cameras
    from harness.adapters.rectification import optics
    from harness.calibration.corners import Board, find_views
    from harness.calibration.files import write_calibration, write_preview
    from harness.calibration.pictures import picture_pairs
    from harness.calibration.preview import rectified_preview
    from harness.calibration.solve import solve

    pairs, size_px = picture_pairs(folder, left, right)
    board = Board(columns=columns, rows=rows, square_m=square_mm / 1000)
    views, unseen = find_views(pairs, board)
    for each in unseen:
        typer.echo(f"frame {each.number} dropped: {each.reason}")
    found = solve(views, board, size_px)
    for each in found.dropped:
        typer.echo(f"frame {each.number} dropped: {each.reason}")
    for number, error in found.epipolar_px.items():
        typer.echo(f"frame {number}: epipolar error {error:.3f} px")
    write_calibration(out, found)
    _, first_left, first_right = next(picture_pairs(folder, left, right)[0])
    preview = out.with_suffix(".png")
    rectified = optics(read_cameras([out], lambda: size_px))
    write_preview(preview, rectified_preview(rectified, first_left, first_right))
    typer.echo(f"{preview}: the first pair, rectified")
    typer.echo(f"{out}: {len(found.epipolar_px)} pairs, RMS {found.rms_px:.3f} px")
