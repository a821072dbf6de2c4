"""Checkpoints: what a run needs to continue later, in one file that is complete or absent.

The file, numbers little-endian: `MAGIC`, u32 format version, u64 length of the header, the header (JSON: fingerprint,
frame, report so far, name, type and shape of each field), the samples of each field in that order, and the SHA-256 of
everything before it. Fields are not compressed: those that fill the box hardly shrink, and deflating them takes longer
than a frame.
"""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from struct import Struct

import numpy as np

from warp_smoke.files import replacing
from warp_smoke.fingerprint import first_difference

MAGIC = b"warp_smoke checkpoint\n"
FORMAT = 1
_START = Struct("<IQ")
_DIGEST = 32


@dataclass(frozen=True)
class Checkpoint:
    """A run between two frames.

    Attributes:
        fingerprint: what its results depend on, by name.
        frame: number of the last finished frame.
        report: report on the frames so far.
        fields: arrays from `Simulation.save`, by name.
    """

    fingerprint: dict[str, str]
    frame: int
    report: dict
    fields: Mapping[str, np.ndarray]

    def write(self, path: Path) -> None:
        """Writes the file, which replaces the previous one once it is complete and on the disk.

        Raises:
            OSError: the file cannot be written.
        """
        digest = sha256()
        with replacing(path) as partial, partial.open("wb") as file:
            for part in self._parts():
                digest.update(part)
                file.write(part)
            file.write(digest.digest())
            file.flush()
            os.fsync(file.fileno())

    def _parts(self) -> Iterator[bytes | memoryview]:
        shapes = [[name, values.dtype.str, values.shape] for name, values in self.fields.items()]
        content = {"fingerprint": self.fingerprint, "frame": self.frame, "report": self.report, "fields": shapes}
        header = json.dumps(content).encode()
        yield MAGIC + _START.pack(FORMAT, len(header)) + header
        for values in self.fields.values():
            yield np.ascontiguousarray(values).reshape(-1).view(np.uint8).data

    def check(self, path: Path, now: dict[str, str]) -> None:
        """Checks that the run to resume is the one this checkpoint belongs to.

        Args:
            path: path of the checkpoint, for the message.
            now: fingerprint of the run to resume.

        Raises:
            ValueError: the runs differ; the message names the first difference.
        """
        difference = first_difference(self.fingerprint, now)
        if difference:
            raise ValueError(
                f"{path}: the checkpoint belongs to another run: {difference}; allowed: the same run, or no resume"
            )


def read_checkpoint(path: Path) -> Checkpoint:
    """Reads a checkpoint; its fields are views of one block of memory.

    Raises:
        ValueError: the file is not a checkpoint, is damaged, or has another format version.
        OSError: the file cannot be read.
    """
    data = memoryview(path.read_bytes())
    start = len(MAGIC) + _START.size
    if data[: len(MAGIC)] != MAGIC or len(data) < start:
        raise ValueError(f"{path}: not a checkpoint")
    version, length = _START.unpack_from(data, len(MAGIC))
    if version != FORMAT:
        raise ValueError(f"{path}: the checkpoint has format {version}; allowed: {FORMAT}")
    body, digest = data[:-_DIGEST], data[-_DIGEST:]
    if sha256(body).digest() != digest:
        raise ValueError(f"{path}: the checkpoint is damaged (its checksum is wrong); run without resuming")
    content = json.loads(bytes(body[start : start + length]))
    fields, position = {}, start + length
    for name, kind, shape in content["fields"]:
        values = np.frombuffer(body, np.dtype(kind), int(np.prod(shape)), position).reshape(shape)
        fields[name], position = values, position + values.nbytes
    return Checkpoint(content["fingerprint"], content["frame"], content["report"], fields)
