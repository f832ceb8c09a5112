"""The rectified images of a clip as files: what other programs need to make masks, faces, disparity or answers for it.

FOLDER/
    left/00001.png      by the clip's own frame numbers
    right/00001.png     on demand
    times.csv           the time of each frame, seconds
    calib.txt           the rectified pair, in Middlebury's format
    K.txt               in its place, of a clip without right images: the camera's matrix
    calib/00001.txt     in its place, one for each frame, where the frames are of several cameras (KITTI's)
FILM.mp4                or the left images alone, each at its time in the clip
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import cv2

from harness.files.io import atomic_write, check_new, new_folder, replacing
from harness.sources import Clip, LeftClip
from harness.sources.media.film import state_colours
from harness.sources.media.images import encode_rgb
from vfoa.errors import VfoaError
from vfoa.types import Image, StereoFrame, StereoRig

_JPEG_QUALITY = 95
_H264 = {"crf": "16", "preset": "veryfast"}
_TICK_S = Fraction(1, 90_000)
"""What times in films are multiples of."""
_WRITERS = 4
"""Threads that compress images, while one reads: films and recordings are decoded in order."""


def export_images(
    clip: Clip,
    folder: Path,
    frames: Sequence[int],
    *,
    as_jpeg: bool = False,
    with_right: bool = False,
    progress: Callable[[], None] = lambda: None,
) -> None:
    """Write the images of some frames, their times and the camera to a new folder; ``progress`` is called after each.

    Raises
    ------
    VfoaError
        If the folder has something in it, a frame cannot be read, or a right image is asked for and there is none. Then
        nothing is written.
    """
    pending, suffix = deque[Future[None]](), ".jpg" if as_jpeg else ".png"
    cameras, times_ns = dict[int, str](), dict[int, int]()
    with new_folder(folder) as draft, ThreadPoolExecutor(_WRITERS) as pool:
        for number in frames:
            frame = clip.frame(number)
            for view, image in _views(frame, with_right=with_right):
                (draft / view).mkdir(exist_ok=True)
                pending.append(pool.submit(_write, draft / view / f"{number:05d}{suffix}", image))
            cameras[number] = _camera(frame.rig) if frame.right is None else _pair(frame.rig)
            times_ns[number] = frame.time_ns
            while len(pending) > 2 * _WRITERS:
                pending.popleft().result()
            progress()
        for each in pending:
            each.result()
        atomic_write(draft / "times.csv", _times(times_ns))
        name = "K" if frame.right is None else "calib"
        if len({*cameras.values()}) == 1:
            atomic_write(draft / f"{name}.txt", cameras[frames[0]])
        else:
            for number, text in cameras.items():
                atomic_write(draft / name / f"{number:05d}.txt", text)


def export_film(clip: Clip, path: Path, frames: Sequence[int], *, progress: Callable[[], None] = lambda: None) -> None:
    """Write a film (H.264) of the left images of some frames, which begins with the first of them.

    A film has an even number of rows and columns: the last ones are repeated where the images have not.

    Raises
    ------
    VfoaError
        If the file exists, the frame rate is not known, or a frame cannot be read. Then nothing is written.
    """
    import av

    check_new(path, replace=False)
    if (rate_hz := clip.rate_hz) is None:
        raise VfoaError(
            f"{path}: the clip's frame rate is not known; expected rate_hz in its manifest, under [source], or a folder"
        )
    height, width = _left(clip, frames[0]).shape[:2]
    with replacing(path) as draft, av.open(str(draft), "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=Fraction(rate_hz).limit_denominator(1001), options=_H264)
        stream.codec_context.time_base, stream.pix_fmt = _TICK_S, "yuv420p"
        stream.height, stream.width = height + height % 2, width + width % 2
        state_colours(stream.codec_context)
        begin_ns = clip.time_ns(frames[0])
        for number in frames:
            image = _left(clip, number)
            if image.shape[:2] != (height, width):
                raise VfoaError(
                    f"frame {number} has another size than frame {frames[0]}; expected a folder, not a film"
                )
            even = cv2.copyMakeBorder(image, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
            picture = av.VideoFrame.from_ndarray(even, format="rgb24")
            picture.time_base, picture.pts = _TICK_S, round((clip.time_ns(number) - begin_ns) / (_TICK_S * 10**9))
            film.mux(stream.encode(picture))
            progress()
        film.mux(stream.encode())


def _left(clip: Clip, number: int) -> Image:
    return clip.left(number) if isinstance(clip, LeftClip) else clip.frame(number).left


def _views(frame: StereoFrame, *, with_right: bool) -> Iterator[tuple[str, Image]]:
    yield "left", frame.left
    if with_right:
        if frame.right is None:
            raise VfoaError(f"frame {frame.index}: no right image; expected a clip of two cameras, or no --right")
        yield "right", frame.right


def _write(path: Path, image: Image) -> None:
    options = (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY) if path.suffix == ".jpg" else ()
    path.write_bytes(encode_rgb(image, path.suffix, *options))


def _times(times_ns: Mapping[int, int]) -> str:
    rows = [f"{number},{Decimal(time_ns).scaleb(-9):f}" for number, time_ns in times_ns.items()]
    return "\n".join(["frame,time_s", *rows, ""])


def _pair(rig: StereoRig) -> str:
    """A rectified pair in Middlebury's format, its baseline in mm."""
    left, right = (f"[{rig.fx_px} 0 {cx}; 0 {rig.fy_px} {rig.cy_px}; 0 0 1]" for cx in (rig.cx_px, rig.cx_right_px))
    doffs_px, baseline_mm = rig.cx_right_px - rig.cx_px, 1000 * rig.baseline_m
    size = f"width={rig.width_px}\nheight={rig.height_px}\n"
    return f"cam0={left}\ncam1={right}\ndoffs={doffs_px}\nbaseline={baseline_mm}\n{size}"


def _camera(rig: StereoRig) -> str:
    """A camera matrix, as nine numbers."""
    return "".join(" ".join(map(str, row)) + "\n" for row in rig.camera_matrix.tolist())
