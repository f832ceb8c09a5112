"""Find the topics of the colour image and its depth, as named by RealSense, Azure Kinect, OAK-D, ZED and others."""

from __future__ import annotations

from collections.abc import Iterable

from harness.sources.recordings.depth_images import may_be_depth
from harness.sources.recordings.topics import Topic, listed, named
from vfoa.errors import VfoaError

_ALIGNED = ("aligned_depth_to", "depth_to_rgb", "depth_to_color", "depth_registered", "registered", "depth_aligned")
"""Names that drivers give to depth in the colour camera's image."""

_REALSENSE_SDK = "/device_"
_COLOUR = ("color", "colour", "rgb")
_NO_COLOUR = ("infra", "/ir", "confidence", "thermal", "disparity", "rgb_to_depth", "mask")
_TRANSPORTS = ("/compressedDepth", "/compressed", "/ffmpeg", "/theora", "/h264", "/h265", "/video")


def depth_topics(topics: Iterable[Topic]) -> list[Topic]:
    """Return all topics that may be depth, by name."""
    images = [topic for topic in topics if topic.is_image and topic.places]
    return sorted((each for each in images if may_be_depth(each.name, each.sight)), key=lambda each: each.name)


def is_aligned(depth: Topic, colour: Topic) -> bool:
    """Whether depth is in the colour camera's image: by its topic's name, or in the same coordinate frame.

    If both images give a size and the sizes differ, it is not.
    """
    if has_no_frames(depth):
        return False
    sizes = {each.sight.size_px for each in (depth, colour) if each.sight is not None and each.sight.size_px}
    if len(sizes) > 1:
        return False
    if any(word in depth.name.lower() for word in _ALIGNED):
        return True
    return bool(depth.frame_id) and depth.frame_id == colour.frame_id


def has_no_frames(topic: Topic) -> bool:
    """Whether a topic is of RealSense's SDK, which never aligns depth, and names no coordinate frames."""
    return topic.name.startswith(_REALSENSE_SDK)


def find_colour_and_depth(
    topics: Iterable[Topic], colour: str | None, depth: str | None, where: str
) -> tuple[Topic, Topic]:
    """Return the colour and the depth topic: as named, else the only aligned depth, else the only depth.

    Raises
    ------
    VfoaError
        If one is missing, or there are several candidates: the message lists them and says how to choose.
    """
    everything = list(topics)
    images = sorted((topic for topic in everything if topic.is_image), key=lambda topic: topic.name)
    depths = [named(images, depth, "depth", where)] if depth is not None else _of_streams(depth_topics(everything))
    if not depths:
        raise VfoaError(f"{where}: no depth topic; say depth = in [source]: found {listed(images)}")
    colours = [named(images, colour, "left", where)] if colour is not None else _colours(images, depths)
    if not colours:
        raise VfoaError(
            f"{where}: no colour topic beside {listed(depths)}; say left = in [source]: found {listed(images)}"
        )
    pairs = [(one, other) for other in depths for one in colours]
    for fitting in ([pair for pair in pairs if is_aligned(pair[1], pair[0])], pairs):
        best = _nearest(fitting)
        if len(best) == 1:
            return best[0]
        if best:
            raise VfoaError(
                f"{where}: several colour and depth topics; say left = (colour) and depth = in [source]: "
                f"found {listed(colours)} and {listed(depths)}"
            )
    raise AssertionError("there is a pair")


def _colours(images: list[Topic], depths: list[Topic]) -> list[Topic]:
    """Images in colour by name; if none has such a name, images of any other name."""
    others = [each for each in images if each.places and each not in depths and not may_be_depth(each.name, each.sight)]
    others = [each for each in others if not any(word in each.name.lower() for word in _NO_COLOUR)]
    by_name = [each for each in others if any(word in each.name.lower() for word in _COLOUR)]
    return _of_streams(by_name or [each for each in others if "depth" not in each.name.lower()])


def _of_streams(topics: list[Topic]) -> list[Topic]:
    """One topic per stream: the one with the most messages; of equal ones, the raw one."""
    streams: dict[str, list[Topic]] = {}
    for topic in topics:
        streams.setdefault(_stream(topic.name), []).append(topic)
    return [max(each, key=lambda topic: (len(topic.places), topic.type.kind == "raw")) for each in streams.values()]


def _stream(name: str) -> str:
    for transport in _TRANSPORTS:
        name = name.removesuffix(transport)
    return name


def _nearest(pairs: list[tuple[Topic, Topic]]) -> list[tuple[Topic, Topic]]:
    """The pairs that fit best: same frame, similar names, both rectified or not, in colour, no left or right side."""

    def rank(pair: tuple[Topic, Topic]) -> tuple[bool, int, bool, bool, bool]:
        colour, depth = pair
        parts = zip(colour.name.split("/"), depth.name.split("/"), strict=False)
        common = next((place for place, (one, other) in enumerate(parts) if one != other), 0)
        is_rectified = "rect" in depth.name or depth.name.endswith("depth_registered")  # ZED's name
        is_gray = "gray" in colour.name or (colour.sight is not None and colour.sight.form in ("mono8", "8UC1"))
        is_of_side = any(side in colour.name for side in ("left", "right"))
        same_frame = bool(depth.frame_id) and colour.frame_id == depth.frame_id
        return same_frame, common, ("rect" in colour.name) == is_rectified, not is_gray, not is_of_side

    highest = max(map(rank, pairs), default=None)
    return [pair for pair in pairs if rank(pair) == highest]
