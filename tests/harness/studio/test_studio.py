"""The rendered clips: their truth agrees with their images, their labels and the geometry it is made of."""

import hashlib
import pickle
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
import zstandard

from harness.clips.manifest import load_manifest
from harness.labels.labels import IGNORED, timeline_of
from harness.pipeline.ground_truth import true_labels
from harness.sources import Truth
from harness.studio import StudioClip, StudioSettings
from harness.studio.clip import _renderer
from harness.studio.material import Material, grain
from harness.studio.mesh import Mesh, box, ellipsoid, tube, turned
from harness.studio.scenario import MEAN_FIXATION_S, SCENARIOS, ScenarioName
from harness.studio.stage import RIG, Stage
from tests.repository import REPOSITORY
from tests.scenes import entry_distance
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between, project
from vfoa.pixels import ViewMaps, known_pixels, points_of
from vfoa.stereo.block_matching import BlockMatcher, SemiGlobalMatcher


class _PeopleAlone:
    """A clip's truth without its pictures, which take long to render, and without lines of sight: none is blocked."""

    def __init__(self, scenario: ScenarioName, frames: range) -> None:
        self.frames, self._stage = frames, Stage(SCENARIOS[scenario], len(frames), 7)

    def truth(self, number: int) -> Truth:
        return Truth(people=self._stage.people(number - 1))


NAMES: tuple[ScenarioName, ...] = ("table", "talk", "split", "crowd")
LONG = 300


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What is rendered here is not what was rendered before, and every frame is rendered once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VFOA_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path))
    return tmp_path


def clip(name: ScenarioName = "table", **settings: int) -> StudioClip:
    return StudioClip(StudioSettings(scenario=name, **settings), None)


class TestMesh:
    @pytest.mark.parametrize(
        "mesh",
        [
            box((1, 2, 3), (0.2, 0.4, 0.6)),
            ellipsoid((0, 1, 0), (0.1, 0.2, 0.3)),
            turned([(0, 0), (0.05, 0), (0.05, 0.1), (0, 0.1)]),
            tube([(0, 0, 0), (0, 0.01, 0.1), (0, 0, 0.2)], (0.01, 0.02, 0.01)),
        ],
        ids=["box", "ellipsoid", "turned", "tube"],
    )
    def test_normals_are_unit_and_point_outwards(self, mesh: Mesh) -> None:
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1)
        middle = mesh.vertices.mean(axis=0)
        assert np.mean(np.einsum("vi,vi->v", mesh.normals, mesh.vertices - middle) > 0) > 0.9
        assert mesh.triangles.max() < len(mesh.vertices)

    def test_an_ellipsoid_has_its_radii(self) -> None:
        mesh = ellipsoid((1, 2, 3), (0.1, 0.2, 0.3), segments=40)
        assert np.allclose(mesh.vertices.max(axis=0), (1.1, 2.2, 3.3), atol=1e-3)
        assert np.allclose((((mesh.vertices - [1, 2, 3]) / [0.1, 0.2, 0.3]) ** 2).sum(axis=1), 1, atol=1e-5)


class TestMaterial:
    def test_grain_is_continuous_and_bounded(self) -> None:
        points = np.random.default_rng(0).uniform(-2, 2, (4000, 3)).astype(np.float32)
        near = points + np.float32(1e-5)
        assert np.abs(grain(points)).max() < 1.5
        assert np.abs(grain(points) - grain(near)).max() < 0.05

    def test_a_wall_of_no_grain_has_one_colour(self) -> None:
        points = np.random.default_rng(0).uniform(-2, 2, (100, 3)).astype(np.float32)
        assert np.ptp(Material(colours=((0.8, 0.8, 0.7),), grain=0).paint(points), axis=0).max() == 0


class TestChoreography:
    """Over long clips: whoever looks at something hits it, and at nothing, nothing."""

    @pytest.mark.parametrize("name", NAMES)
    def test_the_gaze_enters_its_targets_box_before_any_other(self, name: ScenarioName) -> None:
        scenario, stage = SCENARIOS[name], Stage(SCENARIOS[name], LONG, 7)
        ids = {each.name: each.id for each in (*scenario.things, *scenario.actors)}
        for frame in range(0, LONG, 4):
            boxes = stage.boxes(frame)
            for person in stage.people(frame):
                others = [number for number in boxes if number != person.instance_id]
                assert person.gaze_direction is not None
                entries = entry_distance(
                    person.eye_origin_left, person.gaze_direction[None], tuple(boxes[number] for number in others)
                )[0]
                if person.target == "none":
                    assert np.isnan(entries).all(), (frame, person.name)
                elif person.target is not None:
                    assert others[int(np.nanargmin(entries))] == ids[person.target], (frame, person.name)

    @pytest.mark.parametrize("mean_fixation_s", [0.2, MEAN_FIXATION_S, 2])
    @pytest.mark.parametrize("name", NAMES)
    def test_movements_are_as_fast_as_in_life(self, name: ScenarioName, mean_fixation_s: float) -> None:
        """Heads turn below 400 deg/s, and gaze rests on a thing but for the body's sway and a rolling ball."""
        scenario = replace(SCENARIOS[name], mean_fixation_s=mean_fixation_s)
        stage = Stage(scenario, LONG, 7)
        previous = stage.people(0)
        for frame in range(1, 100):
            people = stage.people(frame)
            for person, before in zip(people, previous, strict=True):
                turned_deg = np.degrees(angle_between(person.head_direction, before.head_direction))
                assert turned_deg * scenario.rate_hz < 400
                if person.target is not None and person.target == before.target:
                    shift = np.linalg.norm(person.eye_origin_left - before.eye_origin_left)
                    moved_deg = np.degrees(angle_between(person.gaze_direction, before.gaze_direction))
                    assert moved_deg <= np.degrees(np.arctan2(shift + 0.01, 0.4)) + 0.2
            previous = people

    @pytest.mark.parametrize("mean_fixation_s", [0.3, 2])
    def test_a_thing_is_looked_at_for_the_time_that_was_asked_for(self, mean_fixation_s: float) -> None:
        scenario = replace(SCENARIOS["table"], mean_fixation_s=mean_fixation_s)
        stage = Stage(scenario, 1000, 7)
        targets = [stage.people(frame)[0].target for frame in range(1000)]
        runs = [(target, len(list(run))) for target, run in groupby(targets)][:-1]  # the last one is cut off
        assert {frames for target, frames in runs if target is None} == {3}
        lasted_s = np.mean([frames for target, frames in runs if target is not None]) / scenario.rate_hz
        assert lasted_s == pytest.approx(mean_fixation_s, abs=1 / scenario.rate_hz, rel=0.1)  # a whole number of frames

    def test_in_the_split_clip_head_and_gaze_are_apart(self) -> None:
        stage = Stage(SCENARIOS["split"], LONG, 7)
        settled = [person for frame in range(8, LONG, 40) for person in stage.people(frame) if person.target]
        apart = [np.degrees(angle_between(each.gaze_direction, each.head_direction)) for each in settled]
        assert min(apart) > 20
        assert max(apart) < 55  # what eyes can turn in the head

    def test_a_longer_clip_begins_with_the_shorter_one(self) -> None:
        short, long = (Stage(SCENARIOS["crowd"], frames, 7) for frames in (60, 500))
        for one, other in zip(short.people(59), long.people(59), strict=True):
            assert one.target == other.target
            assert np.array_equal(one.gaze_direction, other.gaze_direction)

    def test_another_seed_is_another_performance(self) -> None:
        one, other = (Stage(SCENARIOS["talk"], 60, seed) for seed in (1, 2))
        assert any(one.people(frame)[0].target != other.people(frame)[0].target for frame in range(60))


class TestTruth:
    @pytest.mark.parametrize("name", NAMES)
    def test_surfaces_lie_in_the_boxes_and_on_their_faces(self, name: ScenarioName) -> None:
        truth = clip(name).truth(5)
        assert truth.disparity is not None
        depth_m = RIG.fx_px * RIG.baseline_m / truth.disparity.disparity_px
        assert np.nanmin(depth_m) > StudioClip.nearest_m
        assert truth.instances is not None
        assert truth.boxes is not None
        seen = ViewMaps(disparity=truth.disparity, instances=truth.instances, rig=RIG)
        whole = slice(0, RIG.height_px), slice(0, RIG.width_px)
        for number, found in truth.boxes.items():
            points = points_of(known_pixels(truth.instances.mask(number), whole, seen), seen)
            assert len(points) > 300, number
            assert (np.abs(points - found.center_m) <= found.half_size_m + 1e-3).all(), number
            # The camera sees the near face of every whole thing to within its curvature.
            assert points[:, 2].min() < found.center_m[2] + 1e-3, number

    @pytest.mark.parametrize("name", NAMES)
    def test_heads_are_where_the_person_is_seen(self, name: ScenarioName) -> None:
        truth = clip(name).truth(5)
        assert truth.people is not None
        assert truth.instances is not None
        for person in truth.people:
            u0, v0, u1, v1 = np.round(person.head_box_px).astype(int)
            person_px = truth.instances.mask(person.instance_id)
            assert person_px[v0:v1, u0:u1].mean() > 0.5
            assert not person_px[: max(v0, 0)].any()  # nothing of a person is above the head
            u, v = project(person.eye_origin_left, RIG)
            assert u0 <= u <= u1
            assert v0 <= v <= v1

    def test_the_eye_origin_is_on_the_visible_face(self) -> None:
        """If the face is turned to the camera, the surface seen at the eyes' pixel is the eye origin."""
        truth = clip("crowd").truth(5)
        assert truth.people is not None
        assert truth.disparity is not None
        for person in truth.people:
            u, v = np.round(project(person.eye_origin_left, RIG)).astype(int)
            depth = RIG.fx_px * RIG.baseline_m / truth.disparity.disparity_px[v, u]
            assert depth == pytest.approx(person.eye_origin_left[2], abs=0.01)

    def test_the_ball_moves_and_keeps_its_size(self) -> None:
        sizes, places = [], []
        for number in (1, 30, 60):
            boxes = clip("crowd").truth(number).boxes
            assert boxes is not None
            sizes.append(boxes[8].half_size_m)
            places.append(boxes[8].center_m)
        assert np.ptp(places, axis=0).max() > 0.05
        assert np.allclose(sizes, 0.075, atol=1e-3)

    def test_things_have_coco_names_and_stuff_is_stuff(self) -> None:
        instances = clip("talk").truth(1).instances
        assert instances is not None
        things = {instance.label for instance in instances.instances if instance.is_thing}
        assert things == {"person", "cup", "teddy bear", "bowl", "potted plant"}
        assert {instance.label for instance in instances.instances if not instance.is_thing} <= {
            "wall",
            "floor",
            "table",
            "curtain",
        }


class TestImages:
    def test_the_right_view_is_the_left_one_moved_by_the_disparity(self) -> None:
        source = clip("table")
        frame, truth = source.frame(1), source.truth(1)
        assert truth.disparity is not None
        assert truth.instances is not None
        book = truth.instances.mask(4)
        v, u = np.nonzero(book)
        right_u = np.round(u - truth.disparity.disparity_px[v, u]).astype(int)
        left, right = (image.astype(float).mean(axis=2) for image in (frame.left, frame.right))
        agreement = np.corrcoef(left[v, u], right[v, right_u])[0, 1]
        assert agreement > 0.85
        assert np.corrcoef(left[v, u], right[v, right_u + 12])[0, 1] < agreement - 0.2

    def test_matchers_find_the_things_and_semi_global_matching_finds_more(self) -> None:
        source = clip("table")
        frame, truth = source.frame(1), source.truth(1)
        assert truth.disparity is not None
        assert truth.instances is not None
        things = np.isin(
            truth.instances.ids, [instance.id for instance in truth.instances.instances if instance.is_thing]
        )
        known = {}
        for matcher in (BlockMatcher, SemiGlobalMatcher):
            found = matcher(matcher.Settings(min_depth_m=0.8, wls=False)).match(frame).disparity_px
            error = np.abs(found - truth.disparity.disparity_px)[things & np.isfinite(found)]
            assert np.median(error) < 0.5
            assert np.mean(error > 2) < 0.05
            known[matcher] = np.isfinite(found[things]).mean()
        assert known[BlockMatcher] > 0.6
        assert known[SemiGlobalMatcher] > known[BlockMatcher] + 0.02

    def test_frames_do_not_depend_on_order_or_process(self, own_cache: Path) -> None:
        """The bodies move from frame 1 to 40, so that neither may be drawn with what was cast for the other."""
        seen = {}
        for order in ((1, 40), (40, 1)):
            source = pickle.loads(pickle.dumps(clip("table")))
            _renderer.cache_clear()
            for path in own_cache.rglob("*.bin"):
                path.unlink()
            for number in order:
                frame, instances = source.frame(number), source.truth(number).instances
                assert instances is not None
                arrays = frame.left.tobytes(), frame.right.tobytes(), instances.ids.tobytes()
                assert seen.setdefault(number, arrays) == arrays
        assert seen[1] != seen[40]

    def test_noise_differs_between_frames(self) -> None:
        source = clip("table")
        one, other = source.frame(1), source.frame(2)
        wall = np.s_[20:60, 300:400]
        assert 1 < (one.left[wall].astype(float) - other.left[wall]).std() < 8


class TestStore:
    def test_a_stored_frame_and_its_truth_are_read_back_without_loss_and_without_rendering(
        self, own_cache: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        frame, rendered = clip().frame(3), clip().truth(3)
        assert {path.name for path in own_cache.rglob("*.bin")} == {"frame_0003.bin", "truth_0003.bin"}
        monkeypatch.setattr("harness.studio.clip._renderer", None)
        again, stored = clip().frame(3), clip().truth(3)
        assert np.array_equal(frame.left, again.left)
        assert np.array_equal(frame.right, again.right)
        assert stored.disparity is not None
        assert rendered.disparity is not None
        assert np.array_equal(stored.disparity.disparity_px, rendered.disparity.disparity_px, equal_nan=True)
        assert stored.instances is not None
        assert rendered.instances is not None
        assert np.array_equal(stored.instances.ids, rendered.instances.ids)
        assert stored.instances.instances == rendered.instances.instances

    @pytest.mark.parametrize("kind", ["frame", "truth"])
    def test_what_is_damaged_is_rendered_again(
        self, own_cache: Path, kind: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        getattr(clip(), kind)(3)
        (path,) = own_cache.rglob(f"{kind}_0003.bin")
        content = path.read_bytes()
        half = len(content) // 2
        short = zstandard.compress(b"too short")
        damages = (content[:half], hashlib.sha256(short).digest() + short)
        for damage in damages:
            path.write_bytes(damage)
            getattr(clip(), kind)(3)
            assert path.read_bytes() == content
        assert [record.message.endswith("rendered again") for record in caplog.records] == [True] * len(damages)

    def test_a_cache_that_cannot_be_written_is_said(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("VFOA_CACHE", str(tmp_path / "file"))
        for number in (1, 2):
            assert clip().frame(number).left.shape == (436, 1024, 3)
        assert ["not stored" in record.message for record in caplog.records] == [True]


class TestClip:
    def test_frames_times_and_rate(self) -> None:
        source = clip("crowd", frames=50)
        assert list(source.frames) == list(range(1, 51))
        assert source.time_ns(26) == 1_000_000_000
        assert clip().frame(3).time_ns == clip().time_ns(3) > 0
        assert source.rate_hz == 25

    @pytest.mark.parametrize("number", [0, 61, -1])
    def test_no_frame_beyond_the_clip(self, number: int) -> None:
        with pytest.raises(VfoaError, match=f"studio table: no frame {number}.*1 to 60"):
            clip().frame(number)
        with pytest.raises(VfoaError, match=f"no frame {number}"):
            clip().truth(number)

    def test_it_has_no_folder(self, tmp_path: Path) -> None:
        with pytest.raises(VfoaError, match=r"root: found .*expected none"):
            StudioClip(StudioSettings(scenario="table"), tmp_path)

    def test_a_step_leaves_out_frames_and_changes_nothing_else(self) -> None:
        every = StudioClip(StudioSettings(scenario="table", frames=10), None)
        some = StudioClip(StudioSettings(scenario="table", frames=4, step=3), None)
        assert list(some.frames) == [1, 2, 3, 4]
        assert some.rate_hz == every.rate_hz / 3
        assert some.digest() != every.digest()
        assert [some.time_ns(number) for number in some.frames] == [every.time_ns(whole) for whole in (1, 4, 7, 10)]
        for person, same in zip(some.truth(3).people or (), every.truth(7).people or (), strict=True):
            assert person.target == same.target
            assert person.gaze_direction is not None
            assert np.array_equal(person.gaze_direction, same.gaze_direction)
        assert np.array_equal(some.frame(3).left, every.frame(7).left)

    def test_the_digest_tells_clips_apart(self) -> None:
        digests = [clip(name).digest() for name in NAMES] + [clip(seed=8).digest(), clip(frames=61).digest()]
        assert len(set(digests)) == 6
        assert clip().digest() == digests[0]


class TestCommittedData:
    @pytest.mark.parametrize("name", NAMES)
    def test_annotations_are_the_truth_of_every_frame(self, name: ScenarioName) -> None:
        manifest = load_manifest(REPOSITORY / "datasets" / f"studio_{name}.toml")
        source = manifest.open()
        labels = manifest.labels(timeline_of(source))
        assert labels is not None
        assert labels == true_labels(_PeopleAlone(name, source.frames)), (
            "write_annotations(path, true_labels(clip)) writes them"
        )
        for number in (13, 60):
            for person in source.truth(number).people or ():
                label = labels.at(number, person.name)
                assert label is not None
                assert label.target == (person.target or IGNORED)

    @pytest.mark.parametrize("name", NAMES)
    def test_manifests_name_everyone_and_everything(self, name: ScenarioName) -> None:
        manifest = load_manifest(REPOSITORY / "datasets" / f"studio_{name}.toml")
        scenario = SCENARIOS[name]
        people = {actor.name: ("person", actor.id) for actor in scenario.actors}
        things = {thing.name: (thing.label, thing.id) for thing in scenario.things}
        assert {key: (rule.category, rule.instance) for key, rule in manifest.subjects.items()} == people
        assert {key: (rule.category, rule.instance) for key, rule in manifest.targets.items()} == things
