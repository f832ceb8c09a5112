"""The layer of the images: the camera, both views as video, the measured depth, and the masks of each segmentation.

Video is AV1, which the viewer decodes by itself, while it needs an FFmpeg program for H.264. It is also small: 5 kB a
frame of 1024 x 436 pixels where a JPEG of quality 85 takes 92 (25 frames of ``studio_talk``). Safari on Macs without a
decoder of their own for AV1, and the native viewer on Linux ARM, do not decode it: JPEG pictures are shown everywhere.
"""

from __future__ import annotations

import contextlib
import io
import os
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from harness.record import entities
from harness.record.appearance import Colour, Colours
from harness.record.frame_log import FrameLog
from harness.sources.media.film import state_colours
from harness.sources.media.images import encode_rgb
from vfoa.types import Image, Percepts, StereoFrame, StereoRig

if TYPE_CHECKING:
    import av

KEY_FRAME_S = 1.0
"""Seconds between key frames of a video: to show a frame, the viewer decodes from the preceding key frame."""

IMAGE_PLANE_M = 0.25
_JPEG_QUALITY = 85
_OPACITY = 0.35
MOST_COLOURS = 252
"""Most colours of masks in one picture, which has 256; a multiple of the number of different colours of names."""
LEAST_SIDE_PX = 64
"""Smaller images are not accepted by the encoder."""

_QUALITY = 27
"""Constant rate factor, 0 (best) to 63: no artefact is visible at the size of the viewer's panes."""
_ROWS, _COLUMNS = 4, 2
"""Images are continued at their lower and right border to multiples of these.

The codec takes even sizes only, and Rerun's native viewer draws one of the two planes of colour two rows too low where
half of the height is odd.
"""
_PRESET = 12
"""Speed, 0 (slowest) to 13. 13 is no faster."""


def key_frame_every(rate_hz: float | None) -> int:
    """Number of frames of a clip from one key frame to the next."""
    return int(np.clip(round(KEY_FRAME_S * (rate_hz or 25)), 5, 60))


class ImageLog:
    """Logs the images of a clip: AV1 videos, or JPEG pictures if these are wanted, or too small for the encoder."""

    def __init__(self, log: FrameLog, rate_hz: float | None, *, jpeg: bool) -> None:
        self._log, self._jpeg = log, jpeg
        self._key_every = key_frame_every(rate_hz)
        self._videos: dict[str, VideoEncoder] = {}
        self._times: dict[tuple[str, int], tuple[int, int]] = {}

    def add(self, frame: StereoFrame) -> bool:
        """Log the images of a frame; False if they are logged already."""
        log = self._log
        if not log.begin(frame.index, frame.time_ns):
            return False
        rig = frame.rig
        log.keep(entities.CAMERA, lambda: _pinhole(rig), key=rig, static=False)
        self._image(entities.IMAGE, frame.left, frame)
        if frame.right is not None:
            self._image(entities.RIGHT, _half(frame.right), frame)
        if frame.depth_m is not None:
            # millimetres: 0 is unknown, and larger depths than 65.5 m become 65.5 m
            millimetres = np.nan_to_num(np.clip(np.rint(1000 * frame.depth_m), 1, 65535), nan=0).astype(np.uint16)
            blob, media_type = [png(millimetres)], ["image/png"]
            log.row(entities.MEASURED_DEPTH, rr.EncodedDepthImage, blob=blob, media_type=media_type, meter=[1000])
        log.end()
        return True

    def close(self) -> None:
        """Log the images that the encoders still hold."""
        for path, video in self._videos.items():
            self._packets(path, video.finish())

    def _image(self, path: str, image: Image, frame: StereoFrame) -> None:
        if self._jpeg or min(image.shape[:2]) < LEAST_SIDE_PX:
            self._log.row(path, rr.EncodedImage, blob=[_jpeg(image)], media_type=["image/jpeg"])
            return
        if path not in self._videos:
            height, width = image.shape[:2]
            self._videos[path] = VideoEncoder(width, height, self._key_every)
            self._log.keep(path, lambda: rr.VideoStream(codec=rr.VideoCodec.AV1), key="codec")
        video = self._videos[path]
        self._times[path, video.count] = frame.index, frame.time_ns
        self._packets(path, video.encode(image))

    def _packets(self, path: str, packets: Iterable[tuple[int, bytes]]) -> None:
        for position, packet in packets:
            self._log.event(path, rr.VideoStream, at=self._times.pop((path, position)), sample=[packet])


def log_masks(log: FrameLog, segmentation: str, percepts: Percepts, names: Mapping[int, str], colours: Colours) -> None:
    """Log the masks in one colour per name, as a picture in steps of two pixels.

    A name keeps its colour when the ids of instances change. Stuff that is no target (a wall, a table) is transparent,
    since it would tint the whole image.
    """
    instances = percepts.instances
    class_of_id = np.zeros(max((instance.id for instance in instances.instances), default=0) + 1, dtype=np.uint16)
    for instance in instances.instances:
        if instance.is_thing or instance.id in names:
            class_of_id[instance.id] = colours.class_of(names.get(instance.id, instance.label))
    painting = np.where(class_of_id, (class_of_id - 1) % MOST_COLOURS + 1, 0).astype(np.uint16)
    palette = list(colours.known.values())[:MOST_COLOURS]
    log.row(
        entities.masks(segmentation),
        rr.EncodedImage,
        blob=[painted(painting[instances.ids[::2, ::2]], instances.ids.shape, palette)],
        media_type=["image/png"],
        opacity=[_OPACITY],
        draw_order=[0],
    )


def painted(classes: NDArray[np.uint16], shape: tuple[int, int], colours: Sequence[Colour]) -> bytes:
    """A PNG of this shape from every second row and column of its classes: 0 is transparent, k has colour ``k - 1``."""
    from PIL import Image as Picture

    height, width = shape
    side_by_side = (classes * 257).view(np.uint8)  # two pixels at once: 257 is 1 in both bytes
    picture = Picture.fromarray(side_by_side.repeat(2, axis=0)[:height, :width], mode="P")
    picture.putpalette([0, 0, 0, *(value for colour in colours for value in colour)])
    file = io.BytesIO()
    # areas of one colour: run lengths alone take half the time, and a fifth fewer bytes
    picture.save(file, "PNG", transparency=0, compress_type=zlib.Z_RLE)
    return file.getvalue()


def class_context(known: Mapping[str, Colour]) -> rr.AnnotationContext:
    """Names and colours of the classes, in the order of :attr:`harness.record.appearance.Colours.known`."""
    classes = [(number, name, (*colour, 255)) for number, (name, colour) in enumerate(known.items(), start=1)]
    return rr.AnnotationContext([(0, "", (0, 0, 0, 0)), *classes])


def png(image: NDArray[np.uint16] | Image) -> bytes:
    """Encode an image as PNG. Run lengths alone make disparities a tenth smaller than the default, in 1 ms more."""
    options = [cv2.IMWRITE_PNG_COMPRESSION, 2, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    return cv2.imencode(".png", image, options)[1].tobytes()


def _half(image: Image) -> Image:
    return np.asarray(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _pinhole(rig: StereoRig) -> rr.Pinhole:
    return rr.Pinhole(
        image_from_camera=rig.camera_matrix,
        resolution=(rig.width_px, rig.height_px),
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=IMAGE_PLANE_M,
    )


def _jpeg(image: Image) -> bytes:
    # OpenCV's encoder writes the same bytes as Rerun's own path through Pillow, several times faster
    return encode_rgb(image, ".jpg", cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY)


class VideoEncoder:
    """Encodes images of one size, with a key frame at the first and at every ``key_every``-th image.

    The same images give the same bytes, since it computes with one thread. A packet comes up to twelve images after
    its own: without that delay (``pred-struct=1``), SVT-AV1 3.1 to 4.1 can wait for itself without end, on a busy
    machine once in about 10,000 images of 96 x 64 pixels (none in 347,000 with it), and takes a tenth more bytes.
    """

    def __init__(self, width_px: int, height_px: int, key_every: int) -> None:
        import av

        os.environ.setdefault("SVT_LOG", "1")  # the encoder would write its settings to the terminal
        codec: av.VideoCodecContext = av.CodecContext.create("libsvtav1", "w")
        codec.width, codec.height = width_px + -width_px % _COLUMNS, height_px + -height_px % _ROWS
        codec.pix_fmt = "yuv420p"
        state_colours(codec)
        codec.time_base = Fraction(1, 25)  # only the order counts
        codec.gop_size = key_every
        codec.options = {
            "preset": str(_PRESET),
            "crf": str(_QUALITY),
            "svtav1-params": f"pred-struct=2:hierarchical-levels=2:lookahead=0:lp=1:keyint={key_every}:scd=0",
        }
        open_without_real_time(codec)
        self._codec = codec
        self.count = 0

    def encode(self, image: Image) -> Iterator[tuple[int, bytes]]:
        """Add an image; yield the packets that are ready, each with the position of its image in the stream."""
        import av

        rows, columns = -image.shape[0] % _ROWS, -image.shape[1] % _COLUMNS
        if rows or columns:
            image = np.pad(image, ((0, rows), (0, columns), (0, 0)), mode="edge")
        # a copy, because the encoder reads some bytes past the end of an image
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
        frame.pts = self.count
        self.count += 1
        yield from self._packets(frame)

    def finish(self) -> Iterator[tuple[int, bytes]]:
        """Yield the packets of the images that are not yet encoded."""
        if self.count:
            yield from self._packets(None)

    def _packets(self, frame: av.VideoFrame | None) -> Iterator[tuple[int, bytes]]:
        for packet in self._codec.encode(frame):
            assert packet.pts is not None
            yield packet.pts, bytes(packet)


def open_without_real_time(codec: av.VideoCodecContext) -> None:
    """Open the encoder, and give its threads and this one the scheduling that this one had before.

    For root, SVT-AV1 makes them all real-time threads. They, and every process started later, would take the processor
    from everything else on the machine.
    """
    if not hasattr(os, "sched_setscheduler"):
        codec.open()
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    codec.open()
    for thread in map(int, os.listdir("/proc/self/task")):
        with contextlib.suppress(ProcessLookupError):
            if os.sched_getscheduler(thread) != policy:
                os.sched_setscheduler(thread, policy, parameters)


def decoded(packets: Sequence[bytes]) -> Image:
    """The image of the last of these packets, which begin with a key frame and follow each other."""
    import av

    codec: Any = av.CodecContext.create("libdav1d", "r")
    shown = [frame for packet in packets for frame in codec.decode(av.Packet(packet))]
    shown += codec.decode(None)
    return np.asarray(shown[-1].to_ndarray(format="rgb24"), dtype=np.uint8)
