"""``vfoa init``: a working directory with a clip of two frames, its labels, and an experiment that runs at once."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.terminal import say

if TYPE_CHECKING:
    from vfoa.types import StereoRig

_README = """# A working directory of vfoa

    vfoa run                       the table of experiments/first.toml; then runs/first/report.html
    vfoa view runs/first           its recording in the Rerun viewer
    vfoa annotate example          change who looks at what, in the browser
    vfoa clips add PATH            a clip of your own: images, video, recording

datasets/     a .toml for each clip: where its files are, who is in it
annotations/  a .csv for each clip: who looks at what in which frames
experiments/  clips under configurations
data/example  a rendered stereo pair, its calibration, and what models would find in it
"""

_CLIP = """# Two rendered frames: anna looks at ben, ben at the bear.
name = "example"
adapter = "stereo_folder"
root = "../data/example"

[source]
left = "left/%04d.png"
right = "right/%04d.png"
rate_hz = {rate_hz}

[source.camera]
{camera}
{names}"""

_LABELS = """# vfoa annotations 1
first_frame,last_frame,subject,target,note
1,2,anna,ben,
1,2,ben,bear,
"""

_EXPERIMENT = """# Two matchers x two sets of cones. What needs weights is read from files: masks, heads, poses, gazes.
clips = ["example"]

[defaults.stereo]
min_depth_m = 0.8

[defaults.segmentation]
model = "coco_panoptic"
root = "data/${CLIP}"

[defaults.heads]
detector = "files"
root = "data/${CLIP}"

[defaults.head_pose]
model = "files"
root = "data/${CLIP}"

[defaults.gaze]
model = "files"
root = "data/${CLIP}"

[grid]
"stereo.matcher" = ["bm", "sgbm"]
"attention.cones_cm" = { one = [10], two = [10, 25] }
"""

_FRAMES = (1, 2)


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Directory; it is made if it does not exist.")],
) -> None:
    """Make a working directory: the data folders, and an example clip with labels and an experiment.

    Files that exist stay as they are.
    """
    from vfoa.errors import VfoaError

    for name in ("datasets", "annotations", "experiments"):
        try:
            (folder / name).mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise VfoaError(f"{folder / name}: found a file; expected a folder") from None
    with tempfile.TemporaryDirectory(dir=folder, prefix=".init-") as temporary:
        made = Path(temporary)
        _write_example(made)
        for path in sorted(path for path in made.rglob("*") if path.is_file()):
            target = folder / path.relative_to(made)
            if not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.move(path, target)
    say((folder / "README.md").read_text(encoding="utf-8"), nl=False)
    inside = "" if folder.resolve() == Path.cwd() else f"cd {folder} && "
    say(f"next: {inside}vfoa run")


def _write_example(folder: Path) -> None:
    """Write the example clip, its labels and its experiment into a folder."""
    from harness.clips.manifest import load_manifest
    from harness.files.io import write_together
    from harness.files.parsing import toml_value

    talk = load_manifest("studio_talk")
    rig = _write_data(folder / "data" / "example")
    camera = {"fx_px": rig.fx_px, "cx_px": rig.cx_px, "cy_px": rig.cy_px, "baseline_m": rig.baseline_m}
    names = [
        f'\n[{table}.{key}]\ncategory = "{rule.category}"\ninstance = {rule.instance}\n'
        for table, rules in (("subjects", talk.subjects), ("targets", talk.targets))
        for key, rule in rules.items()
    ]
    manifest = _CLIP.format(
        rate_hz=toml_value(talk.open().rate_hz),
        camera="".join(f"{key} = {toml_value(value)}\n" for key, value in camera.items()),
        names="".join(names).lstrip("\n"),
    )
    write_together(
        {
            folder / "README.md": _README,
            folder / "datasets" / "example.toml": manifest,
            folder / "annotations" / "example.csv": _LABELS,
            folder / "experiments" / "first.toml": _EXPERIMENT,
        }
    )


def _write_data(folder: Path) -> StereoRig:
    """Render the pairs, and write them with what the demo's stages find in them; return the rig."""
    import cv2

    from harness.clips.manifest import load_manifest
    from harness.files.io import atomic_write
    from harness.run.experiment import load_experiment
    from harness.sources import MeasuredClip
    from harness.stages.outputs.write import write_stage_outputs
    from harness.stages.slots import SLOTS
    from vfoa.pipeline import Stages, perceive

    clip = load_manifest("studio_talk").open()
    assert not isinstance(clip, MeasuredClip)
    choices = load_experiment("demo").configurations[0].choices
    built = {slot: SLOTS[slot].build(choice, clip) for slot, choice in choices.items() if choice}
    stages = Stages(
        matcher=built["stereo"],
        segmenter=built["segmentation"],
        heads=built["heads"],
        head_pose=built["head_pose"],
        gaze=built["gaze"],
    )
    frames = [clip.frame(number) for number in _FRAMES]
    write_stage_outputs(folder, [perceive(frame, stages) for frame in frames])
    for frame in frames:
        for side, image in (("left", frame.left), ("right", frame.right)):
            png = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes()
            atomic_write(folder / side / f"{frame.index:04d}.png", png)
    return frames[0].rig
