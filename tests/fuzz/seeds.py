"""Whole files to begin with: each function writes one at a path, by the project's own writers or the tests'."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from openpyxl import Workbook

from harness.labels.formats import FORMATS
from harness.labels.labels import Labels
from harness.run.results import to_line
from tests.disk import write_text
from tests.exchanges import exchange, row, staged
from tests.harness.damage import project
from tests.measured import idiap_file, measured_tables
from tests.records import answers

MANIFEST = (
    project.MANIFEST.replace('"../images"\n', '"../images"\nlicence = "CC0"\n')
    .replace('"person"\n', '"person"\nat_px = [10, 20]\n')
    .replace('"cup"\n', '"cup"\ninstance = 2\n')
)
MEASURED = """\
name = "mine"
adapter = "measured"
root = "../talk"
[source]
people_file = "people.csv"
objects = { robot = { center_m = [0, 0, 0], size_m = [0.3, 0.3, 0.3] } }
[subjects.anna]
category = "person"
[targets.robot]
category = "robot"
"""
RECORDED = """\
name = "mine"
adapter = "rosbag"
root = "../take.bag"
[source]
stamps = "log"
tolerance_ms = 3.5
camera = { fx_px = 50.0, cx_px = 31.5, cy_px = 23.5, baseline_m = 0.1 }
[subjects.anna]
category = "person"
"""
EXPERIMENT = """\
clips = ["studio_table"]
preset = "realtime"

[[configuration]]
name = "one"
stereo = { matcher = "sgbm", min_depth_m = 0.5 }
segmentation = { model = "coco_panoptic", root = "masks", stuff = ["sky"] }
heads = { detector = "person_mask" }
head_pose.model = "none"
gaze = { model = "simulated", error_deg = 5.0 }
attention = { method = "bayes", smoothing = "forward" }

[[configuration]]
name = "two"
stereo.matcher = "bm"
segmentation.model = "truth"
heads.detector = "truth"
head_pose.model = "truth"
gaze.model = "truth"
attention.cones_cm = [10, 25]
"""
FITTED = """\
[fit]
experiment = "mine"
configuration = "logit"
clips = ["talk", "table"]
people = 2
labelled_s = 60.0
version = "0.1.0"

[[fit.held_out]]
method = "fitted, forward"
n = 120
log_loss = 0.5
calibration_error = 0.02
balanced_frr = 0.7
frr = 0.8

[attention]
method = "logit"
"""
LABELS = (
    "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"
    '1,3,anna,mug,\n4,4,anna,book,"a, b"\n5,9,anna,none,\n'
)


DRAWN = (
    "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n"
    "1,mug,box,1,2,30.5,40,\n9,mug,box,4,2,33,40,1\n2,book,point,7,8,,,\n1,anna,head,5,6,25,36,\n"
)
CVAT_TRACKS = (
    '<annotations><version>1.1</version><track id="0" label="bird">'
    '<box frame="0" keyframe="1" outside="0" xtl="1" ytl="2" xbr="9" ybr="8"/>'
    '<box frame="5" keyframe="0" outside="1" xtl="3" ytl="2" xbr="11" ybr="8"/></track>'
    '<track id="1" label="cup"><points frame="2" keyframe="1" outside="0" points="7.5,8.5"/></track></annotations>'
)


def drawn(path: Path) -> None:
    write_text(path, DRAWN)


def cvat_tracks(path: Path) -> None:
    write_text(path, CVAT_TRACKS)


def manifest(path: Path) -> None:
    write_text(path, MANIFEST)


def measured_manifest(path: Path) -> None:
    write_text(path, MEASURED)


def recorded(path: Path) -> None:
    write_text(path, RECORDED)


def experiment(path: Path) -> None:
    write_text(path, EXPERIMENT)


def fitted(path: Path) -> None:
    write_text(path, FITTED)


def labels(path: Path) -> None:
    write_text(path, LABELS)


def results(path: Path) -> None:
    write_text(path, "".join(map(to_line, answers(["mug", "none", None, "book"]))))


# Labels of other programs

_ROWS = Labels([row(1, 3, "bird"), row(4, 9, "none"), row(10, 12, "bird", note="a"), row(2, 8, "cup", "boy")])


def exported(name: str) -> Callable[[Path], Any]:
    def write(path: Path) -> None:
        clip, bodies = staged()
        FORMATS.load(name)().write(path, _ROWS, exchange(clip, bodies=bodies))

    return write


def boris_project(path: Path) -> None:
    looks = [[0.08, "girl", "bird", "", "eyes shut", 2], [0.0, "girl", "bird", "", "", 0]]
    events = [*looks, [0.1, "boy", "nod", "", "", 3]]
    behaviours = {"0": {"code": "bird", "type": "State event"}, "1": {"code": "nod", "type": "Point event"}}
    media = {"offset": {"1": 0.0}, "fps": {"a.mp4": 25.0}}
    observations = {"talk": {"type": "MEDIA", "events": events, "media_info": media}}
    content = {"project_format_version": "7.0", "behaviors_conf": behaviours, "observations": observations}
    write_text(path, json.dumps(content))


def boris_packed(path: Path) -> None:
    boris_project(path)
    path.write_bytes(gzip.compress(path.read_bytes(), mtime=0))


def boris_workbook(path: Path) -> None:
    book = Workbook()
    book.active.append(["Time", "Subject", "Behavior", "Behavior type", "Comment"])
    for time, kind in ((0.04, "START"), (0.2, "STOP")):
        book.active.append([time, "girl", "bird", kind, None])
    book.save(path)


def attention_target(path: Path) -> None:
    write_text(path, "00000001.jpg,30,2,40,12,5,5\n00000002.jpg,30,2,40,12,-1,-1\n00000003.jpg,30,2,40,12,-1,7.5\n")


def idiap_arrays(path: Path) -> None:
    np.savez(path, **{"Person 1": [0, 0, 1, 1, 2, 2], "Person 2": [1] * 6})


def idiap_table(path: Path) -> None:
    text = idiap_file(path.parent).read_text()
    stamps = list(dict.fromkeys(line.split(",")[0] for line in text.splitlines()))
    lines = (f"{stamp},1,robot\n{stamp},2,unfocused\n" for stamp in stamps)
    write_text(path, "time_ns,person,looks_at\n" + "".join(lines))


# Tables


def signals(path: Path) -> None:
    write_text(path, "frame,subject,x,y,z\n1,anna,0,0,1\n2,anna,0.5,-0.5,1e0\n2,ben,,,\n")


def heads(path: Path) -> None:
    header = "frame,subject,u0_px,v0_px,u1_px,v1_px,score,instance_id\n"
    write_text(path, f"{header}1,anna,1,2,30.5,40,0.5,1\n2,anna,1,2,3,4,,\n")


def people(path: Path) -> None:
    path.write_bytes((measured_tables(path.parent, range(1, 5)) / "people.csv").read_bytes())


def objects(path: Path) -> None:
    measured_tables(path.parent, range(1, 5))


def people_parquet(path: Path) -> None:
    people(path.with_suffix(".csv"))
    pd.read_csv(path.with_suffix(".csv")).to_parquet(path, compression=None)


def idiap_tracker(path: Path) -> None:
    idiap_file(path.parent, 4)


def stamps(path: Path) -> None:
    write_text(path, "# timestamp filename\n1305031102.175304 rgb/1.png\n1305031102.211214 rgb/2.png\n")
