from __future__ import annotations

import os
import pickle
import re
import shlex
import struct
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from harness.record.images import open_without_real_time
from harness.sources.media import film
from harness.sources.media.film import container_tags, first_picture_s
from harness.sources.media.video import STEP, Video
from harness.sources.stereo_folder import StereoFolderClip
from harness.sources.stereo_layouts import find_layouts
from tests.disk import moving_picture, write_bytes, write_text, write_video
from vfoa.errors import VfoaError

COUNT = 3 * STEP
KINDS = [("a.mp4", "mp4v"), ("a.avi", "MJPG"), ("a.mkv", "XVID"), ("a.mkv", "FFV1")]
IMAGES = [moving_picture(number) for number in range(COUNT)]


def _places(frames: list[np.ndarray], images: list[np.ndarray]) -> list[int]:
    """The place of the image that each frame is most like, by every fourth pixel."""
    few = np.stack([image[::4, ::4] for image in images]).astype(np.int16)
    return [int(np.abs(few - frame[::4, ::4]).mean(axis=(1, 2, 3)).argmin()) for frame in frames]


@pytest.mark.parametrize(("name", "fourcc"), KINDS)
def test_a_frame_found_by_seeking_is_the_frame_found_by_reading(tmp_path: Path, name: str, fourcc: str) -> None:
    path = write_video(tmp_path / name, IMAGES, fourcc)
    in_order = Video(path)
    frames = [in_order.read(place) for place in range(COUNT)]
    anywhere = Video(path)
    for place in np.random.default_rng(0).permutation(COUNT):
        assert np.array_equal(anywhere.read(int(place)), frames[place])
    assert _places(frames, IMAGES) == list(range(COUNT))


@pytest.mark.parametrize(
    ("coder", "can_seek"), [("intra-refresh=1:keyint=10:bframes=0", False), ("open-gop=1:keyint=10:bframes=3", True)]
)
def test_pictures_are_whole_where_a_decoder_cannot_begin_with_one(tmp_path: Path, coder: str, can_seek: bool) -> None:
    """A coder may refresh pictures part by part, so that the first ones after a seek lack parts."""
    path = tmp_path / "a.mp4"
    images = [moving_picture(number, 256, 96) for number in range(1, 121)]
    write_coded(path, images, {"crf": "12", "x264-params": coder})
    in_order = Video(path)
    assert in_order._can_seek == can_seek
    frames = [in_order.read(place) for place in in_order.frames]
    assert all(np.abs(frame.astype(int) - image).mean() < 3 for frame, image in zip(frames, images, strict=True))
    for place in (*range(0, 90, 10), *range(90, 120)):
        assert np.array_equal(Video(path).read(place), frames[place])


@pytest.mark.parametrize("name", ["a.MTS", "a.m2ts", "a.3gp", "a.flv"])
def test_films_of_camcorders_and_phones_are_films(tmp_path: Path, name: str) -> None:
    for side in ("left", "right"):
        write_coded(tmp_path / f"{side}_{name}", IMAGES[:40], {"bf": "2"}, form=FORMS.get(name[2:].lower()))
    (found,) = find_layouts(tmp_path)
    assert found.source == {"layout": "videos", "left": f"left_{name}", "right": f"right_{name}"}
    assert (len(found.views.frames), found.views.rate_hz) == (40, 25.0)
    assert found.views.time_ns(39) == 39 * 40_000_000
    assert np.abs(found.views.read(17)[1].astype(int) - IMAGES[17]).mean() < 10


@pytest.mark.parametrize(
    ("name", "coder", "options"),
    [
        ("a.mpg", "mpeg2video", {"bf": "2"}),
        ("a.vob", "mpeg2video", {"bf": "2"}),
        ("a.m2v", "mpeg2video", {"bf": "2"}),
        ("a.avi", "mpeg4", {"bf": "2"}),
        ("a.avi", "libx264", {"bf": "3"}),  # AVI has no times: FFmpeg counts the packets, whose order is another one
        ("a.flv", "libx264", {"bf": "2"}),
        ("a.mpg", "mpeg2video", {"bf": "2", "flags": "+ildct+ilme"}),
        ("a.MTS", "libx264", {"x264-params": "interlaced=1"}),
        ("a.mkv", "libsvtav1", {"preset": "12", "svtav1-params": "lp=1:keyint=24"}),
    ],
)
def test_every_picture_of_a_coder_is_read_and_has_its_time(
    tmp_path: Path, name: str, coder: str, options: dict[str, str]
) -> None:
    """OpenCV's reader loses the time of MPEG's last picture, gives old memory for interlaced ones, and none of AV1."""
    path = tmp_path / name
    images = [moving_picture(number, 128, 96) for number in range(COUNT)]
    write_coded(path, images, options, coder=coder, form=FORMS.get(path.suffix[1:].lower()))
    film = Video(path)
    assert list(film.times_ns) == [40_000_000 * place for place in range(COUNT)]
    assert film.rate_hz == 25.0
    assert not any("can be read" in note for note in film.notes)
    frames = [film.read(place) for place in film.frames]
    assert _places(frames, images) == list(range(COUNT))
    for place in (COUNT - 1, 40, 3):
        assert np.array_equal(Video(path).read(place), frames[place])


def test_frames_whose_times_go_back_are_one_step_after_the_frame_before(tmp_path: Path) -> None:
    write_coded(tmp_path / "a.ts", IMAGES[:10], {"bf": "0"})
    film = Video(write_bytes(tmp_path / "twice.ts", 2 * (tmp_path / "a.ts").read_bytes()))
    assert list(film.times_ns) == [40_000_000 * place for place in range(20)]
    assert film.notes == (
        "twice.ts: 10 frames (from 10 on) without a time of its own: one step after the frame before",
    )
    assert np.array_equal(film.read(13), film.read(3))


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("suffix", ["h264", "mjpeg", "avi"])
def test_a_raw_stream_has_no_times_and_is_told_what_to_do(tmp_path: Path, suffix: str, named: bool) -> None:
    """FFmpeg makes up the times of JPEG pictures that follow each other, whatever the file is called."""
    for side in ("left", "right"):
        path = tmp_path / f"{side}.{suffix}"
        if suffix == "h264":
            write_coded(path, IMAGES[:10], {"bf": "0"}, form="h264")
        else:
            path.write_bytes(b"".join(cv2.imencode(".jpg", image)[1].tobytes() for image in IMAGES[:10]))
    with pytest.raises(VfoaError, match=rf"left\.{suffix}: .*no times") as error:
        Video(tmp_path / f"left.{suffix}") if named else find_layouts(tmp_path)
    command = shlex.split(str(error.value).split("`")[1].replace("RATE", "25"))
    assert command == ["ffmpeg", "-r", "25", "-i", str(tmp_path / f"left.{suffix}"), "-c", "copy", "left.mp4"]


@pytest.mark.parametrize(
    ("options", "aspect", "words"),
    [
        ({"x264-params": "interlaced=1"}, 1, ["a.mp4: pictures are interlaced"]),
        ({}, Fraction(4, 3), ["a.mp4: pixels are 4:3, not square"]),
        ({}, Fraction(1215, 1216), []),
    ],
)
def test_rows_of_two_times_and_oblong_pixels_are_noted(
    tmp_path: Path, options: dict[str, str], aspect: Fraction, words: list[str]
) -> None:
    images = [moving_picture(number, 128, 64) for number in range(8)]
    write_coded(tmp_path / "a.mp4", images, {"crf": "12", **options}, aspect=aspect)
    assert [note[: len(word)] for note, word in zip(Video(tmp_path / "a.mp4").notes, words, strict=True)] == words


def test_pictures_are_cropped_as_they_say(tmp_path: Path) -> None:
    """Up to columns that are not aligned in memory, which FFmpeg keeps by default."""
    images = [moving_picture(number, 128, 96) for number in range(4)]
    write_coded(tmp_path / "a.mp4", images, {"crf": "12", "x264-params": "crop-rect=8,6,4,2"})
    found = Video(tmp_path / "a.mp4").read(2)
    assert np.abs(found.astype(int) - images[2][6:-2, 8:-4]).mean() < 3


FORMS = {"mts": "mpegts", "m2ts": "mpegts", "3gp": "mp4", "mpg": "vob", "vob": "vob", "m2v": "mpeg2video"}
"""FFmpeg's name of a form, where the end of a file's name does not tell it."""


def write_coded(
    path: Path,
    images: list[np.ndarray],
    options: dict[str, str],
    *,
    form: str | None = None,
    coder: str = "libx264",
    aspect: Fraction | int = 1,
) -> None:
    with av.open(str(path), "w", format=form) as container:
        stream: Any = container.add_stream(coder, rate=25, options=options)
        stream.height, stream.width, stream.pix_fmt = *images[0].shape[:2], "yuv420p"
        stream.codec_context.sample_aspect_ratio = aspect
        open_without_real_time(stream.codec_context)
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))


def test_what_the_container_says_is_read(tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.mp4", IMAGES[:10], "mp4v", rate_hz=12.5))
    assert (video.frames, video.rate_hz, video.notes) == (range(10), 12.5, ())
    assert list(video.times_ns) == [80_000_000 * place for place in range(10)]


def test_a_file_is_examined_once_until_it_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Examining decodes to the last frame, and a command opens a clip several times."""
    monkeypatch.setattr("harness.files.digests.SETTLED_NS", 0)
    path, opened = write_video(tmp_path / "a.mp4", IMAGES[:10], "mp4v"), list[Path]()
    opening = film.open_film
    monkeypatch.setattr(film, "open_film", lambda path: (opened.append(path), opening(path))[1])
    first = Video(path)
    examined = len(opened)
    again = Video(path)
    assert len(opened) == examined > 0
    assert again.times_ns == first.times_ns
    assert np.array_equal(again.read(3), first.read(3))
    write_video(path, IMAGES[:5], "mp4v")
    assert Video(path).frames == range(5)


@pytest.mark.parametrize("suffix", [".mkv", ".ts", ".mp4", ".mov"])
@pytest.mark.parametrize(("begin_s", "sound_s"), [(0.52, 0.0), (0.52, 3.0), (0.0, 4.0)])
def test_pictures_that_begin_after_the_sound_or_end_before_it_are_all_there(
    suffix: str, begin_s: float, sound_s: float, tmp_path: Path
) -> None:
    """Programs that record a screen with its sound write such films."""
    path = tmp_path / f"a{suffix}"
    with av.open(str(path), "w") as file:
        stream, tick_s = file.add_stream("mpeg4", rate=25), Fraction(1, 25)
        stream.height, stream.width, stream.pix_fmt = *IMAGES[0].shape[:2], "yuv420p"
        sound = file.add_stream("mp2", rate=32000) if sound_s else None
        for place, image in enumerate(IMAGES):
            picture = av.VideoFrame.from_ndarray(image, format="rgb24")
            picture.time_base, picture.pts = tick_s, round(25 * begin_s) + place
            file.mux(stream.encode(picture))
        file.mux(stream.encode())
        for at in range(0, round(32000 * sound_s), 1152):
            silence = av.AudioFrame.from_ndarray(np.zeros((1, 1152), np.int16), format="s16", layout="mono")
            silence.sample_rate, silence.pts = 32000, at
            file.mux(sound.encode(silence))
        if sound is not None:
            file.mux(sound.encode())
    video = Video(path)
    assert len(video.frames) == COUNT
    assert video.notes == ()


@pytest.mark.parametrize(("name", "fourcc"), [("a.avi", "MJPG"), ("a.mkv", "FFV1")])
def test_a_cut_file_has_the_frames_before_the_cut_and_says_so(tmp_path: Path, name: str, fourcc: str) -> None:
    path = write_video(tmp_path / name, IMAGES, fourcc)
    whole = Video(path)
    frames = [whole.read(place) for place in range(COUNT)]
    cut = Video(write_bytes(tmp_path / "cut" / name, path.read_bytes()[: path.stat().st_size * 6 // 10]))
    count = len(cut.frames)
    assert COUNT / 2 < count < COUNT
    assert cut.notes == (f"{name}: the container says {COUNT} frames, {count} can be read",)
    assert all(np.array_equal(cut.read(place), frames[place]) for place in range(count - 1))
    with pytest.raises(VfoaError, match=rf"{name}: .*{count}.*0 to {count - 1}"):
        cut.read(count)


def test_it_travels_to_other_processes(tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.mkv", IMAGES[:5]))
    third = video.read(3)
    assert np.array_equal(pickle.loads(pickle.dumps(video)).read(3), third)


def test_files_that_are_no_video_are_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(VfoaError, match=r"a\.mp4: not a readable video"):
        Video(write_text(tmp_path / "a.mp4", "no video"))
    with pytest.raises(VfoaError, match=r"b\.mp4: no such file"):
        Video(tmp_path / "b.mp4")
    assert capfd.readouterr() == ("", "")


def test_a_film_whose_coding_is_unknown_is_told_how_to_convert_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my film.avi"
    path.write_bytes(write_video(tmp_path / "a.avi", IMAGES[:3], "MJPG").read_bytes().replace(b"MJPG", b"ZZZZ"))
    with pytest.raises(VfoaError) as error:
        Video(path)
    assert str(error.value).startswith(f"{path}: ")
    (command,) = re.findall("`(.*)`", str(error.value))
    assert shlex.split(command)[:3] == ["ffmpeg", "-i", str(path)]
    assert capfd.readouterr().err == ""


def test_a_name_that_is_not_utf_8_does_not_end_the_process(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.mkv"))
    write_video(tmp_path / "a.mkv", [moving_picture(0)]).rename(path)
    with pytest.raises(VfoaError, match="not UTF-8"):
        Video(path)


def test_tags_of_another_coding_than_utf_8_do_not_matter(tmp_path: Path) -> None:
    path = _film(tmp_path / "a.mkv", pictures_s=0.0, sound_s=None, title="caf\u00e9 ")
    utf_8, latin_1 = "caf\u00e9 ".encode(), "caf\u00e9s ".encode("latin-1")
    assert utf_8 in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(utf_8, latin_1))
    assert len(Video(path).frames) == 10
    assert (first_picture_s(path), container_tags(path)["title"][:3]) == (0.0, "caf")


def _film(path: Path, *, pictures_s: float, sound_s: float | None, title: str = "a film") -> Path:
    """A film of ten pictures at 25 Hz that begin at one time, with a sound that begins at another."""
    with av.open(str(path), "w") as container:
        container.metadata["title"] = title
        video = container.add_stream("mpeg4", rate=25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        video.time_base = video.codec_context.time_base = Fraction(1, 1000)
        if sound_s is not None:
            sound = container.add_stream("mp2", rate=48_000)
            samples = np.zeros((1, 2 * 48_000), np.int16)
            frame = av.AudioFrame.from_ndarray(samples, format="s16", layout="stereo")
            frame.sample_rate, frame.time_base, frame.pts = 48_000, Fraction(1, 48_000), round(48_000 * sound_s)
            container.mux([*sound.encode(frame), *sound.encode(None)])
        for number in range(10):
            picture = av.VideoFrame.from_ndarray(IMAGES[number], format="rgb24").reformat(64, 48)
            picture.time_base, picture.pts = Fraction(1, 1000), round(1000 * pictures_s) + 40 * number
            container.mux(video.encode(picture))
        container.mux(video.encode(None))
    return path


@pytest.mark.parametrize(
    ("name", "pictures_s", "sound_s", "expected_s"),
    [
        ("a.mp4", 0.0, None, 0.0),
        ("a.mp4", 1.2, 0.0, 1.2),
        ("a.mkv", 1.2, 0.0, 1.2),
        ("a.mkv", 1.2, 0.52, 1.2),  # the container's zero is before both
        ("a.mkv", 0.0, 1.2, 0.0),
        ("a.ts", 1.2, 0.0, 1.2),  # its stamps begin anywhere
        ("a.ts", 0.0, None, 0.0),
    ],
)
def test_the_first_picture_is_where_a_player_shows_it(
    name: str, pictures_s: float, sound_s: float | None, expected_s: float, tmp_path: Path
) -> None:
    path = _film(tmp_path / name, pictures_s=pictures_s, sound_s=sound_s)
    assert first_picture_s(path) == pytest.approx(expected_s, abs=0.03)  # the sound's first packet is early
    assert Video(path).times_ns[:2] == (0, 40_000_000)


def test_a_stereo_film_says_when_its_first_picture_is_shown(tmp_path: Path) -> None:
    _film(tmp_path / "left.mp4", pictures_s=1.2, sound_s=0.0)
    _film(tmp_path / "right.mp4", pictures_s=0.0, sound_s=None)
    camera = {"fx_px": 50, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
    for swap, names in ((False, ["left.mp4", "right.mp4"]), (True, ["right.mp4", "left.mp4"])):
        settings = {"layout": "videos", "left": "left.mp4", "right": "right.mp4", "camera": camera, "swap": swap}
        films = StereoFolderClip(StereoFolderClip.Settings.model_validate(settings), tmp_path).films
        assert list(films) == names
        assert films["left.mp4"] == pytest.approx(1.2, abs=0.03)


def _with_display_matrix(path: Path, a: float, b: float, c: float, d: float) -> Path:
    """Write a matrix into the header of an MPEG-4 track: a pixel (p, q) is shown at (a p + c q, b p + d q)."""
    content = path.read_bytes()
    begin = content.index(b"tkhd") + 4 + 40  # version 0: times, track, duration, layer, volume before it
    assert content[begin - 40] == 0
    matrix = struct.pack(">9i", *(round(65536 * each) for each in (a, b, 0, c, d, 0, 0, 0)), 1 << 30)
    return write_bytes(path, content[:begin] + matrix + content[begin + 36 :])


TURNS = [  # by the definition of the matrix, each on its own: where the first row and column of the picture go
    ((1, 0, 0, 1), lambda image: image),
    ((-1, 0, 0, -1), lambda image: image[::-1, ::-1]),
    ((0, 1, -1, 0), lambda image: image.transpose(1, 0, 2)[:, ::-1]),  # a phone held upright: a quarter to the right
    ((0, -1, 1, 0), lambda image: image.transpose(1, 0, 2)[::-1]),
    ((-1, 0, 0, 1), lambda image: image[:, ::-1]),  # a mirrored selfie
    ((1, 0, 0, -1), lambda image: image[::-1]),
    ((0, 1, 1, 0), lambda image: image.transpose(1, 0, 2)),
    ((0, -1, -1, 0), lambda image: image.transpose(1, 0, 2)[::-1, ::-1]),
]


@pytest.mark.parametrize(("matrix", "shown"), TURNS)
def test_pictures_are_turned_as_the_file_says(
    matrix: tuple[int, ...], shown: Callable[..., Any], tmp_path: Path
) -> None:
    plain = Video(write_video(tmp_path / "plain.mp4", IMAGES[:5], "mp4v"))
    turned = Video(_with_display_matrix(write_video(tmp_path / "a.mp4", IMAGES[:5], "mp4v"), *matrix))
    for place in (0, 3):
        assert np.array_equal(turned.read(place), shown(plain.read(place)))
    assert (turned.notes == ()) == (matrix == (1, 0, 0, 1))
    assert np.array_equal(pickle.loads(pickle.dumps(turned)).read(1), shown(plain.read(1)))


def test_pictures_that_are_turned_by_a_part_of_a_quarter_are_refused(tmp_path: Path) -> None:
    path = _with_display_matrix(write_video(tmp_path / "a.mp4", IMAGES[:2], "mp4v"), 0.7, 0.7, -0.7, 0.7)
    with pytest.raises(VfoaError, match=r"a\.mp4: .*90 degrees"):
        Video(path)


def test_a_film_of_both_views_is_turned_before_it_is_divided(tmp_path: Path) -> None:
    pair = np.hstack([IMAGES[0], IMAGES[5]])  # left and right, upright
    upside_down = write_video(tmp_path / "a.mp4", [np.ascontiguousarray(pair[::-1, ::-1])], "mp4v")
    _with_display_matrix(upside_down, -1, 0, 0, -1)
    camera = {"fx_px": 50, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
    settings = {"layout": "video_side_by_side", "both": "a.mp4", "camera": camera}
    frame = StereoFolderClip(StereoFolderClip.Settings.model_validate(settings), tmp_path).frame(0)
    assert frame.right is not None
    for seen, image in ((frame.left, IMAGES[0]), (frame.right, IMAGES[5])):
        assert np.abs(seen.astype(int) - image).mean() < 10
