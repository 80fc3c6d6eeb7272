"""The wire decoder: frames a second in batches, and what one frame costs when it comes alone.

Wanted: 200,000 frames/s of 20 channels (10 strips, double measurement) in batches. The time of the process is what
counts on a busy machine; wall-clock time is printed too.

Run: python benchmarks/wire.py
"""

from __future__ import annotations

import time

import numpy as np

from tacstrip.stream.device.protocol.decoder import Decoder
from tacstrip.stream.device.protocol.scans import ScanBatch, encode_scan
from tacstrip.stream.source import RawScan

FRAMES, REPEATS = 20_000, 7
BLOCKS = {"in one piece": 2**30, "64 KB at a time": 2**16, "4 KB at a time": 2**12, "frame by frame": 0}


def stream(strips: int, bits: int) -> list[bytes]:
    """Return frames of random codes, a third of the strips touched."""
    random = np.random.default_rng(1)
    offsets = np.linspace(0.0, 2e-4 * strips, strips)
    frames = []
    for i in range(FRAMES):
        codes = {name: random.integers(0, 2**bits, strips).astype("<u2") for name in ("kh", "kl")}
        frames.append(encode_scan(RawScan(i * 1e-3, codes, random.random(strips) < 0.3, i, offsets), bits))
    return frames


def decode(data: bytes, block: int, scans: bool) -> None:
    """Decode all of it and see that nothing is missing."""
    decoder, found = Decoder(), 0
    for at in range(0, len(data), block):
        for batch in decoder.feed(data[at : at + block]):
            assert isinstance(batch, ScanBatch)
            found += sum(1 for _ in batch.scans()) if scans else len(batch)
    assert found == FRAMES == decoder.counts.frames


def main() -> None:
    """Print frames a second for each way of feeding; the best of some repeats."""
    for strips, bits in ((10, 10), (100, 12)):
        frames = stream(strips, bits)
        data = b"".join(frames)
        print(f"{2 * strips} channels, {len(frames[0])} bytes a frame")
        for name, block in BLOCKS.items():
            for scans in (False, True):
                used, took = [], []
                for _ in range(REPEATS):
                    clock, busy = time.perf_counter(), time.process_time()
                    decode(data, block or len(frames[0]), scans)
                    used.append(time.process_time() - busy)
                    took.append(time.perf_counter() - clock)
                what = "arrays and RawScans" if scans else "arrays"
                best = min(used)
                print(
                    f"  {name:<16} {what:<20} {FRAMES / best:9,.0f} frames/s of a core"
                    f" ({FRAMES / min(took):9,.0f} by the clock), {1e6 * best / FRAMES:5.1f} us a frame"
                )


if __name__ == "__main__":
    main()
