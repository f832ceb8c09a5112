"""Checks that every clip must pass, for the tests of adapters.

def test_my_adapter_keeps_the_contract(tmp_path):
    check_contract(MyClip(MyClip.Settings(...), tmp_path), spawn=True)
"""

from __future__ import annotations

import hashlib
import itertools
import pickle
import re
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import nullcontext

import numpy as np

from harness.processes import spawning
from harness.sources import AnyClip, Clip, LeftClip, MeasuredClip, Truth
from vfoa.errors import VfoaError
from vfoa.types import Scene, StereoFrame


def check_contract(clip: Clip | MeasuredClip, *, spawn: bool | Executor = False) -> None:
    """Check that a clip follows the protocols of :mod:`harness.sources`.

    ``spawn`` also reads it in another process: a fresh one, or one of these.

    Reads the first, a middle and the last frame, several times and in several orders.

    Raises
    ------
    AssertionError
        For the first violation, in one line.
    """
    _check_frames(clip)
    _check_description(clip)
    numbers = sorted({clip.frames[0], clip.frames[len(clip.frames) // 2], clip.frames[-1]})
    before = _fingerprints(clip, numbers)
    frames = {number: _read(clip, number) for number in numbers}
    times_ns = [frame.time_ns for frame in frames.values()]
    for number, frame in frames.items():
        where = f"frame {number}"
        _expect(frame.index == number, f"{where}: its index is {frame.index}")
        _expect(type(frame.time_ns) is int, f"{where}: time_ns is {type(frame.time_ns).__name__}; expected int")
        if isinstance(clip, MeasuredClip):
            assert isinstance(frame, Scene)
            _check_scene(frame, where, clip)
        else:
            assert isinstance(frame, StereoFrame)
            _check_images(frame, where, clip)
            _check_truth(clip.truth(number), frame)
    _expect(_fingerprints(clip, numbers[::-1]) == before, "frame: found other content when a frame was read again")
    _expect(all(a < b for a, b in itertools.pairwise(times_ns)), f"time_ns: {times_ns} do not ascend")
    if isinstance(clip, MeasuredClip):
        _check_farthest(clip)
    _check_outside(clip)
    found_ns = [clip.time_ns(number) for number in numbers]
    _expect(found_ns == times_ns, f"time_ns: found {found_ns} for frames {numbers}; expected {times_ns}, as they have")
    _check_copies(clip, before, spawn)


def _read(clip: Clip | MeasuredClip, number: int) -> StereoFrame | Scene:
    frame = clip.scene(number) if isinstance(clip, MeasuredClip) else clip.frame(number)
    expected = Scene if isinstance(clip, MeasuredClip) else StereoFrame
    _expect(isinstance(frame, expected), f"frame {number}: found {type(frame).__name__}; expected {expected.__name__}")
    return frame


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
    lines = isinstance(clip.notes, tuple) and all(isinstance(note, str) and "\n" not in note for note in clip.notes)
    _expect(lines, f"notes: found {clip.notes!r}; expected a tuple of single lines")
    digest = clip.digest()
    _expect(bool(re.fullmatch("[0-9a-f]{64}", digest)), f"digest: found {digest!r}; expected a hexadecimal sha256")
    _expect(clip.digest() == digest, "digest: found another one when it was asked again")


def _check_scene(scene: Scene, where: str, clip: MeasuredClip) -> None:
    people, things = list(clip.people.values()), list(clip.objects.values())
    _expect(len({*people, *things}) == len(people) + len(things), f"{where}: two names share an instance id")
    _expect({*clip.people, *clip.objects} <= {*clip.categories}, f"{where}: a name has no category")
    found = [target.instance.id for target in scene.targets]
    _expect(len(set(found)) == len(found), f"{where}: two targets share an instance id: {found}")
    _expect({*found} <= {*people, *things}, f"{where}: targets {found} include one that has no name")
    seen = [person.instance_id for person in scene.people]
    _expect({*seen} <= {*people}, f"{where}: people {seen} include one that has no name")


def _check_farthest(clip: MeasuredClip) -> None:
    """It is the farthest place of all scenes."""
    distances_m = list[tuple[str, float]]()
    names = {number: name for name, number in {**clip.people, **clip.objects}.items()}
    for scene in map(clip.scene, clip.frames):
        places = [(person.instance_id, person.eye_origin_left) for person in scene.people]
        places += [(target.instance.id, target.box.center_m) for target in scene.targets if target.box is not None]
        distances_m += [(names[own], float(np.linalg.norm(place))) for own, place in places if place is not None]
    expected = max(distances_m, key=lambda each: each[1], default=None)
    said = clip.farthest()
    found = None if said is None else (said[0], said[2])
    _expect(found == expected, f"farthest: found {found}; expected {expected}, as in its scenes")


def _check_images(frame: StereoFrame, where: str, clip: Clip) -> None:
    for name, array in (("left image", frame.left), ("right image", frame.right), ("depth map", frame.depth_m)):
        _expect(array is None or array.flags.c_contiguous, f"{where}: the {name} is not contiguous")
    if isinstance(clip, LeftClip):
        same = np.array_equal(clip.left(frame.index), frame.left)
        _expect(same, f"left({frame.index}): found another image than the frame's")


def _check_truth(truth: Truth, frame: StereoFrame) -> None:
    where, size = f"truth of frame {frame.index}", frame.left.shape[:2]
    if truth.disparity is not None:
        found = truth.disparity.disparity_px
        _expect(found.shape == size, f"{where}: a disparity of {found.shape}; expected {size}")
        _expect(not (found <= 0).any() and not np.isinf(found).any(), f"{where}: expected positive disparities, or NaN")
    if truth.instances is not None:
        _expect(truth.instances.ids.shape == size, f"{where}: ids of {truth.instances.ids.shape}; expected {size}")
    names = [person.name for person in truth.people or ()]
    _expect(len(set(names)) == len(names), f"{where}: people of one name: {names}")


def _check_outside(clip: Clip | MeasuredClip) -> None:
    numbers = set(clip.frames)
    gap = next((number + 1 for number in clip.frames if number + 1 not in numbers), clip.frames[-1] + 1)
    for number in (clip.frames[0] - 1, gap, clip.frames[-1] + 1):
        try:
            _read(clip, number)
        except VfoaError as error:  # it names the clip, because a run can have many
            fine = re.match(rf"\S.*: .*\bframe {number}\b", str(error)) and "\n" not in str(error)
            expected = f"expected one line that names the clip and 'frame {number}'"
            _expect(bool(fine), f"frame {number}: {str(error)!r}; {expected}")
        else:
            raise AssertionError(f"frame {number}, which is not in frames: expected a VfoaError")


def _check_copies(clip: Clip | MeasuredClip, expected: dict[int, str], spawn: bool | Executor) -> None:
    data = pickle.dumps(clip)
    copies = {"after pickling": _read_copy(data, list(expected))}
    if spawn:
        own = ProcessPoolExecutor(1, mp_context=spawning()) if spawn is True else nullcontext(spawn)
        with own as pool:
            copies["in another process"] = pool.submit(_read_copy, data, list(expected)).result()
    for where, (frames, digest) in copies.items():
        _expect(digest == clip.digest(), f"digest: found another one {where}")
        _expect(frames == expected, f"frame: found other content {where}")


def _read_copy(data: bytes, numbers: list[int]) -> tuple[dict[int, str], str]:
    clip: Clip | MeasuredClip = pickle.loads(data)
    return _fingerprints(clip, numbers), clip.digest()


def _fingerprints(clip: Clip | MeasuredClip, numbers: list[int]) -> dict[int, str]:
    """Digest of everything that each frame holds."""
    found = {}
    for number in numbers:
        frame = _read(clip, number)
        if isinstance(frame, Scene):
            total = hashlib.sha256(repr(frame).encode())
        else:
            total = hashlib.sha256(f"{frame.index} {frame.time_ns} {frame.rig}".encode())
            for array in (frame.left, frame.right, frame.depth_m):
                total.update(b"none" if array is None else array.tobytes())
        found[number] = total.hexdigest()
    return found


def _expect(kept: bool, broken: str) -> None:
    if not kept:
        raise AssertionError(broken)
