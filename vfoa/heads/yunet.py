"""YuNet faces through ONNX (Wu et al. 2023), grown to heads. People without a face get heads from their masks.

The graph: ``input`` [1, 3, h, w] BGR 0 to 255, h and w multiples of 32. For each stride of 8, 16 and 32 pixels and each
cell of that size, row by row: ``cls`` and ``obj``, whose geometric mean is the score; ``bbox``, centre in cells from
the cell's corner and logarithm of width and height in cells; ``kps``, five landmarks in cells from the cell's corner.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vfoa.crops import center, head_box
from vfoa.errors import VfoaError
from vfoa.heads.person_mask import PersonMask
from vfoa.onnx import Model, RuntimeSettings, Signature, blob
from vfoa.types import Float, Head, Image, Instances, StereoFrame

STRIDES = (8, 16, 32)
SIGNATURE = Signature(
    inputs={"input": (None, 3, None, None)},
    outputs={
        f"{name}_{stride}": (None, None, length)
        for name, length in {"cls": 1, "obj": 1, "bbox": 4, "kps": 10}.items()
        for stride in STRIDES
    },
)
_MOST_FACES = 5000
_NMS_IOU = 0.3
"""Of two faces that overlap more (intersection over union), the weaker is dropped."""


class YuNet:
    """Finds faces and their five landmarks.

    The box of a head is that of its face (forehead to chin), grown by 15 % of its width on either side, 20 % of its
    height above and 5 % below. A person without a face, for example one who turns away, gets the head of
    :class:`~vfoa.heads.person_mask.PersonMask`, with a lower score and without face and landmarks.
    """

    class Settings(RuntimeSettings):
        """Settings of the network and of what counts as a face."""

        weights: str = "yunet_n_dynamic.onnx"
        """Path of the network, or a file's name in the folders of weights."""
        score_threshold: float = Field(default=0.6, gt=0, le=1)
        """Least score of a face."""
        max_size_px: int = Field(default=640, ge=32)
        """Shrink larger images to this length before the search. Faces below 10 px in the shrunk image are lost."""
        person_mask: PersonMask.Settings = PersonMask.Settings()
        """How the head of a person without a face is found: at the top of the person's mask."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, settings)
        self._people = PersonMask(settings.person_mask)

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return heads with a face, best first, then the heads of people without a face."""
        return self.with_people(self.faces(frame), frame, instances)

    def with_people(self, faces: tuple[Head, ...], frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return these heads, then those of the people who have none of them.

        A face is that of the person whose mask covers it most, if it covers more than half or if the top of the mask is
        there. A face on a screen, or of someone without a mask, is not that of a person whose mask only touches it.
        """
        people = self._people.detect(frame, instances)
        owners = {_owner(face, people, instances, self.settings.person_mask.label) for face in faces}
        return (*faces, *(head for head in people if head.instance_id not in owners))

    def faces(self, frame: StereoFrame) -> tuple[Head, ...]:
        """Return heads with a face, best first."""
        image = frame.left
        height, width = image.shape[:2]
        scale = min(1.0, self.settings.max_size_px / max(height, width))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        shrunk = cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale < 1 else image
        rows = self._search(np.asarray(shrunk, dtype=np.uint8))
        return tuple(_head(row, np.array([width / size[0], height / size[1]])) for row in rows)

    def _search(self, image: Image) -> Float:
        """Rows (N, 15) of faces, best first: box u, v, width, height, five landmarks, score."""
        _, _, *size = self._model.input_shape("input")
        rows, columns = (own or -(-given // 32) * 32 for own, given in zip(size, image.shape, strict=False))
        beyond = rows - image.shape[0], columns - image.shape[1]
        if min(beyond) < 0:
            raise VfoaError(
                f"{self._model.path}: takes {columns} x {rows} pixels, found {image.shape[1]} x {image.shape[0]}; "
                "expected a smaller heads.max_size_px, or weights with an open input size"
            )
        # a graph of a fixed size gets the image in its upper left corner
        padded = cv2.copyMakeBorder(image, 0, beyond[0], 0, beyond[1], cv2.BORDER_CONSTANT)
        outputs = self._model.run(input=blob(np.asarray(padded, dtype=np.uint8), bgr=True))
        faces = np.concatenate([_decoded(outputs, stride, columns // stride) for stride in STRIDES])
        faces = faces[faces[:, 14] >= self.settings.score_threshold]
        kept = cv2.dnn.NMSBoxes(
            faces[:, :4].tolist(),
            faces[:, 14].tolist(),
            self.settings.score_threshold,
            _NMS_IOU,
            top_k=_MOST_FACES,
        )
        faces = faces[np.asarray(kept, dtype=np.intp).reshape(-1)]
        return faces[np.argsort(-faces[:, 14], kind="stable")]


def _decoded(outputs: dict[str, NDArray[Any]], stride: int, columns: int) -> Float:
    """Decode all cells of one stride into rows (N, 15)."""
    box, points = (outputs[f"{name}_{stride}"][0].astype(np.float64) for name in ("bbox", "kps"))
    cells = np.arange(len(box))
    corner = np.column_stack([cells % columns, cells // columns])
    middle, size = (corner + box[:, :2]) * stride, np.exp(box[:, 2:]) * stride
    landmarks = (corner[:, None] + points.reshape(-1, 5, 2)) * stride
    sure, there = (np.clip(outputs[f"{name}_{stride}"][0], 0, 1) for name in ("cls", "obj"))
    return np.column_stack([middle - size / 2, size, landmarks.reshape(-1, 10), np.sqrt(sure * there)])


def _head(row: Float, scale: Float) -> Head:
    """Return a head at the image's scale, from a row of YuNet, whose integer coordinates are edges of pixels."""
    first, size, landmarks = row[:2] * scale - 0.5, row[2:4] * scale, row[4:14].reshape(5, 2) * scale - 0.5
    face = np.concatenate([first, first + size])
    return Head(
        box_px=head_box(face),
        score=float(row[14]),
        face_box_px=face,
        landmarks_px=landmarks,
    )


def _owner(face: Head, people: Iterable[Head], instances: Instances, label: str) -> int | None:
    """Return the person of a face, among instances with this label and heads from their masks; None if it is nobody's.

    See :meth:`YuNet.with_people`.
    """
    assert face.face_box_px is not None
    height, width = instances.ids.shape
    u0, v0, u1, v1 = np.clip(np.rint(face.face_box_px), 0, [width, height] * 2).astype(int)
    inside = instances.ids[v0:v1, u0:u1]
    covered = {person.id: int((inside == person.id).sum()) for person in instances.instances if person.label == label}
    best = max(covered, key=lambda id_: covered[id_], default=None)
    if best is None or not covered[best]:
        return None
    tops = [center(head.box_px) for head in people if head.instance_id == best]
    is_at_top = any((face.box_px[:2] <= top).all() and (top <= face.box_px[2:]).all() for top in tops)
    return best if is_at_top or 2 * covered[best] > inside.size else None
