"""Which calibration topic of a recording is that of an image."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from harness.sources.recordings.topics import Topic, listed, named
from vfoa.errors import VfoaError


def find_camera(topics: Iterable[Topic], images: Sequence[Topic], named_topic: str | None, where: str) -> Topic:
    """Return a calibration topic: the named one, or the only one in the nearest common namespace of an image topic.

    Of several there, it is the one whose words are most those of the image's name: ``left_camera_info`` of
    ``left_image``. ``images`` are tried in order.

    Raises
    ------
    VfoaError
        If there is none, or more than one.
    """
    cameras = sorted((topic for topic in topics if topic.type.kind == "calibration"), key=lambda topic: topic.name)
    if named_topic is not None:
        return named(cameras, named_topic, "calibration", where)
    for image in images:
        for namespace in _namespaces(image.name):
            places = (namespace, f"{namespace}/info")  # RealSense's SDK writes them to the second
            same_place = [camera for camera in cameras if camera.name.rpartition("/")[0] in places]
            sent = [camera for camera in same_place if camera.places]
            same_place = _with_words_of(image, sent or same_place, namespace)
            if len(same_place) == 1:
                return same_place[0]
    raise VfoaError(
        f"{where}: no single calibration topic belongs to {images[0].name}; found {listed(cameras)}; expected "
        "left_info, right_info or depth_info = in [source], or --calibration FILE of a pair, or --fx --cx --cy (or "
        "--fov-deg), and --baseline of a pair ([source.camera])"
    )


def _namespaces(name: str) -> Iterator[str]:
    """Where a topic's calibration may be: below its own name, beside it, and in the namespaces above."""
    yield name
    name = name.rpartition("/")[0]
    yield name
    while "/" in name.strip("/"):
        name = name.rpartition("/")[0]
        yield name


_OF_ANY_CAMERA = {"camera", "info", "image", "raw", "calibration", ""}


def words_of(name: str) -> set[str]:
    """The words of a topic's name that tell it from others."""
    return {*re.split("[/_]", name)} - _OF_ANY_CAMERA


def _with_words_of(image: Topic, cameras: list[Topic], namespace: str) -> list[Topic]:
    """Those that share the most words with an image's name below a namespace, and of these have the fewest others.

    So ``left/camera_info_rect`` is that of ``left/image_rect``, and ``left/camera_info`` that of ``left/image_raw``.
    """
    own, *others = (words_of(topic.name.removeprefix(namespace)) for topic in (image, *cameras))
    ranks = [(len(words & own), -len(words - own)) for words in others]
    return [camera for camera, rank in zip(cameras, ranks, strict=True) if rank == max(ranks)]
