"""A run's records of one clip: which there are, and which are meant."""

from pathlib import Path

import pytest

from harness.run.results import read_clip_records
from tests.records import frame_record, write_run
from vfoa.errors import VfoaError


@pytest.fixture
def run(tmp_path: Path) -> Path:
    kinds = (("table", "one", 1), ("talk", "one", 1), ("table", "two", 1), ("table", "one", 2))
    records = [frame_record([], [], clip=clip, configuration=name, frame=frame) for clip, name, frame in kinds]
    failed = [{"clip": "talk", "configuration": "two", "error": "no images"}]
    return write_run(tmp_path, records, failed=failed).path


def test_they_are_those_of_the_clip_and_the_configuration(run: Path) -> None:
    assert list(read_clip_records(run, "table", "one").by_frame) == [1, 2]
    assert list(read_clip_records(run, "table", "two").by_frame) == [1]
    found = read_clip_records(run, "talk", None)
    assert (found.configuration, list(found.by_frame)) == ("one", [1])


@pytest.mark.parametrize(
    ("clip", "configuration", "message"),
    [
        ("tables", "one", "the run has no frames of clip 'tables'"),
        ("table", None, "--config: one, two"),
        ("table", "tow", r"'tow'.*'two'"),
    ],
)
def test_what_is_not_there_or_not_meant_is_one_line(
    run: Path, clip: str, configuration: str | None, message: str
) -> None:
    with pytest.raises(VfoaError, match=message):
        read_clip_records(run, clip, configuration)
