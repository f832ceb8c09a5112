from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scripts.measure.mirror import bandage_frame, frame_of, mirrored, mirrored_head
from vfoa.crops import head_box
from vfoa.errors import VfoaError
from vfoa.heads.person_mask import HEAD_ASPECT, PersonMask, head_in_mask
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, Head, Image, Instance, Instances, Mask


def person_mask(shape: tuple[int, int], u: float, top: float, head_width: float) -> tuple[Mask, Float]:
    """A person seen from the front, and the box of the head: an ellipse on a neck on shoulders."""
    canvas = np.zeros(shape, np.uint8)
    height = 1.3 * head_width
    box = np.array([u - head_width / 2, top, u + head_width / 2, top + height])
    cv2.ellipse(canvas, ((u, top + height / 2), (head_width, height), 0), 1, -1)
    neck, shoulders = 0.3 * head_width, 1.2 * head_width
    cv2.rectangle(
        canvas, (round(u - neck), round(top + height / 2)), (round(u + neck), round(top + 1.6 * height)), 1, -1
    )
    first, last = (round(u - shoulders), round(top + 1.3 * height)), (round(u + shoulders), shape[0])
    cv2.rectangle(canvas, first, last, 1, -1)
    return canvas.astype(bool), box


def overlap(a: Float, b: Float) -> float:
    """Intersection over union of two boxes."""
    sides = np.clip(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0, None)
    both = sides.prod()
    return float(both / ((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - both))


def people(*masks: Mask, label: str = "person", score: float = 0.8) -> Instances:
    ids = np.zeros(masks[0].shape, np.uint16)
    for n, mask in enumerate(masks, start=1):
        ids[mask] = n
    return Instances(
        ids=ids,
        instances=tuple(
            Instance(id=n, label=label, category_id=1, is_thing=True, score=score) for n in range(1, len(masks) + 1)
        ),
    )


def nobody(image: Image) -> Instances:
    return Instances(ids=np.zeros(image.shape[:2], np.uint16), instances=())


@pytest.fixture
def yunet(shared_models: Path) -> YuNet:
    return YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_640_640.onnx")))


# From a person's mask


@given(
    u=st.floats(150, 350),
    top=st.floats(0, 80),
    head_width=st.floats(16, 100),
)
def test_the_top_of_a_persons_mask_is_the_head(u: float, top: float, head_width: float) -> None:
    mask, box = person_mask((400, 500), u, top, head_width)
    found = head_in_mask(mask)
    assert found is not None
    assert overlap(found, box) > 0.7


@given(du=st.integers(-60, 60), dv=st.integers(0, 60))
def test_the_head_moves_with_the_mask(du: int, dv: int) -> None:
    mask, _ = person_mask((400, 500), 250, 20, 60)
    moved = np.zeros_like(mask)
    moved[dv:] = np.roll(mask, du, axis=1)[: 400 - dv]
    first, second = head_in_mask(mask), head_in_mask(moved)
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(second - first, [du, dv, du, dv])


def test_a_close_up_of_a_head_is_all_head() -> None:
    mask = np.zeros((100, 200), bool)
    mask[10:60, 20:180] = True
    np.testing.assert_allclose(head_in_mask(mask), [19.5, 9.5, 179.5, 59.5], atol=9)


@given(widths=st.lists(st.integers(0, 60), min_size=1, max_size=60))
def test_a_head_ends_where_its_rows_reach_the_height_of_their_median_width(widths: list[int]) -> None:
    mask = np.arange(64) <= np.array(widths)[:, None] + 3  # no row is so narrow that it could be left out
    reached = (n for n in range(1, len(widths) + 1) if n >= HEAD_ASPECT * np.median(mask[:n].sum(axis=1)))
    _, top, _, bottom = head_in_mask(mask)
    assert bottom - top == next(reached, len(widths))


@pytest.mark.parametrize("rows", [slice(10, 11), slice(10, 45), slice(25, 45)], ids=["pixel", "strand", "feather"])
def test_what_sticks_out_above_a_head_is_not_the_head(rows: slice) -> None:
    """A pixel that a segmentation has put far above, a strand of hair on end, a feather."""
    mask, _ = person_mask((400, 500), 250, 40, 60)
    adorned = mask.copy()
    adorned[rows, 251:254] = True
    np.testing.assert_array_equal(head_in_mask(adorned), head_in_mask(mask))


def test_an_empty_mask_has_no_head() -> None:
    assert head_in_mask(np.zeros((10, 10), bool)) is None


def test_each_person_has_one_head_and_other_things_have_none() -> None:
    left, _ = person_mask((400, 500), 120, 30, 40)
    right, box = person_mask((400, 500), 380, 60, 50)
    frame = frame_of(np.zeros((400, 500, 3), np.uint8))
    detector = PersonMask(PersonMask.Settings())
    heads = detector.detect(frame, people(left, right))
    assert [head.instance_id for head in heads] == [1, 2]
    assert overlap(heads[1].box_px, box) > 0.7
    assert all(0 < head.score < 0.8 and head.landmarks_px is None and head.face_box_px is None for head in heads)
    assert detector.detect(frame, people(left, right, label="dog")) == ()
    assert PersonMask(PersonMask.Settings(min_height_px=300)).detect(frame, people(left)) == ()


# YuNet


def test_finds_the_face_of_bandage_2_in_every_frame_tried(shared_data: Path, yunet: YuNet) -> None:
    for number in range(1, 51, 7):
        frame = bandage_frame(shared_data, number)
        (head,) = yunet.detect(frame, nobody(frame.left))
        assert head.score > 0.85
        assert head.face_box_px is not None
        assert head.landmarks_px is not None
        right_eye, left_eye, nose, right_mouth, left_mouth = head.landmarks_px
        assert right_eye[0] < left_eye[0]
        assert right_mouth[0] < left_mouth[0]
        assert max(right_eye[1], left_eye[1]) < nose[1] < min(right_mouth[1], left_mouth[1])
        assert (head.landmarks_px > head.face_box_px[:2]).all()
        assert (head.landmarks_px < head.face_box_px[2:]).all()
        assert (head.box_px[:2] < head.face_box_px[:2]).all()
        assert (head.box_px[2:] > head.face_box_px[2:]).all()


def test_the_head_of_a_mirrored_frame_is_the_mirrored_head(shared_data: Path, yunet: YuNet) -> None:
    frame = bandage_frame(shared_data, 20)
    (head,) = yunet.detect(frame, nobody(frame.left))
    (seen,) = yunet.detect(mirrored(frame), nobody(frame.left))
    expected = mirrored_head(head, frame.rig.width_px)
    assert overlap(seen.box_px, expected.box_px) > 0.8
    assert seen.landmarks_px is not None
    assert expected.landmarks_px is not None
    np.testing.assert_allclose(seen.landmarks_px, expected.landmarks_px, atol=25)  # of a face 190 px wide


def test_a_shrunk_search_finds_the_same_head(shared_data: Path, shared_models: Path) -> None:
    frame = bandage_frame(shared_data, 20)
    weights = str(shared_models / "yunet_n_dynamic.onnx")
    found = [
        YuNet(YuNet.Settings(weights=weights, max_size_px=size)).detect(frame, nobody(frame.left))[0].box_px
        for size in (1024, 640, 480)
    ]
    assert overlap(found[0], found[1]) > 0.8
    assert overlap(found[0], found[2]) > 0.8


def test_people_without_a_face_get_the_head_of_their_mask(shared_data: Path, shared_models: Path) -> None:
    frame = bandage_frame(shared_data, 20)
    girl = np.zeros(frame.left.shape[:2], bool)
    girl[10:, 450:800] = True
    other, _ = person_mask((436, 1024), 250, 60, 60)
    instances = people(girl, other)
    weights = str(shared_models / "yunet_n_640_640.onnx")
    with_face, without = YuNet(YuNet.Settings(weights=weights)).detect(frame, instances)
    assert with_face.landmarks_px is not None
    assert (without.instance_id, without.landmarks_px, without.face_box_px) == (2, None, None)
    assert without.score < with_face.score


def detector_of_no_use(folder: Path) -> YuNet:
    """One that can join faces with people, but not search for faces."""
    (folder / "none.onnx").touch()
    return YuNet(YuNet.Settings(weights=str(folder / "none.onnx")))


def face_in(box_px: list[float]) -> Head:
    return Head(box_px=head_box(box_px), score=0.9, face_box_px=np.array(box_px))


@pytest.mark.parametrize(("covered", "heads"), [(0.02, 2), (0.4, 2), (0.6, 1), (1.0, 1)])
def test_a_face_that_a_mask_only_touches_is_not_that_of_the_person(tmp_path: Path, covered: float, heads: int) -> None:
    """A face on a screen beside the body of someone who turns away."""
    mask, box = person_mask((400, 500), 250, 30, 60)
    mask[200:, 150:350] = True
    first = 349.5 - 50 * covered
    frame = frame_of(np.zeros((400, 500, 3), np.uint8))
    found = detector_of_no_use(tmp_path).with_people((face_in([first, 249.5, first + 50, 309.5]),), frame, people(mask))
    assert len(found) == heads
    if heads == 2:
        assert found[1].instance_id == 1
        assert overlap(found[1].box_px, box) > 0.7


def test_a_person_of_a_poor_mask_has_one_head(tmp_path: Path) -> None:
    """The mask has a third of the face's pixels, as one that was carried over frames may."""
    mask, box = person_mask((400, 500), 250, 30, 60)
    mask[:, ::3] = False
    mask[:, 1::3] = False
    frame = frame_of(np.zeros((400, 500, 3), np.uint8))
    assert len(detector_of_no_use(tmp_path).with_people((face_in(box.tolist()),), frame, people(mask))) == 1


@pytest.mark.parametrize("size", [640, 320])
def test_faces_are_those_of_opencvs_own_decoder(shared_data: Path, shared_models: Path, size: int) -> None:
    frame = bandage_frame(shared_data, 20)
    path = shared_models / "yunet_n_dynamic.onnx"
    (head,) = YuNet(YuNet.Settings(weights=str(path), max_size_px=size)).detect(frame, nobody(frame.left))
    height, width = frame.left.shape[:2]
    shrunk = cv2.resize(frame.left, (size, round(height * size / width)), interpolation=cv2.INTER_AREA)
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    reference = cv2.FaceDetectorYN.create(str(path), "", (shrunk.shape[1], shrunk.shape[0]), 0.6, 0.3, 5000)
    _, faces = reference.detect(np.ascontiguousarray(shrunk[..., ::-1]))
    cv2.utils.logging.setLogLevel(level)
    scale = np.array([width / shrunk.shape[1], height / shrunk.shape[0]])
    assert len(faces) == 1
    first, extent, score = faces[0, :2] * scale - 0.5, faces[0, 2:4] * scale, faces[0, 14]
    assert head.face_box_px is not None
    np.testing.assert_allclose(head.face_box_px, [*first, *(first + extent)], atol=0.1)
    np.testing.assert_allclose(head.landmarks_px, faces[0, 4:14].reshape(5, 2) * scale - 0.5, atol=0.1)
    assert head.score == pytest.approx(score, abs=1e-3)


def test_a_graph_of_a_fixed_size_finds_the_same_face(shared_data: Path, shared_models: Path) -> None:
    frame = bandage_frame(shared_data, 20)
    boxes = [
        YuNet(YuNet.Settings(weights=str(shared_models / name))).detect(frame, nobody(frame.left))[0].box_px
        for name in ("yunet_n_dynamic.onnx", "yunet_n_640_640.onnx")
    ]
    assert overlap(*boxes) > 0.95
    larger = YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_640_640.onnx"), max_size_px=800))
    with pytest.raises(VfoaError, match=r"640 x 640 .*800 x 341.*heads\.max_size"):
        larger.detect(frame, nobody(frame.left))


def test_says_nothing_and_travels(yunet: YuNet, shared_data: Path, capfd: pytest.CaptureFixture[str]) -> None:
    frame = bandage_frame(shared_data, 20)
    before = yunet.detect(frame, nobody(frame.left))
    after = pickle.loads(pickle.dumps(yunet)).detect(frame, nobody(frame.left))
    np.testing.assert_array_equal(before[0].box_px, after[0].box_px)
    assert capfd.readouterr() == ("", "")


def test_other_weights_are_one_clear_line(shared_models: Path) -> None:
    detector = YuNet(YuNet.Settings(weights=str(shared_models / "fsanet-var-iter-688590.onnx")))
    image = np.zeros((64, 64, 3), np.uint8)
    with pytest.raises(VfoaError, match="another model's outputs; expected cls_8"):
        detector.detect(frame_of(image), nobody(image))
