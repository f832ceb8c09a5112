"""Record a browser's sound where it would leave the computer: PulseAudio with a sink that is connected to nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SOUND_HZ = 48_000
_LOUD = 3000
_APART_S = 0.5


class Recording:
    """The samples of a sink's monitor so far, and the time of day at which each was played."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._chunks: list[tuple[float, bytes]] = []
        self._process = process
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def length(self) -> int:
        """Samples until now."""
        return sum(len(data) for _, data in list(self._chunks)) // 2

    def beeps_ms(self, since: int) -> NDArray[np.float64]:
        """The times at which the beeps after a sample began, in milliseconds since 1970.

        A sample cannot arrive before it is played, so the chunks with the least delay give the time of the first
        sample. The recorder's own delay (up to 5 ms) is not subtracted.
        """
        chunks = list(self._chunks)
        ends = np.cumsum([len(data) // 2 for _, data in chunks]) / SOUND_HZ
        start_s = np.percentile(np.array([each for each, _ in chunks]) - ends, 2)
        wave = np.abs(np.frombuffer(b"".join(data for _, data in chunks), "<i2").astype(np.int32))
        loud = since + np.flatnonzero(wave[since:] > _LOUD)
        begins = np.diff(loud, prepend=-SOUND_HZ) > _APART_S * SOUND_HZ
        return 1000 * (start_s + loud[begins] / SOUND_HZ)

    def stop(self) -> None:
        """Record no more."""
        self._process.terminate()
        self._thread.join()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while data := os.read(self._process.stdout.fileno(), 4096):
            self._chunks.append((time.time(), data))


@contextmanager
def recorded(folder: Path) -> Iterator[Recording | None]:
    """Programs that are started in the block play into a recording; None where PulseAudio is missing."""
    if shutil.which("pulseaudio") is None or shutil.which("parec") is None:
        yield None
        return
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    place = folder / "native"
    environment = {**os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder), "PULSE_SERVER": f"unix:{place}"}
    modules = (f"module-native-protocol-unix socket={place}", f"module-null-sink sink_name=out rate={SOUND_HZ}")
    loads = [word for module in modules for word in ("-L", module)]
    server = ["pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no", *loads]
    recorder = ["parec", "-d", "out.monitor", "--raw", f"--rate={SOUND_HZ}", "--channels=1", "--format=s16le"]
    before = os.environ.get("PULSE_SERVER")
    with subprocess.Popen(server, env=environment, stderr=subprocess.DEVNULL) as playing:
        try:
            while not place.exists():
                time.sleep(0.1)
            os.environ["PULSE_SERVER"] = environment["PULSE_SERVER"]
            with subprocess.Popen(
                [*recorder, "--latency-msec=5"], env=environment, stdout=subprocess.PIPE, bufsize=0
            ) as recording:
                found = Recording(recording)
                try:
                    yield found
                finally:
                    found.stop()
        finally:
            os.environ.pop("PULSE_SERVER", None)
            if before is not None:
                os.environ["PULSE_SERVER"] = before
            playing.terminate()
