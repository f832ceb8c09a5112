"""What to try next for each error type, made from what the run's configurations accept.

``--set`` changes every configuration of an experiment that has the setting, so an option is only given where all of
them take it: cones in the unit that they have, stages that a clip of measurements does not have left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from harness.record.layers import Plain
from harness.run.manifest import has_images
from vfoa.cones import ConesSettings
from vfoa.registry import AUTO

WIDE, NARROW = 40.0, 20.0
"""Degrees or cm: cones of the paper have a radius in cm for a height of 1.10 m; 40 cm are 40 degrees, 20 cm are 21."""

VIEW = "vfoa view RUN"
"""The command that shows a run, as pages and tables have it, which may be read anywhere."""
_RECORDED = "in a run with --recording light"  # in a directory of its own: this one holds the run without recordings


@dataclass(frozen=True, slots=True)
class _Run:
    """The configurations of a run, and whether it has recordings."""

    configurations: tuple[Plain, ...]
    is_recorded: bool

    @property
    def view(self) -> str:
        """The command that shows the run; without recordings, which run can be viewed."""
        return VIEW if self.is_recorded else _RECORDED

    @property
    def failures(self) -> str:
        """The command that steps through the wrong frames, as :attr:`view`."""
        return f"{VIEW} --failures" if self.is_recorded else _RECORDED

    def values(self, table: str, key: str) -> list[Any]:
        """The value of a setting in every configuration that has it."""
        tables = (configuration.get(table) or {} for configuration in self.configurations)
        return [settings[key] for settings in tables if key in settings]

    @property
    def has_images(self) -> bool:
        """Whether stages of perception run: a clip of measurements has none."""
        return has_images(self.configurations)

    @property
    def is_default(self) -> bool:
        """Whether nothing of the attention was chosen: no setting of one method stands in the way of another one."""
        default = ConesSettings().model_dump(mode="json")
        return [configuration.get("attention") for configuration in self.configurations] == [default]

    @property
    def wider_cones(self) -> str:
        """The option for one cone that is wider than all; "" as in :meth:`_cones`."""
        return self._cones(lambda widest: WIDE if max(widest) < WIDE else 2 * max(widest))

    @property
    def narrower_cones(self) -> str:
        """The option for one cone that is narrower than the widest of each configuration; "" as in :meth:`_cones`."""
        return self._cones(lambda widest: NARROW if min(widest) > NARROW else min(widest) / 2)

    def _cones(self, size: Callable[[list[float]], float]) -> str:
        """The option for one cone, whose size follows from the widest cone of each configuration.

        "" if the configurations have both units, or no cones, or if there is no cone of this size.
        """
        used = {key: self.values("attention", key) for key in ("cones_deg", "cones_cm")}
        units = [key for key, cones in used.items() if any(cones)]
        if len(units) != 1:
            return ""
        (unit,) = units
        best = size([max(cones) for cones in used[unit] if cones])
        try:
            ConesSettings.model_validate({unit: (best,)})
        except ValidationError:
            return ""
        return f" (--set attention.{unit}=[{best:g}])"

    def another_matcher(self) -> Iterator[str]:
        """Advice to match by the other method, where one method matched in all configurations."""
        used = set(self.values("stereo", "matcher"))
        for matcher, other in (("sgbm", "bm"), ("bm", "sgbm")):
            if used == {matcher}:
                yield f"try another matcher (--set stereo.matcher={other})"


def _no_subject(run: _Run) -> Iterator[str]:
    if set(run.values("segmentation", "people")) == {"none"}:
        yield "people need masks, too: let a segmenter find them (--set segmentation.people=rf_detr_seg)"
    yield "check the subject's rule in the manifest ([subjects.NAME])"
    if run.has_images:
        yield f"see which heads were found ({run.failures})"
        yield from _faces(run)


def _faces(run: _Run) -> Iterator[str]:
    """Advice to find faces, where heads come from the masks of people alone."""
    if set(run.values("heads", "detector")) == {"person_mask"}:
        yield "find heads by their faces, which most networks need (--set heads.detector=yunet)"


def _without_depth(what: str) -> Callable[[_Run], Iterator[str]]:
    def advise(run: _Run) -> Iterator[str]:
        if run.has_images:
            yield f"{what} has no depth: check stereo.min_depth_m and the calibration (vfoa clips check CLIP)"
            yield from run.another_matcher()
        else:
            yield f"{what} was not measured in these frames"

    return advise


def _face_turned_away(run: _Run) -> Iterator[str]:
    if "gaze" in run.values("attention", "weighting"):
        yield "let the head count where the gaze has no answer (--set attention.weighting=adaptive)"
    else:
        yield f"the head counts there: see its pose ({run.failures})"


def _no_direction(run: _Run) -> Iterator[str]:
    if run.has_images:
        if run.configurations and not (run.values("gaze", "model") or run.values("head_pose", "model")):
            yield f"let a model measure the gaze (--set gaze.model={AUTO})"
        yield from _faces(run)
        yield f"see which head boxes had no answer ({run.failures})"
    else:
        yield "neither gaze nor head was measured in these frames"
    yield "coverage says how many frames have an answer"


def _no_answer(run: _Run) -> Iterator[str]:
    yield "the other system has no row for these frames, or a blank target"
    yield "coverage says how many frames have an answer"


def _no_object(run: _Run) -> Iterator[str]:
    yield f"see where the point lies ({run.failures})"
    if run.has_images:
        yield "give more objects a mask, or draw them (vfoa annotate CLIP, key p)"


def _target_not_segmented(run: _Run) -> Iterator[str]:
    if run.has_images:
        is_drawn_alone = set(run.values("segmentation", "model")) == {"drawn"}
        if not is_drawn_alone:
            yield "give the target a category that the model finds ([targets.NAME] in the manifest)"
        is_used = is_drawn_alone or all(run.values("drawn", "targets"))
        use = "" if is_used else ", then use the drawing (--set drawn.targets=true)"
        yield f"draw it on some frames (vfoa annotate CLIP, key p){use}"
        yield 'take another model, or masks of your own (segmentation.model = "id_maps")'
    else:
        yield "the target was not measured in these frames"


def _false_attention(run: _Run) -> Iterator[str]:
    yield f"see what was predicted instead ({run.failures})"
    if option := run.narrower_cones:
        yield f"try narrower cones{option}"
    if "nearest" in run.values("attention", "method"):
        yield "let the nearest target count up to a smaller angle (attention.limit_deg)"
    yield from _other_methods(run, "which can answer nowhere")


def _no_hit(run: _Run) -> Iterator[str]:
    if option := run.wider_cones:
        yield f"try wider cones{option}"
    yield from _other_methods(run, "which always has an answer")
    yield f"see where the rays go ({run.failures})"


def _missed(run: _Run) -> Iterator[str]:
    yield f"see by how much gaze and head are off ({run.failures})"
    if option := run.wider_cones:
        yield f"wider cones{option} forgive more, and must be chosen on other clips"


def _outscored(run: _Run) -> Iterator[str]:
    yield f"see what won instead ({run.failures})"
    if run.has_images:
        yield "see which stage costs the frames (vfoa run CLIP --oracle, on a clip with ground truth)"


def _wrong_subject(run: _Run) -> Iterator[str]:
    rule = "at_px or box_px" if run.has_images else "instance"
    yield f"tell people apart by {rule} in the manifest ([subjects.NAME])"
    yield f"see the tracks ({run.view})"


def _other_methods(run: _Run, why: str) -> Iterator[str]:
    """Advice to use the default method, unless a method with probabilities is used."""
    methods = set(run.values("attention", "method"))
    if run.is_default:
        yield f"try the logit, {why} (--set attention.method=logit)"
    elif methods and not methods & {"bayes", "logit"}:
        yield f'try the logit, {why} (add a configuration: attention.method = "logit")'


NEXT_STEPS: Mapping[str, Callable[[_Run], Iterator[str]]] = {
    "no_subject": _no_subject,
    "no_eyes_3d": _without_depth("the head"),
    "face_turned_away": _face_turned_away,
    "no_direction": _no_direction,
    "no_answer": _no_answer,
    "no_object": _no_object,
    "target_not_segmented": _target_not_segmented,
    "target_without_box": _without_depth("the target"),
    "false_attention": _false_attention,
    "wrong_subject": _wrong_subject,
    "no_hit": _no_hit,
    "missed": _missed,
    "outscored": _outscored,
}
"""Advice for each error type: phrases in the imperative, without a full stop."""

_OF_METHOD = ("false_attention", "no_hit", "missed", "outscored")
"""Error types that depend on the method of attention and its inputs, which another system's answers do not have."""


def advice(error_type: str, configurations: Iterable[Plain], *, recorded: bool = True) -> list[str]:
    """What to try next for an error type, in a run with these configurations, the first step first.

    ``recorded``: the run has recordings; without them, steps that look at one name a run that makes them.
    """
    run = _Run(tuple(configurations), recorded)
    if error_type in _OF_METHOD and set(run.values("attention", "method")) == {"answers"}:
        return [f"see what the other system answered ({run.failures})"]
    return list(NEXT_STEPS[error_type](run))
