from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from harness.clips.families import clip_files
from harness.clips.manifest import as_clip_name, clips_here, load_manifest, make_manifest, manifest_of_run
from harness.files.remote import expand
from harness.labels.labels import timeline_of
from harness.run.experiment import load_experiment
from tests.disk import labels_text, sintel_scene, write_text
from tests.measured import measured_tables, true_labels
from vfoa.errors import VfoaError

GOOD = """
name = "clip"
adapter = "sintel"
root = "data"
licence = "CC0"
notes = ["made here"]

[source]
scene = "alley"

[subjects.girl]
category = "person"

[targets.bird]
category = "bird"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    sintel_scene(tmp_path / "datasets" / "data")
    return tmp_path / "datasets"


def _write(folder: Path, text: str = GOOD) -> Path:
    return write_text(folder / "clip.toml", text)


def test_a_manifest_opens_its_clip_relative_to_itself(folder: Path) -> None:
    manifest = load_manifest(_write(folder))
    assert (manifest.name, manifest.notes, list(manifest.subjects)) == ("clip", ("made here",), ["girl"])
    assert list(manifest.open().frames) == [1, 2, 3]


def test_a_manifest_and_its_clip_travel_to_another_process(folder: Path) -> None:
    manifest = pickle.loads(pickle.dumps(load_manifest(_write(folder))))
    assert manifest.path == folder / "clip.toml"
    clip = pickle.loads(pickle.dumps(manifest.open()))
    assert clip.frame(2).index == 2


def test_the_working_directory_comes_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_text(folder / "sintel_bandage_2.toml", GOOD.replace('"clip"', '"sintel_bandage_2"'))
    monkeypatch.chdir(folder.parent)
    assert load_manifest("sintel_bandage_2").licence == "CC0"
    monkeypatch.chdir(folder)
    assert load_manifest("sintel_bandage_2").licence != "CC0"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("licence =", "license =", r"clip\.toml: .*'license'.*'licence'"),
        (
            "[subjects.girl]\n",
            "[subjects.girl]\nfrom_lefts = 1\n",
            r"'subjects\.girl\.from_lefts'.*from_left",
        ),
        ('category = "bird"', "category = 3", r"targets\.bird\.category: .*found 3"),
        ('category = "bird"', "", r"targets\.bird\.category: missing"),
        ('category = "bird"', 'category = "b"\nfrom_left = 0', r"targets\.bird\.from_left: .*0"),
        ('category = "bird"', 'category = "b"\nat_px = [1.0]', r"targets\.bird\.at_px\.1: missing"),
        (
            'category = "bird"',
            'category = "b"\nat_px = [1, 2]\ninstance = 1',
            r"targets\.bird: found instance and at_px",
        ),
        ("[targets.bird]", "[targets.none]", r"targets: found the name 'none'"),
        ("[targets.bird]", '[targets."(nothing hit)"]', r"targets: found the name '\(nothing hit\)'"),
        ("[targets.bird]", "[targets.no_hit]", r"targets: found the name 'no_hit'"),
        ("[targets.bird]", '[targets."bird (another of this name)"]', r"targets: found the name 'bird \(another"),
        ("[subjects.girl]", '[subjects."(all)"]', r"subjects: found the name '\(all\)'"),
        ("[subjects.girl]", '[subjects."girl#1"]', r"subjects: found the name 'girl#1'"),
        ("[targets.bird]", "[targets.girl]", r"targets\.girl: a subject has this name"),
        (
            "[targets.bird]",
            '[targets.b]\ncategory="bird"\n[targets.bird]',
            r"targets\.bird: .*'bird' is 'b'",
        ),
        (
            "[targets.bird]",
            "[phases]\na = { things = 2 }\nb = { things = 2 }\n[targets.bird]",
            r"phases: b: things: 2 .*'a'",
        ),
        ("[targets.bird]", "[phases.a]\nthing = 2\n[targets.bird]", r"unknown key 'phases\.a\.thing'.*things"),
        ('name = "clip"', 'name = "other"', r"name: found 'other'; expected 'clip'"),
        ('name = "clip"', 'name = "../clip"', r"name: "),
        ('name = "clip"', 'name = "clip__two"', r"name: found .clip__two.; expected letters"),
        ('name = "clip"', "name = ", r"not TOML: .*line 2"),
    ],
)
def test_a_mistake_is_one_line_with_file_and_key(folder: Path, old: str, new: str, message: str) -> None:
    path = _write(folder, GOOD.replace(old, new))
    with pytest.raises(VfoaError, match=message) as error:
        load_manifest(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('scene = "alley"', 'scenes = "alley"', r"'source\.scenes'.*'scene'"),
        (
            'scene = "alley"',
            'scene = "alley"\npass = "clear"',
            r"source\.pass: .*found 'clear'",
        ),
        ('scene = "alley"', 'scene = "valley"', r"'valley'.*'alley'"),
        ('adapter = "sintel"', 'adapter = "sintl"', r"adapter: .*'sintl'.*'sintel'"),
        ('root = "data"', 'root = "elsewhere"', r"elsewhere/training: no such folder"),
        ('root = "data"', 'root = "${VFOA_NOT_SET}/x"', r"root: .*VFOA_NOT_SET"),
    ],
)
def test_what_cannot_be_opened_is_one_line(folder: Path, old: str, new: str, message: str) -> None:
    manifest = load_manifest(_write(folder, GOOD.replace(old, new)))
    with pytest.raises(VfoaError, match=message) as error:
        manifest.open()
    assert str(error.value).startswith(f"{folder / 'clip.toml'}: ")


def test_an_environment_variable_is_filled_in(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VFOA_CLIPS", str(folder))
    manifest = load_manifest(_write(folder, GOOD.replace('root = "data"', 'root = "${VFOA_CLIPS}/data"')))
    assert manifest.resolve_root() == folder / "data"


def test_an_unknown_clip_gets_the_nearest_name() -> None:
    with pytest.raises(VfoaError, match=r"'sintel_bandage2'.*'sintel_bandage_2'"):
        load_manifest("sintel_bandage2")


def test_labels_stand_beside_the_manifest(folder: Path) -> None:
    path = write_text(folder.parent / "annotations" / "clip.csv", labels_text("1,2,girl,bird,"))
    manifest = load_manifest(_write(folder))
    assert manifest.annotations.find() == path
    labels = manifest.labels(timeline_of(manifest.open()))
    assert labels is not None
    assert [frame for frame, _, _ in labels.labelled([1, 2, 3])] == [1, 2]


def test_a_clip_without_labels_has_none(folder: Path) -> None:
    assert load_manifest(_write(folder)).labels(None) is None


@pytest.mark.parametrize("name", clip_files())
def test_every_manifest_that_comes_along_is_right_with_its_labels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("VFOA_DATA", str(tmp_path))
    manifest = load_manifest(name)
    assert manifest.licence
    manifest.labels(None)


def test_a_user_whom_nobody_knows_has_no_home(tmp_path: Path) -> None:
    assert expand("~nobody-knows/data", tmp_path, "root") == tmp_path / "~nobody-knows/data"
    assert expand("~/data", tmp_path, "root") == Path.home() / "data"


FAMILY = """
adapter = "measured"
root = "files/${CLIP}"
labels_file = "labels.csv"
subjects = { "${WHO}" = { category = "person" } }
[clips]
talk_1 = { WHO = "anna" }
talk_2 = { WHO = "ben" }
"""


def test_a_family_makes_a_clip_of_each_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", FAMILY)
    manifest = load_manifest("talk_2")
    assert (manifest.name, list(manifest.subjects), manifest.root) == ("talk_2", ["ben"], "files/talk_2")
    assert load_manifest(manifest.path, "talk_1").name == "talk_1"
    assert {"talk_1", "talk_2"} <= clip_files().keys()
    assert "talks" not in clip_files()
    measured_tables(tmp_path / "datasets" / "files" / "talk_2")
    assert clips_here(["talks", "other"]) == (("talk_2", "other"), ("talk_1",))
    assert clips_here(["datasets/talks.toml"]) == clips_here(["talks"])
    assert load_experiment("conversation", clips=("talks",)).missing == ("Not here, and not run: talk_1.",)


def test_a_clip_of_two_families_is_refused_and_of_one_s_own_and_a_packaged_one_it_is_one_s_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", FAMILY.replace("talk_2", "kitchen_p09"))
    assert list(load_manifest("kitchen_p09").subjects) == ["ben"]
    write_text(tmp_path / "datasets" / "talks_of_before.toml", FAMILY.replace("files", "others"))
    with pytest.raises(VfoaError, match=r"talks\.toml: clips\.talk_1: talks_of_before\.toml has it, too"):
        clips_here(["talks"])
    assert load_manifest("talk_2").root == "others/talk_2"
    write_text(tmp_path / "datasets" / "talk_1.toml", 'name = "talk_1"\nadapter = "measured"\nroot = "mine"\n')
    assert load_manifest("talk_1").root == "mine"


TABLES = FAMILY.partition("[clips]")[0] + '[clips.talk_1]\nWHO = "anna"\n[clips.talk_2]\nWHO = "ben"\n'


@pytest.mark.parametrize(
    "text",
    [
        TABLES,
        TABLES.replace("[clips.talk_1]", "[ clips . 'talk_1' ]"),
        'clips.talk_1.WHO = "anna"\nclips.talk_2.WHO = "ben"\n' + FAMILY.partition("[clips]")[0],
        'clips = { talk_1 = { WHO = "anna" }, talk_2 = { WHO = "ben" } }\n' + FAMILY.partition("[clips]")[0],
    ],
    ids=["tables", "blanks", "dotted", "inline"],
)
def test_a_family_is_one_in_every_form_of_its_table(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", text)
    assert [list(load_manifest(name).subjects) for name in ("talk_1", "talk_2")] == [["anna"], ["ben"]]
    assert "talks" not in clip_files()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('{ WHO = "ben" }', "{}", r"clips\.talk_2: WHO: .*\$\{WHO\}.*none"),
        ('{ WHO = "ben" }', '{ WHOM = "ben" }', r"clips\.talk_2: WHO: missing.*found: WHOM"),
        ('${CLIP}"', '${CLIP}/${WHO}"\nlicence = "${LICENCE}"', r"clips\.talk_2: LICENCE: missing"),
        ('{ WHO = "ben" }', '{ WHO = ["ben"] }', "clips: expected a table"),
    ],
)
def test_a_variable_of_a_family_without_a_value_is_named(
    old: str, new: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", FAMILY.replace(old, new))
    with pytest.raises(VfoaError, match=rf"talks\.toml: {message}"):
        load_manifest("talk_2")


def test_a_root_takes_variables_of_the_environment_unless_they_are_the_familys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_TALKS", "files")
    monkeypatch.setenv("WHO", "carl")
    text = FAMILY.replace("files/${CLIP}", "${VFOA_TALKS}/${WHO}")
    path = write_text(tmp_path / "datasets" / "talks.toml", text)
    assert load_manifest("talk_2").resolve_root() == path.parent / "files" / "ben"
    write_text(path, text.replace('{ WHO = "ben" }', "{}"))
    with pytest.raises(VfoaError, match=r"talks\.toml: clips\.talk_2: WHO: "):
        load_manifest("talk_2")


def test_labels_among_the_files_that_are_not_there_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", FAMILY)
    measured_tables(tmp_path / "datasets" / "files" / "talk_1")
    manifest = load_manifest("talk_1")
    with pytest.raises(VfoaError, match=r"talks\.toml: .*talk_1/labels\.csv: "):
        manifest.labels(None)
    own = write_text(manifest.annotations.place(), true_labels())
    assert manifest.annotations.find() == own


def test_labels_among_the_files_count_until_there_are_annotations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", FAMILY)
    manifest = load_manifest("talk_1")
    assert manifest.annotations.find() is None
    with_clip = write_text(tmp_path / "datasets" / "files" / "talk_1" / "labels.csv", true_labels())
    assert manifest.annotations.find() == with_clip
    own = write_text(tmp_path / "annotations" / "talk_1.csv", true_labels())
    assert manifest.annotations.find() == own


def test_a_runs_clip_that_was_taken_out_of_its_family_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    family = write_text(tmp_path / "datasets" / "talks.toml", FAMILY)
    assert manifest_of_run(str(family), "talk_2", None).path == family
    write_text(family, "".join(line for line in FAMILY.splitlines(keepends=True) if "ben" not in line))
    with pytest.raises(VfoaError, match=r"talks\.toml: no clip 'talk_2'"):
        manifest_of_run(str(family), "talk_2", None)
    text = 'name = "talk_2"\nadapter = "measured"\nroot = "mine"\n'
    own = write_text(tmp_path / "datasets" / "talk_2.toml", text)
    assert manifest_of_run(str(family), "talk_2", None).path == own


def test_a_runs_clip_that_was_renamed_says_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(VfoaError, match=rf"^no clip 'talk': .*{tmp_path}/datasets/talk\.toml"):
        manifest_of_run(str(tmp_path / "datasets" / "talk.toml"), "talk", None)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("talks", r"talks: .*talk_1, talk_2"),
        ("datasets/talks.toml", r"talks\.toml: .*by name: talk_1, talk_2"),
        ("talk_3", "no clip 'talk_3'; did you mean 'talk_"),
    ],
)
def test_a_family_is_not_a_clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, message: str) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", FAMILY)
    with pytest.raises(VfoaError, match=message):
        load_manifest(name)


def test_a_pattern_means_the_clips_that_match(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One's own come alone: ``studio_*`` means built-in clips until there is a clip of one's own of this name."""
    monkeypatch.chdir(tmp_path)
    built_in = clips_here(["studio_*"])[0]
    assert {"studio_table", "studio_talk"} <= {*built_in}
    for name in ("p2", "p10", "p1", "q1", "studio_mine"):
        write_text(tmp_path / "datasets" / f"{name}.toml", FAMILY.partition("[clips]")[0])
    assert clips_here(["p*"]) == (("p1", "p2", "p10"), ())
    assert clips_here(["p10", "p?", "p*"]) == (("p10", "p1", "p2"), ())
    assert clips_here(["studio_*"])[0] == ("studio_mine",)
    with pytest.raises(VfoaError, match=r"no clip matches 'r\*'"):
        load_experiment("conversation", clips=("r*",))


def test_a_family_without_a_clip_here_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "talks.toml", FAMILY)
    with pytest.raises(VfoaError, match=r"talks: .*2 clips.*talk_1"):
        load_experiment("conversation", clips=("talks",))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Übung 1 (Café)", "Ubung_1_Cafe"),
        ("2024-05-01 14.30", "2024-05-01_14.30"),
        ("a__b", "a_b"),
        ("..hidden", "hidden"),
        ("会話", "clip"),
    ],
)
def test_any_text_becomes_a_name_that_a_manifest_takes(text: str, name: str) -> None:
    assert as_clip_name(text) == name
    assert make_manifest({"name": name, "adapter": "measured"}, Path(f"{name}.toml")).name == name


@pytest.mark.parametrize(
    ("name", "source"), [("sintel_bandage_2", "sintel"), ("idiap_vfoa", "idiap_vfoa"), ("kitchen_p09", "vr_objects")]
)
@pytest.mark.parametrize("is_set", [False, True])
def test_a_clip_that_can_be_fetched_says_how(
    name: str, source: str, is_set: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("VFOA_DATA", raising=False)
    if is_set:
        monkeypatch.setenv("VFOA_DATA", str(tmp_path))
    with pytest.raises(VfoaError, match=rf"; fetch it: vfoa clips fetch {source}$"):
        load_manifest(name).open()


def test_a_family_that_can_be_fetched_says_how(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VFOA_DATA", str(tmp_path))
    with pytest.raises(VfoaError, match=r"kitchen_p09; fetch it: vfoa clips fetch vr_objects$"):
        clips_here(["vr_kitchen"])


def test_a_fault_in_files_that_are_here_names_no_download(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VFOA_DATA", str(tmp_path))
    (tmp_path / "kitti_pair").mkdir()
    (tmp_path / "sintel" / "training").mkdir(parents=True)
    for name in ("kitti_pair", "sintel_bandage_2"):
        with pytest.raises(VfoaError) as refused:
            load_manifest(name).open()
        assert "fetch it" not in str(refused.value)
