"""Peak resident memory of streaming a recording: ``python -m harness.bench.mcap_memory``.

Each recording is read in a fresh process, and its peak is compared with that for a recording of a tenth of the length.
"""

from __future__ import annotations

import base64
import json
import resource
import tempfile
from pathlib import Path

import numpy as np
from mcap.writer import Writer
from rich.console import Console

from harness.processes import spawning
from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.topics import RecordingSettings

WIDTH, HEIGHT = 160, 120
STEP_NS = 40_000_000


def write_recording(path: Path, frames: int) -> None:
    """A rectified pair of 160 x 120 pixels at 25 Hz, in Foxglove's JSON; every frame differs."""
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {
            (side, name): writer.register_channel(
                f"/{side}/{name}", "json", writer.register_schema(f"foxglove.{name}", "jsonschema", b"{}")
            )
            for side in ("left", "right")
            for name in ("RawImage", "CameraCalibration")
        }
        for number in range(1, frames + 1):
            pixels[...] = number % 251
            for (side, name), channel in channels.items():
                sec, nsec = divmod(number * STEP_NS, 10**9)
                fields = _image(pixels) if name == "RawImage" else _calibration(0.1 if side == "right" else 0.0)
                message = {"timestamp": {"sec": sec, "nsec": nsec}, "width": WIDTH, "height": HEIGHT, **fields}
                writer.add_message(channel, number * STEP_NS, json.dumps(message).encode(), number * STEP_NS)
        writer.finish()  # type: ignore[no-untyped-call]  # the library has not annotated it


def peak_memory_mib(path: Path) -> float:
    """Peak resident memory of a fresh process that indexes the recording and reads all its frames, in MiB."""
    with spawning().Pool(1) as pool:
        return pool.apply(_read_all, (path,))


def measure(frames: int) -> float:
    """Peak resident memory in MiB for a generated recording of this many frames."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "generated.mcap"
        write_recording(path, frames)
        return peak_memory_mib(path)


def main() -> None:
    """Measure 200 and 2,000 frames, and show both with their ratio."""
    short, long = measure(200), measure(2000)
    Console().print(f"200 frames {short:.1f} MiB, 2000 frames {long:.1f} MiB: ratio {long / short:.3f}")


def _read_all(path: Path) -> float:
    clip = McapClip(RecordingSettings(recording=path.name), path.parent)
    for number in clip.frames:
        clip.frame(number)
    return peak_mib()


def peak_mib() -> float:
    """Peak resident memory of this process, in MiB."""
    status = Path("/proc/self/status")
    if status.is_file():  # ru_maxrss would also include the peak of the parent process
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def _image(pixels: np.ndarray) -> dict[str, object]:
    return {"encoding": "rgb8", "step": WIDTH * 3, "data": base64.b64encode(pixels.tobytes()).decode()}


def _calibration(baseline_m: float) -> dict[str, object]:
    focal_px, cx, cy = 100.0, WIDTH / 2, HEIGHT / 2
    return {
        "distortion_model": "plumb_bob",
        "D": [],
        "K": [focal_px, 0, cx, 0, focal_px, cy, 0, 0, 1],
        "R": [1, 0, 0, 0, 1, 0, 0, 0, 1],
        "P": [focal_px, 0, cx, -focal_px * baseline_m, 0, focal_px, cy, 0, 0, 0, 1, 0],
    }


if __name__ == "__main__":
    main()
