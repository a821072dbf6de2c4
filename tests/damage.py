"""Damaged copies of files; run as a script it reads many of a stage, in a process of its own lest USD crash.

python damage.py STAGE FOLDER FIRST COUNT
"""

import random
import sys
from collections import Counter
from pathlib import Path


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


def read_damaged(stage: Path, folder: Path, seeds: range) -> Counter:
    """Reads and plans damaged copies of a stage: how many were taken, and how many refused in one line."""
    import warp_smoke as ws

    data, found = stage.read_bytes(), Counter()
    for seed in seeds:
        file = folder / f"damaged{stage.suffix}"
        file.write_bytes(damaged(data, seed))
        print(f"seed {seed}", file=sys.stderr, flush=True)  # the last one printed is the one that crashed
        try:
            ws.make_plan(ws.Scene.open(file))
        except ValueError as error:
            if "\n" in str(error):
                raise
            found["refused"] += 1
        else:
            found["taken"] += 1
    return found


if __name__ == "__main__":
    first, count = map(int, sys.argv[3:])
    print(dict(read_damaged(Path(sys.argv[1]), Path(sys.argv[2]), range(first, first + count))))
