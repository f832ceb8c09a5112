from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from typing import Any

import pytest

from harness.record.catalogue import Catalogue
from harness.record.composed import Composed, find_clips
from tests.harness.record.conftest import CONFIGURATION
from vfoa.errors import VfoaError


def test_recordings_have_addresses_at_frames(frames: list[Any], record_run: Callable[..., Any], tmp_path: Any) -> None:
    recorded = record_run(frames)
    one = find_clips(recorded.run, None, None)[0].compose()
    odd = tmp_path / "größe + #1" / "a+b's.rrd"
    odd.parent.mkdir()
    shutil.copy(recorded.files.images, odd)
    broken = recorded.run / "broken.rrd"
    broken.write_bytes(b"RRF2 and no more")
    with Catalogue() as catalogue:
        at_13 = catalogue.address(one, 13)
        assert at_13.startswith(f"rerun+{catalogue.origin}/dataset/")
        assert at_13.endswith(f"?segment_id={recorded.files.recording_id}#when=frame@13")
        assert catalogue.address(one, -1).replace("@-1", "@13") == at_13
        assert catalogue.address(one, None) == at_13.split("#")[0]
        assert catalogue.address(Composed(name="odd", files=(odd,)), 13) != at_13
        os.utime(recorded.files.verdicts(CONFIGURATION), ns=(0, 0))  # it was scored again
        assert catalogue.address(one, 13) != at_13
        with pytest.raises(VfoaError, match=r"broken\.rrd: not a"):
            catalogue.address(Composed(name="broken", files=(broken,)), 1)
        with pytest.raises(VfoaError, match=r"gone\.rrd: found no such recording"):
            catalogue.address(Composed(name="gone", files=(recorded.run / "gone.rrd",)), 1)
