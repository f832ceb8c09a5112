from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from harness.recording.catalogue import Catalogue
from vfoa.errors import VfoaError


def test_recordings_have_addresses_at_frames(
    frames: list[Any], record_run: Callable[..., Path], tmp_path: Path
) -> None:
    one = record_run(frames)
    odd = tmp_path / "größe + #1" / one.name
    odd.parent.mkdir()
    shutil.copy(one, odd)
    named = one.with_name("clip__a+b's.rrd")
    shutil.copy(one, named)
    (broken := one.with_name("clip__broken.rrd")).write_bytes(b"RRF2 and no more")
    segment = RrdReader(one).recordings()[0].recording_id
    with Catalogue() as catalogue:
        at_13 = catalogue.address(one, 13)
        assert at_13.startswith(f"rerun+{catalogue.origin}/dataset/")
        assert at_13.endswith(f"?segment_id={segment}#when=frame@13")
        assert catalogue.address(one, -1).replace("@-1", "@13") == at_13
        assert catalogue.address(one, None) == at_13.split("#")[0]
        # the same name and the same recording's id, and yet another file
        others = {catalogue.address(each, 13) for each in (odd, named)}
        assert len({at_13, *others}) == 3
        os.utime(one, ns=(0, 0))
        assert catalogue.address(one, 13) not in {at_13, *others}
        with pytest.raises(VfoaError, match=r"clip__broken\.rrd: not a recording: "):
            catalogue.address(broken, 1)
        with pytest.raises(VfoaError, match=r"clip__gone\.rrd: found no such recording"):
            catalogue.address(one.with_name("clip__gone.rrd"), 1)
