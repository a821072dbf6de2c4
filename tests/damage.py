"""Damaged copies of files; run as a script it reads many of a stage as the command line does, in its own process.

python damage.py STAGE FOLDER FIRST COUNT
"""

import random
import signal
import struct
import sys
from pathlib import Path

# That a copy may take, which is otherwise read in a few hundredths of one, or given up after ten of the processor.
SECONDS = 60


def damaged(data: bytes, seed: int) -> bytes:
    """A copy with a few bytes or words changed, left out or cut off."""
    rng, copy = random.Random(seed), bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        place, kind = rng.randrange(len(copy)), rng.random()
        if kind < 0.5:
            copy[place] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
        elif kind < 0.8:
            copy[place : place + 8] = rng.randbytes(len(copy[place : place + 8]))
        elif kind < 0.9:
            del copy[max(place, 1) : place + rng.randrange(1, 64)]
        else:
            del copy[max(place, 1) :]
    return bytes(copy)


def with_count(data: bytes, section: str, count: int) -> bytes:
    """A copy of a binary layer with another count of entries in a section: paths, tokens and so on.

    After 16 bytes the file gives the place of its table of contents: the number of sections, then for each its name,
    start and size. Each section begins with its count.
    """
    copy = bytearray(data)
    (contents,) = struct.unpack_from("<q", data, 16)
    (sections,) = struct.unpack_from("<Q", data, contents)
    for index in range(sections):
        name, start, _ = struct.unpack_from("<16sqq", data, contents + 8 + 32 * index)
        if name.rstrip(b"\0") == section.encode():
            struct.pack_into("<Q", copy, start, count)
    return bytes(copy)


def read_damaged(stage: Path, folder: Path, seeds: range) -> None:
    """Reads and plans damaged copies of a stage; says of each when it begins, and what came of it."""
    import warp_smoke as ws
    from warp_smoke.usd.probe import check_readable

    data = stage.read_bytes()
    for seed in seeds:
        file = folder / f"damaged{stage.suffix}"
        file.write_bytes(damaged(data, seed))
        print(f"seed {seed}", flush=True)
        signal.alarm(SECONDS)
        try:
            check_readable(file)
            ws.make_plan(ws.Scene.open(file))
        except ValueError as error:
            if "\n" in str(error):
                raise
            print("refused", flush=True)
        else:
            print("taken", flush=True)


if __name__ == "__main__":
    read_damaged(Path(sys.argv[1]), Path(sys.argv[2]), range(int(sys.argv[3]), int(sys.argv[4])))
