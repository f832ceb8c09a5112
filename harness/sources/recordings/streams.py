"""Which topics of a recording make its frames: a pair, colour and depth, or a pair with depth."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from contextlib import suppress
from functools import partial
from itertools import takewhile
from typing import Generic, NamedTuple, TypeVar

from harness.files.groups import grouped
from harness.sources.media.frame_files import pair_names
from harness.sources.recordings.calibration_topics import words_of
from harness.sources.recordings.messages import READ
from harness.sources.recordings.pixels import DEPTH_FORMS, INFRARED, may_be_depth
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.recordings.topics import Topic, listed, named
from vfoa.errors import VfoaError

Item = TypeVar("Item")


class Sides(NamedTuple, Generic[Item]):
    """What makes a frame: of a left image and a right image, of a left image and depth, or of all three."""

    left: Item
    right: Item | None
    depth: Item | None

    @property
    def is_packed(self) -> bool:
        """Whether each image has both views."""
        return self.right is self.left


Streams = Sides[Topic]


def find_streams(topics: Collection[Topic], settings: RecordingSettings, where: str) -> Streams:
    """Return the named topics; else the only pair, with the depth of its left camera; else colour and depth.

    Colour with aligned depth is preferred to a pair in infrared, in which a depth camera's pattern may be seen.

    Raises
    ------
    VfoaError
        If there are none, or several candidates.
    """
    if settings.both is not None:
        packed = named((topic for topic in topics if topic.is_image), settings.both, "both", where)
        return Sides(packed, packed, None)
    is_named = settings.left is not None or settings.right is not None or settings.depth is not None
    of_zed = [topic for topic in topics if topic.type.is_zed and topic.is_image and not is_named]
    if len(of_zed) == 1:
        return Sides(of_zed[0], of_zed[0], None)
    if of_zed:
        raise VfoaError(f"{where}: {len(of_zed)} cameras; expected both = TOPIC in [source]: found {listed(of_zed)}")
    if settings.depth is not None and settings.right is None:
        left, depth = _find_colour_and_depth(topics, settings.left, settings.depth, where)
        return Sides(left, None, depth)
    try:
        left, right = _find_pair(topics, settings.left, settings.right, where)
    except VfoaError as error:
        if settings.right is not None or not _depth_topics(topics):
            raise VfoaError(f"{error}{_unread_depth(topics)}") from None
        left, depth = _find_colour_and_depth(topics, settings.left, None, where)
        return Sides(left, None, depth)
    if settings.left is None and settings.right is None and settings.depth is None and _is_infrared(left):
        with suppress(VfoaError):
            colour, depth = _find_colour_and_depth(topics, None, None, where)
            if is_aligned(depth, colour):
                return Sides(colour, None, depth)
    if settings.depth is not None:
        images = (topic for topic in topics if topic.is_image)
        return Sides(left, right, named(images, settings.depth, "depth", where))
    depths = (topic for topic in _with_messages(_depth_topics(topics)) if topic not in (left, right))  # or 16-bit gray
    own = [topic for topic in depths if is_aligned(topic, left) and topic.frame_id == left.frame_id != ""]
    return Sides(left, right, own[0] if len(own) == 1 else None)


def _unread_depth(topics: Iterable[Topic]) -> str:
    """The end of a message if there is no pair, and topics called depth are in a form that has none; else empty.

    JPEG has lost it.
    """
    headers = {
        topic.name: topic.header for topic in topics if topic.header is not None and "depth" in topic.name.lower()
    }
    if lossy := [name for name, header in headers.items() if re.search("jpe?g", header.form.lower())]:
        return f"; JPEG has lost the depth of {', '.join(lossy)}: record the raw topic, or compressedDepth"
    others = [f"{name} in {header.form!r}" for name, header in headers.items() if not may_be_depth(name, header)]
    return f"; no depth is read of {', '.join(others)}: expected {', '.join(DEPTH_FORMS)} or a PNG" if others else ""


def unused_pairs(topics: Collection[Topic], streams: Streams) -> tuple[str, ...]:
    """A note if the pair was recorded in other ways, too, or other pairs were."""
    images = (topic for topic in _with_messages(topics) if topic.is_image)
    pictures = (topic for topic in images if not may_be_depth(topic.name, topic.header))
    pairs = _pairs(sorted(pictures, key=lambda topic: topic.name))
    if streams.right is None:
        others = [pair[0].name for pair in _best_of_each_rig(pairs)]
        took = "left = and right = in [source] take it instead"
        return tuple(f"a pair was recorded, too: {other}; {took}" for other in others)
    lefts = [left.name for left, _ in pairs]
    chosen = _TRANSPORT.sub("", streams.left.name)
    others = [name for name in dict.fromkeys(_TRANSPORT.sub("", left) for left in lefts) if name != chosen]
    if not others:
        return ()
    return (f"{chosen} is read; recorded, too: {', '.join(others)}; left = and right = in [source] take them instead",)


def unused_depth(topics: Collection[Topic], streams: Streams) -> tuple[str, ...]:
    """A note if the recording has depth that no frame has."""
    others = [topic for topic in _depth_topics(topics) if topic not in streams]
    if streams.depth is not None or not others:
        return ()
    names = ", ".join(topic.name for topic in others)
    return (f"depth was recorded, too, and is not of the left camera: {names}; depth = in [source] takes it instead",)


def instead_of_pair(topics: Collection[Topic]) -> str:
    """The end of a message on a pair that cannot be read: how to read colour with depth, if the recording has them."""
    depths = _of_streams(_depth_topics(topics))
    return f"; or depth = in [source] for colour with depth: {listed(depths)}" if depths else ""


def _find_pair(topics: Iterable[Topic], left: str | None, right: str | None, where: str) -> tuple[Topic, Topic]:
    """Return two image topics: the named ones, or those of the only rig: their names differ in nothing but the side.

    The sides are left and right, else cam0 and cam1, infra1 and infra2 ... (:mod:`harness.sources.media.frame_files`).
    A driver publishes the images of a rig several times: of these, the best are taken (:func:`_best_of_each_rig`).

    Raises
    ------
    VfoaError
        If there are none, a named one is missing, or there are several rigs.
    """
    everything = sorted(topics, key=lambda topic: topic.name)
    images = [topic for topic in everything if topic.is_image]
    if not images:
        if unread := [topic for topic in everything if topic.type.is_unread_image]:
            encodings = ", ".join(dict.fromkeys(topic.type.encoding for topic in unread))
            raise VfoaError(
                f"{where}: images in {encodings}, which is not read; expected {READ}: found {listed(unread)}"
            )
        raise VfoaError(
            f"{where}: no image topics; found {listed(everything)}; expected images or, of bodies without images, "
            "PoseStamped or TransformStamped of each, or /tf (a PoseArray does not name its poses)"
        )
    if left is not None and right is not None:
        return named(images, left, "left", where), named(images, right, "right", where)
    sent = _with_messages(images)
    pairs = _best_of_each_rig(next(filter(None, (_pairs(of, left, right) for of in (_taken(sent), sent, images))), []))
    if len(pairs) != 1:
        raise VfoaError(
            f"{where}: {len(pairs)} pairs of image topics named left and right; say left = and right = in [source] "
            "(--set left=/TOPIC --set right=/TOPIC), or --set both=/TOPIC if one has both views: found "
            f"{listed(images)}"
        )
    return pairs[0]


def _with_messages(topics: Iterable[Topic]) -> list[Topic]:
    """Those that were sent: a recorder lists also what was only advertised."""
    return [topic for topic in topics if topic.places]


_DRAWN = re.compile(
    "[/_](seg|(semantic|segment|instance|label|mask|annot|overlay|detect)[a-z]*|visuali[sz]ation|viz|debug|dbg"
    "|marked|b(ounding_)?box(es)?|heatmap|normals)(?![a-z])"
)
"""Names of images that a simulator labelled, or a program drew on, in lower case, as a pattern."""


def _taken(images: Iterable[Topic], depths: Iterable[Topic] = ()) -> list[Topic]:
    """Pictures that a camera took: neither depth nor what a program drew, whose word no depth has in its name."""
    of_cameras = {word for depth in depths for word in _drawn_words(depth)}
    return [
        topic for topic in images if not may_be_depth(topic.name, topic.header) and _drawn_words(topic) <= of_cameras
    ]


def _drawn_words(topic: Topic) -> set[str]:
    return {match[0] for match in _DRAWN.finditer(f"/{topic.name.lower()}")}


def _pairs(images: Iterable[Topic], left: str | None = None, right: str | None = None) -> list[tuple[Topic, Topic]]:
    """Every two topics whose names differ in nothing but the side, and are these where they are named."""
    by_name = {topic.name: topic for topic in images}
    sides = [(name, name.replace("left", "right")) for name in by_name if "left" in name]
    for ways in (sides, pair_names(by_name, numbered=False)):
        pairs = [
            (by_name[left_name], by_name[right_name])
            for left_name, right_name in ways
            if right_name in by_name and left in (None, left_name) and right in (None, right_name)
        ]
        if pairs:
            return pairs
    return []


def _best_of_each_rig(pairs: Iterable[tuple[Topic, Topic]]) -> list[tuple[Topic, Topic]]:
    """One pair of each rig, whose topics have the same name before the side: rectified, in colour, raw.

    Pairs with a tenth less frames than another one of the rig count less than that.
    """
    rigs = grouped((_rig_of(pair), pair) for pair in pairs)
    return [max(of_rig, key=partial(_worth, max(map(_frames_of, of_rig)))) for of_rig in rigs.values()]


def _worth(most: int, pair: tuple[Topic, Topic]) -> tuple[bool | int, ...]:
    """Rank of a pair among those of its rig, of which one has ``most`` frames; a higher one is better."""
    left, frames = pair[0], _frames_of(pair)
    is_raw = left.type.kind == "raw"
    return frames >= 0.9 * most, left.is_called_rectified, not _is_gray(left), is_raw, frames


def _frames_of(pair: tuple[Topic, Topic]) -> int:
    return min(len(topic.places) for topic in pair)


def _rig_of(pair: tuple[Topic, Topic]) -> str:
    """What the names of both topics begin with."""
    left, right = (topic.name for topic in pair)
    return "".join(letter for letter, _ in takewhile(lambda both: both[0] == both[1], zip(left, right, strict=False)))


def _is_infrared(topic: Topic) -> bool:
    return bool(re.search(INFRARED, topic.name.lower()))


def _is_gray(topic: Topic) -> bool:
    return "gray" in topic.name or (topic.header is not None and topic.header.form in ("mono8", "8UC1"))


_ALIGNED = ("aligned_depth_to", "depth_to_rgb", "depth_to_color", "depth_registered", "registered", "depth_aligned")
"""Names that drivers give to depth in the colour camera's image."""

_REALSENSE_SDK = "/device_"
_COLOUR = ("color", "colour", "rgb")
_NO_COLOUR = re.compile(f"{INFRARED}|confidence|thermal|disparity|rgb_to_depth|mask")
_TRANSPORT = re.compile("/(compressedDepth|compressed|ffmpeg|theora|h264|h265|video)$")


def _depth_topics(topics: Iterable[Topic]) -> list[Topic]:
    """Return all topics that may be depth, by name; those without a time stamp if no other was sent."""
    depths = [topic for topic in topics if topic.is_image and may_be_depth(topic.name, topic.header)]
    return sorted(_with_stamps(depths), key=lambda topic: topic.name)


def _with_stamps(topics: Collection[Topic]) -> list[Topic]:
    """Those that were sent with time stamps; if there are none, those that were sent without, which an error names."""
    return _with_messages(topics) or [topic for topic in topics if topic.unstamped]


def is_aligned(depth: Topic, colour: Topic) -> bool:
    """Whether depth is in the colour camera's image: by its topic's name, or in the same coordinate frame.

    If both images give a size and the sizes differ, it is not.
    """
    if has_no_frames(depth):
        return False
    sizes = {topic.header.size_px for topic in (depth, colour) if topic.header is not None and topic.header.size_px}
    if len(sizes) > 1:
        return False
    if any(word in depth.name.lower() for word in _ALIGNED):
        return True
    return bool(depth.frame_id) and depth.frame_id == colour.frame_id


def has_no_frames(topic: Topic) -> bool:
    """Whether a topic is of RealSense's SDK, which never aligns depth, and has numbers in place of frames' names."""
    return topic.name.startswith(_REALSENSE_SDK) and (topic.frame_id.isdecimal() or not topic.frame_id)


def _find_colour_and_depth(
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
    depths = [named(images, depth, "depth", where)] if depth is not None else _of_streams(_depth_topics(everything))
    if not depths:
        raise VfoaError(f"{where}: no depth topic; say depth = in [source]: found {listed(images)}")
    colours = [named(images, colour, "left", where)] if colour is not None else _colours(images, depths)
    if not colours:
        raise VfoaError(
            f"{where}: no colour topic beside {listed(depths)}; say left = in [source]: found {listed(images)}"
        )
    pairs = [(colour_topic, depth_topic) for depth_topic in depths for colour_topic in colours]
    best = _best_of_copies(_nearest([pair for pair in pairs if is_aligned(pair[1], pair[0])] or pairs))
    if len(best) != 1:
        raise VfoaError(
            f"{where}: several colour and depth topics; say left = (colour) and depth = in [source]: "
            f"found {listed(colours)} and {listed(depths)}"
        )
    return best[0]


def _colours(images: list[Topic], depths: list[Topic]) -> list[Topic]:
    """Images in colour by name; if none has such a name, images of any other name."""
    others = [
        topic
        for topic in _with_stamps([topic for topic in images if topic not in depths])
        if not may_be_depth(topic.name, topic.header)
        if not _NO_COLOUR.search(topic.name.lower())
    ]
    others = _taken(others, depths) or others
    by_name = [topic for topic in others if any(word in topic.name.lower() for word in _COLOUR)]
    return _of_streams(by_name or [topic for topic in others if "depth" not in topic.name.lower()])


def _of_streams(topics: list[Topic]) -> list[Topic]:
    """One topic per stream: the one with the most messages; of equal ones, the raw one."""
    streams = grouped((_TRANSPORT.sub("", topic.name), topic) for topic in topics)
    return [max(copies, key=lambda topic: (len(topic.places), topic.type.kind == "raw")) for copies in streams.values()]


def _nearest(pairs: list[tuple[Topic, Topic]]) -> list[tuple[Topic, Topic]]:
    """The pairs that fit best: same frame, similar names, both rectified or not, in colour, no left or right side.

    Of equal ones with the same depth, those whose names share the most words: ``depth_front`` is of ``rgb_front``.
    """

    def rank(pair: tuple[Topic, Topic]) -> tuple[bool, int, bool, bool, bool]:
        colour, depth = pair
        parts = zip(colour.name.split("/"), depth.name.split("/"), strict=False)
        common = next((place for place, (part, other) in enumerate(parts) if part != other), 0)
        is_rectified = "rect" in depth.name or depth.name.endswith("depth_registered")  # ZED's name
        is_of_side = any(side in colour.name for side in ("left", "right"))
        same_frame = bool(depth.frame_id) and colour.frame_id == depth.frame_id
        same_rect = ("rect" in colour.name) == is_rectified
        return same_frame, common, same_rect, not _is_gray(colour), not is_of_side

    def shared(pair: tuple[Topic, Topic]) -> int:
        return len(words_of(pair[0].name) & words_of(pair[1].name))

    highest = max(map(rank, pairs), default=None)
    best = [pair for pair in pairs if rank(pair) == highest]
    if len({depth.name for _, depth in best}) != 1:
        return best
    return [pair for pair in best if shared(pair) == max(map(shared, best))]


def _best_of_copies(pairs: list[tuple[Topic, Topic]]) -> list[tuple[Topic, Topic]]:
    """The best pair, if all have copies of one camera's images: rectified, depth as integers, in colour; else all."""
    if len(pairs) < 2 or not all(map(_are_copies, zip(*pairs, strict=True))):
        return pairs
    if len({_namespace(colour) for colour, _ in pairs}) > 1:  # such as rgb/image_raw and rgb/high_res/image_raw
        return pairs

    most = max(map(_frames_of, pairs))

    def worth(pair: tuple[Topic, Topic]) -> tuple[bool, bool, bool, bool]:
        colour, depth = pair
        has_all = _frames_of(pair) >= 0.9 * most
        is_whole = depth.header is not None and depth.header.form.startswith("16")
        is_colour = any(word in colour.name.split("/")[-1] for word in _COLOUR)
        return has_all, colour.is_called_rectified, is_whole, is_colour

    return [max(pairs, key=worth)]


def _are_copies(topics: Collection[Topic]) -> bool:
    """Whether topics are below one namespace, in the same frame, and of one size as far as it is known."""
    above = min(map(_namespace, topics), key=len)
    sizes = {topic.header.size_px for topic in topics if topic.header is not None} - {None}
    frames = {topic.frame_id for topic in topics}
    is_below = all(topic.name.startswith(f"{above}/") for topic in topics)
    return is_below and len(sizes) < 2 and len(frames) == 1 and frames != {""}


def _namespace(topic: Topic) -> str:
    return _TRANSPORT.sub("", topic.name).rpartition("/")[0]
