"""Records of frames as Hypothesis draws them: every field with every kind of value that it may have."""

from __future__ import annotations

from hypothesis import strategies as st

from harness.run.records import AttentionRecord, BoxRecord, FrameRecord, SubjectRecord, TargetRecord
from vfoa.types import DirectionFit

numbers = st.floats(allow_nan=False, allow_infinity=False)
vectors = st.tuples(numbers, numbers, numbers)
boxes_px = st.tuples(numbers, numbers, numbers, numbers)
ids = st.integers(1, 2**16 - 1)
fits = st.builds(
    DirectionFit,
    tail=numbers,
    claimed_error_rad=st.none() | numbers,
    implied_error_rad=st.none() | numbers,
    implied_share=st.none() | numbers,
)


@st.composite
def records(draw: st.DrawFn) -> FrameRecord:
    """Any record that the pipeline may make."""
    instances = draw(st.lists(ids, unique=True, min_size=1, max_size=4))
    boxes = st.builds(BoxRecord, center_m=vectors, half_size_m=vectors, axes=st.tuples(vectors, vectors, vectors))
    targets = [
        draw(
            st.builds(
                TargetRecord,
                instance_id=st.just(instance),
                name=st.text(),
                label=st.text(),
                score=numbers,
                box_px=st.none() | boxes_px,
                points=st.integers(0, 10**6),
                box=st.none() | boxes,
                depth_from=st.none() | st.integers(0, 2**62),
            )
        )
        for instance in instances
    ]
    values = st.builds(
        AttentionRecord,
        instance_id=st.sampled_from(instances),
        gaze=st.none() | numbers,
        head=st.none() | numbers,
        total=numbers,
    )
    subjects = st.builds(
        SubjectRecord,
        track_id=ids,
        name=st.none() | st.text(),
        instance_id=st.none() | ids,
        head_box_px=st.none() | boxes_px,
        eye_origin_m=st.none() | vectors,
        gaze=st.none() | vectors,
        gaze_sigma_rad=st.none() | numbers,
        head=st.none() | vectors,
        missing=st.none() | st.sampled_from(["no_eyes_3d", "no_direction"]),
        attention=st.lists(values, max_size=3).map(tuple),
        focus=st.none() | st.sampled_from(instances),
        tied=st.lists(ids, max_size=2).map(tuple),
        fit=st.none() | fits,
        no_gaze=st.none() | st.just("face_turned_away"),
        head_width_m=st.none() | numbers,
        depth_from=st.none() | st.integers(0, 2**62),
    )
    return FrameRecord(
        clip=draw(st.text()),
        configuration=draw(st.text()),
        frame=draw(st.integers(-(2**62), 2**62)),
        time_ns=draw(st.integers(0, 2**62)),
        targets=tuple(targets),
        subjects=tuple(draw(st.lists(subjects, max_size=2))),
        masks_from=draw(st.none() | st.integers(0, 2**62)),
        masks_age_s=draw(st.none() | numbers),
    )
