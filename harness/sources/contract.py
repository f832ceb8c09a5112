"""Checks that every clip must pass, for the tests of adapters, also those of other packages.

def test_my_adapter_keeps_the_contract(tmp_path):
    check_contract(MyClip(MyClip.Settings(...), tmp_path), spawn=True)
"""

from __future__ import annotations

import hashlib
import itertools
import pickle
import re
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from harness.processes import spawning
from harness.sources import AnyClip, Clip, LeftClip, MeasuredClip, Truth
from vfoa.errors import VfoaError
from vfoa.types import Scene, StereoFrame


def check_contract(clip: Clip | MeasuredClip, *, spawn: bool = False) -> None:
    """Check that a clip follows the protocols of :mod:`harness.sources`; ``spawn`` also reads it in a fresh process.

    Reads the first, a middle and the last frame, several times and in several orders.

    Raises
    ------
    AssertionError
        For the first violation, in one line.
    """
    _check_frames(clip)
    _check_description(clip)
    numbers = _sample(clip)
    before = {number: _fingerprint(_read(clip, number)) for number in numbers}
    for number in numbers:
        frame = _read(clip, number)
        if isinstance(frame, Scene) and isinstance(clip, MeasuredClip):
            _check_scene(frame, number, clip)
        else:
            _check_frame(frame, number)
            _check_left(clip, frame, number)
            _check_truth(clip.truth(number), frame)
    again = {number: _fingerprint(_read(clip, number)) for number in reversed(numbers)}
    _expect(again == before, "frame: found other content when a frame was read again")
    _check_times([_read(clip, number).time_ns for number in numbers])
    _check_outside(clip)
    _check_clock(clip, numbers)
    _check_copies(clip, before, spawn)


def _check_left(clip: Clip | MeasuredClip, frame: StereoFrame | Scene, number: int) -> None:
    if isinstance(clip, LeftClip) and isinstance(frame, StereoFrame):
        _expect(np.array_equal(clip.left(number), frame.left), f"left({number}): found another image than the frame's")


def _read(clip: Clip | MeasuredClip, number: int) -> StereoFrame | Scene:
    return clip.scene(number) if isinstance(clip, MeasuredClip) else clip.frame(number)


def _check_scene(scene: Scene, number: int, clip: MeasuredClip) -> None:
    where = f"frame {number}"
    _expect(scene.index == number, f"{where}: its index is {scene.index}")
    _expect(type(scene.time_ns) is int, f"{where}: time_ns is {type(scene.time_ns).__name__}; expected int")
    people, things = list(clip.people.values()), list(clip.objects.values())
    _expect(len({*people, *things}) == len(people) + len(things), f"{where}: two names share an instance id")
    _expect({*clip.people, *clip.objects} <= {*clip.categories}, f"{where}: a name has no category")
    found = [target.instance.id for target in scene.targets]
    _expect(len(set(found)) == len(found), f"{where}: two targets share an instance id: {found}")
    _expect({*found} <= {*people, *things}, f"{where}: targets {found} include one that has no name")
    seen = [person.instance_id for person in scene.people]
    _expect({*seen} <= {*people}, f"{where}: people {seen} include one that has no name")


def _check_frames(clip: AnyClip) -> None:
    found = list(clip.frames)
    _expect(len(found) > 0, "frames: found none; expected at least one")
    _expect(all(type(each) is int for each in found), "frames: found other types; expected int")
    _expect(all(a < b for a, b in itertools.pairwise(found)), f"frames: {found[:5]} ... do not ascend")
    same = len(clip.frames) == len(found) and [clip.frames[place] for place in range(len(found))] == found
    _expect(same, "frames: length, items and iteration differ; expected a sequence")
    _expect(clip.frames[-1] in clip.frames, "frames: its last number is not in it; expected a sequence")


def _check_description(clip: AnyClip) -> None:
    rate = clip.rate_hz
    _expect(rate is None or 0 < rate < float("inf"), f"rate_hz: found {rate}; expected a positive number, or None")
    lines = isinstance(clip.notes, tuple) and all(isinstance(each, str) and "\n" not in each for each in clip.notes)
    _expect(lines, f"notes: found {clip.notes!r}; expected a tuple of single lines")
    digest = clip.digest()
    _expect(bool(re.fullmatch("[0-9a-f]{64}", digest)), f"digest: found {digest!r}; expected a hexadecimal sha256")
    _expect(clip.digest() == digest, "digest: found another one when it was asked again")


def _check_frame(frame: StereoFrame | Scene, number: int) -> None:
    where = f"frame {number}"
    if not isinstance(frame, StereoFrame):
        raise AssertionError(f"{where}: found {type(frame).__name__}; expected a StereoFrame")
    _expect(frame.index == number, f"{where}: its index is {frame.index}")
    _expect(type(frame.time_ns) is int, f"{where}: time_ns is {type(frame.time_ns).__name__}; expected int")
    for name, array in (("left image", frame.left), ("right image", frame.right), ("depth map", frame.depth_m)):
        _expect(array is None or array.flags.c_contiguous, f"{where}: the {name} is not contiguous")


def _check_truth(truth: Truth, frame: StereoFrame | Scene) -> None:
    assert isinstance(frame, StereoFrame)
    where, size = f"truth of frame {frame.index}", frame.left.shape[:2]
    if truth.disparity is not None:
        found = truth.disparity.disparity_px
        _expect(found.shape == size, f"{where}: a disparity of {found.shape}; expected {size}")
        _expect(not (found <= 0).any() and not np.isinf(found).any(), f"{where}: expected positive disparities, or NaN")
    if truth.instances is not None:
        _expect(truth.instances.ids.shape == size, f"{where}: ids of {truth.instances.ids.shape}; expected {size}")
    names = [person.name for person in truth.people or ()]
    _expect(len(set(names)) == len(names), f"{where}: people of one name: {names}")


def _check_times(times_ns: list[int]) -> None:
    _expect(all(a < b for a, b in itertools.pairwise(times_ns)), f"time_ns: {times_ns} do not ascend")


def _check_clock(clip: Clip | MeasuredClip, numbers: list[int]) -> None:
    for number in numbers:
        asked, read = clip.time_ns(number), _read(clip, number).time_ns
        _expect(asked == read, f"time_ns: found {asked} for frame {number}; expected {read}, as the frame has it")


def _check_outside(clip: Clip | MeasuredClip) -> None:
    for number in (clip.frames[0] - 1, clip.frames[-1] + 1, *_first_gap(clip)):
        message = _refusal(clip, number)
        if message is None:
            raise AssertionError(f"frame {number}, which is not in frames: expected a VfoaError")
        # Errors name the clip, because a run can have many clips.
        fine = re.match(rf"\S.*: .*\bframe {number}\b", message) and "\n" not in message
        _expect(bool(fine), f"frame {number}: {message!r}; expected one line that names the clip and 'frame {number}'")


def _first_gap(clip: AnyClip) -> list[int]:
    numbers = set(clip.frames)
    inner = (number + 1 for number in clip.frames[:-1] if number + 1 not in numbers)
    return [number for number in [next(inner, None)] if number is not None]


def _refusal(clip: Clip | MeasuredClip, number: int) -> str | None:
    try:
        _read(clip, number)
    except VfoaError as error:
        return str(error)
    return None


def _check_copies(clip: Clip | MeasuredClip, expected: dict[int, str], spawn: bool) -> None:
    data = pickle.dumps(clip)
    copies = {"after pickling": _read_copy(data, list(expected))}
    if spawn:
        with ProcessPoolExecutor(1, mp_context=spawning()) as pool:
            copies["in another process"] = pool.submit(_read_copy, data, list(expected)).result()
    for where, (frames, digest) in copies.items():
        _expect(digest == clip.digest(), f"digest: found another one {where}")
        _expect(frames == expected, f"frame: found other content {where}")


def _read_copy(data: bytes, numbers: list[int]) -> tuple[dict[int, str], str]:
    clip: Clip | MeasuredClip = pickle.loads(data)
    return {number: _fingerprint(_read(clip, number)) for number in numbers}, clip.digest()


def _fingerprint(frame: StereoFrame | Scene) -> str:
    """Digest of everything that a frame holds."""
    if isinstance(frame, Scene):
        return hashlib.sha256(repr(frame).encode()).hexdigest()
    total = hashlib.sha256(f"{frame.index} {frame.time_ns} {frame.rig}".encode())
    for array in (frame.left, frame.right, frame.depth_m):
        total.update(b"none" if array is None else array.tobytes())
    return total.hexdigest()


def _sample(clip: AnyClip) -> list[int]:
    """First, middle and last number, without repetitions."""
    return sorted({clip.frames[0], clip.frames[len(clip.frames) // 2], clip.frames[-1]})


def _expect(kept: bool, broken: str) -> None:
    if not kept:
        raise AssertionError(broken)
