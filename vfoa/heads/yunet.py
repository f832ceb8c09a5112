"""YuNet faces through OpenCV (Wu et al. 2023), grown to heads; people without a face from their masks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

import cv2
import numpy as np
from pydantic import Field

from vfoa import settings
from vfoa.crops import grow
from vfoa.heads.person_mask import PersonMask
from vfoa.onnx import Model, RuntimeSettings, Signature
from vfoa.types import Float, Head, Image, Instances, StereoFrame

SIGNATURE = Signature(
    inputs={"input": (None, 3, None, None)},
    outputs={
        f"{name}_{stride}": (None, None, length)
        for name, length in {"cls": 1, "obj": 1, "bbox": 4, "kps": 10}.items()
        for stride in (8, 16, 32)
    },
)
_MOST_FACES = 5000


class YuNet:
    """Finds faces and their five landmarks.

    A head is its face's box (forehead to chin) and 15 % of the face's width on either side, 20 % of its height above
    and 5 % below: the vertex stands about a quarter of the face's height above the hairline, and the ears outside
    of the cheeks. A person without a face, one that turns away say, gets the head of
    :class:`~vfoa.heads.person_mask.PersonMask`: with a lower score, without face and landmarks.
    """

    class Settings(settings.Settings):
        """``max_size_px``: a larger image is shrunk to this length before the search; faces below 10 px are lost."""

        weights: str = "yunet_n_640_640.onnx"
        score_threshold: float = Field(default=0.6, gt=0, le=1)
        nms_iou: float = Field(default=0.3, gt=0, le=1)
        max_size_px: int = Field(default=640, ge=32)
        fallback: Literal["person_mask", "none"] = "person_mask"
        person_mask: PersonMask.Settings = PersonMask.Settings()

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, RuntimeSettings())
        self._people = PersonMask(settings.person_mask)
        self._detector: Any = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_detector": None}

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Heads with a face, best first, then those of the people without one."""
        heads = self._faces(frame.left)
        if self.settings.fallback == "person_mask":
            owners = {_owner(head, instances, self.settings.person_mask.label) for head in heads}
            heads += [head for head in self._people.detect(frame, instances) if head.instance_id not in owners]
        return tuple(heads)

    def _faces(self, image: Image) -> list[Head]:
        height, width = image.shape[:2]
        scale = min(1.0, self.settings.max_size_px / max(height, width))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        shrunk = cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale < 1 else image
        found = self._search(np.ascontiguousarray(shrunk[..., ::-1]))
        return [_head(row, np.array([width / size[0], height / size[1]])) for row in found]

    def _search(self, bgr: Image) -> Float:
        """Rows (N, 15) of faces, best first: box u, v, width, height, five landmarks, score."""
        if self._detector is None:
            self._model.check()
            with _without_warnings():
                self._detector = cv2.FaceDetectorYN.create(
                    str(self._model.path), "", (1, 1), self.settings.score_threshold, self.settings.nms_iou, _MOST_FACES
                )
        self._detector.setInputSize((bgr.shape[1], bgr.shape[0]))
        rows = self._detector.detect(bgr)[1]
        return np.empty((0, 15)) if rows is None else rows[np.argsort(-rows[:, 14], kind="stable")].astype(np.float64)


def _head(row: Float, scale: Float) -> Head:
    """A row of YuNet's, whose pixels have their edges on integers, as a head at the image's scale."""
    first, size, landmarks = row[:2] * scale - 0.5, row[2:4] * scale, row[4:14].reshape(5, 2) * scale - 0.5
    face = np.concatenate([first, first + size])
    return Head(
        box_px=grow(face, side=0.15, top=0.2, bottom=0.05),
        score=float(row[14]),
        face_box_px=face,
        landmarks_px=landmarks,
    )


def _owner(head: Head, instances: Instances, label: str) -> int | None:
    """The person whose mask covers most of a head's face, None where no person does."""
    assert head.face_box_px is not None
    height, width = instances.ids.shape
    u0, v0, u1, v1 = np.clip(np.rint(head.face_box_px), 0, [width, height] * 2).astype(int)
    inside = instances.ids[v0:v1, u0:u1]
    covered = {person.id: int((inside == person.id).sum()) for person in instances.instances if person.label == label}
    best = max(covered, key=lambda id_: covered[id_], default=None)
    return best if best is not None and covered[best] else None


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Keep OpenCV 5 from writing to stderr that its new engine ignores the target, which nobody asked for."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
