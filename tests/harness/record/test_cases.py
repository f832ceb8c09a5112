"""The recordings of the synthetic cases: every radius a frame, with the curves that the simulation has."""

from __future__ import annotations

import subprocess

import pytest

from harness.record import entities
from harness.record.cases import record_cases
from harness.record.program import viewer_binary
from vfoa.simulation import CASES, RADII_CM, simulate


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    return record_cases(tmp_path_factory.mktemp("scenes"))


def test_there_is_one_whole_recording_a_case(recordings):
    assert len(recordings) == len(CASES)
    for path in recordings:
        done = subprocess.run([viewer_binary(), "rrd", "verify", path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_the_curves_are_the_simulations_own(recordings, read_back):
    rows = simulate(n_rays=(40,))
    for case, path in zip(CASES, recordings, strict=True):
        columns = read_back(path)
        curves = columns.at(entities.curves("cone", "subject", "total"), "Scalars:scalars")
        for place, thing in enumerate(case.objects):
            expected = {row.radius_cm: [row.total] for row in rows if (row.case, row.object) == (case.name, thing.name)}
            assert len(expected) == len(RADII_CM)
            assert {radius_cm: [values[place]] for radius_cm, values in curves.items()} == expected


def test_the_hits_are_there_where_the_rays_are(recordings, read_back):
    hits = read_back(recordings[0]).at(entities.cue_3d("cone", "subject", "gaze", "hits"), "Points3D:positions")
    assert len(hits[5]) == 40
