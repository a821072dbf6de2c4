"""Deflates the values of many leaves at once (RFC 1950 and 1951).

zlib takes 20 to 40 µs for the kilobyte of a leaf, most of it to build a Huffman tree. But nearly all that deflate can
find in the half floats of a smooth field is that their upper bytes (sign, exponent, two bits of the mantissa) lie close
together. A code known beforehand does as well: upper bytes in a *window* of two octaves (factors of 2) take 4 bits, all
other bytes 9. Only the place of the window differs between leaves, so numpy encodes many of them in one go. zlib itself
is left with what it is better at: leaves that repeat themselves, and 32-bit floats.
"""

import zlib
from functools import cache
from itertools import chain, pairwise

import numpy as np

OCTAVE = 4  # values of an upper byte with the same exponent
WINDOW = 2 * OCTAVE
WINDOWS = 256 // OCTAVE - 1  # places of the window
WINDOW_BITS, OTHER_BITS = 4, 9
END_OF_BLOCK = 256
# Lengths of the symbols after the bytes: end of block, and three that never occur but complete the code (inflate
# insists): 8/2⁴ + 248/2⁹ + 1/2⁹ + (1/2⁹ + 1/2⁸ + 1/2⁷) = 1.
EXTRA_BITS = (9, 9, 8, 7)
HEADER_WORDS = 4
OVERHEAD_BITS = 245 + OTHER_BITS + 32  # header, end of block, checksum

# Below this saving a leaf stays raw: it is not worth the time of writer and readers.
LEAST_SAVING = 1 / 12


def deflate_leaves(values: np.ndarray, counts: np.ndarray) -> list[bytes | memoryview]:
    """The bytes of each leaf: a zlib stream where that is shorter, else as they are.

    Args:
        values: the leaves' values one after the other, float16 or float32, [m] or [m, 3].
        counts: how many numbers each leaf has, [n], none zero; their sum is the size of values.
    """
    numbers = values.reshape(-1)
    raw = memoryview(numbers.view(np.uint8))
    ends = np.cumsum(counts * numbers.itemsize).tolist()
    leaves = [raw[start:end] for start, end in pairwise((0, *ends))]
    if numbers.dtype == np.float32:
        repetitive, streams = range(len(leaves)), []
    else:
        repeats = _repetitive(numbers, counts, lag=numbers.size // len(values))
        windows, hits = _best_windows(numbers, counts)
        hits += counts * WINDOW // 256  # lower bytes are spread evenly
        bits = OVERHEAD_BITS + 2 * OTHER_BITS * counts - (OTHER_BITS - WINDOW_BITS) * hits
        chosen = (bits < (1 - LEAST_SAVING) * 16 * counts) & ~repeats
        encoded = _encode(numbers[np.repeat(chosen, counts)], counts[chosen], windows[chosen])
        repetitive, streams = repeats.nonzero()[0], zip(chosen.nonzero()[0].tolist(), encoded, strict=True)
    for leaf, stream in chain(streams, ((leaf, zlib.compress(leaves[leaf], 1)) for leaf in repetitive)):
        if len(stream) < len(leaves[leaf]):
            leaves[leaf] = stream
    return leaves


def _repetitive(halves: np.ndarray, counts: np.ndarray, lag: int) -> np.ndarray:
    """Leaves in which most values equal the one before, [n]."""
    bits = halves.view(np.uint16)
    equal = np.zeros(len(bits), np.int32)
    np.equal(bits[lag:], bits[:-lag], out=equal[lag:], casting="unsafe")
    return np.add.reduceat(equal, np.cumsum(counts) - counts) > counts // 2


def _best_windows(halves: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place of the window with most of each leaf's upper bytes, and how many those are, [n] each."""
    octaves = 256 // OCTAVE
    leaf = np.repeat(np.arange(len(counts)) * octaves, counts)
    octave = halves.view(np.uint16) >> 10
    histogram = np.bincount(leaf + octave, minlength=octaves * len(counts)).reshape(-1, octaves)
    inside = histogram[:, 1:] + histogram[:, :-1]
    return inside.argmax(axis=1), inside.max(axis=1)


def _encode(halves: np.ndarray, counts: np.ndarray, windows: np.ndarray) -> list[bytes]:
    """A zlib stream for each leaf: header, codes of its bytes, end of block, checksum."""
    if not len(counts):
        return []
    codes, headers, header_bits, end_of_block = _tables()
    octets = halves.view(np.uint8)
    # Two bytes' codes, each with its length above it, are one 32-bit word: join them to one code a value.
    pairs = codes.take(np.repeat((windows * 256).astype(np.uint16), 2 * counts) + octets).view("<u4")
    length = (pairs >> 9) & 15
    code = (pairs & 511) | (((pairs >> 16) & 511) << length)
    length += pairs >> 25

    stop = np.cumsum(length, dtype=np.uint32)
    body = np.diff(stop[np.cumsum(counts) - 1], prepend=0)
    start = header_bits[windows]
    end = start + body
    sizes = (end + OTHER_BITS + 7) // 8 + 4  # the checksum begins at a whole byte
    words = (sizes + 7) // 8  # no two leaves share a word
    first = np.cumsum(words) - words

    stream = np.zeros(words.sum() + 1, "<u8")
    stream[first[:, None] + np.arange(HEADER_WORDS)] = headers[windows]
    shift = first * 64 + start - (np.cumsum(body) - body)
    _write_bits(stream, stop - length + np.repeat(shift.astype(np.uint32), counts), code)
    _write_bits(stream, first * 64 + end, np.full(len(counts), end_of_block))

    octets, stream = memoryview(octets), memoryview(stream).cast("B")
    stops = np.cumsum(2 * counts).tolist()
    checksums = (zlib.adler32(octets[a:b]).to_bytes(4, "big") for a, b in pairwise((0, *stops)))
    return [
        bytes(stream[at : at + size - 4]) + checksum
        for at, size, checksum in zip((first * 8).tolist(), sizes.tolist(), checksums, strict=True)
    ]


def _write_bits(words: np.ndarray, position: np.ndarray, code: np.ndarray) -> None:
    """ORs codes of up to 18 bits into 64-bit words at ascending bit positions; bits of different codes never meet."""
    word, shift = position >> 6, (position & 63).astype(np.uint64)
    code = code.astype(np.uint64)
    first = np.append(0, (word[1:] != word[:-1]).nonzero()[0] + 1)
    words[word[first]] |= np.bitwise_or.reduceat(code << shift, first)
    last = np.append(first[1:], len(word)) - 1  # only the last code of a word can reach into the next
    words[word[last] + 1] |= code[last] >> np.uint64(1) >> (np.uint64(63) - shift[last])


@cache
def _tables() -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Constants of the code for every place of the window.

    Returns:
        code of each byte with its length in the bits from 9, uint16 [WINDOWS * 256]; headers, uint64
        [WINDOWS, HEADER_WORDS]; bits of each header [WINDOWS]; code of the end of block.
    """
    lengths = (WINDOW_BITS,) * WINDOW + (OTHER_BITS,) * (256 - WINDOW) + EXTRA_BITS
    table = _canonical_code(dict(enumerate(lengths)))
    symbols = [code | length << 9 for code, length in table.values()]
    inside, others = symbols[:WINDOW], symbols[WINDOW:256]
    starts = range(0, WINDOWS * OCTAVE, OCTAVE)
    codes = [others[:start] + inside + others[start:] for start in starts]
    headers, header_bits = zip(*map(_header, starts), strict=True)
    words = [[bits >> 64 * n & (2**64 - 1) for n in range(HEADER_WORDS)] for bits in headers]
    end_of_block, _ = table[END_OF_BLOCK]
    return np.array(codes, np.uint16).ravel(), np.array(words, np.uint64), np.array(header_bits), end_of_block


def _canonical_code(lengths: dict[int, int]) -> dict[int, tuple[int, int]]:
    """Huffman code and its length for each symbol, the code's first bit lowest (RFC 1951, 3.2.2)."""
    table, code, before = dict.fromkeys(lengths), 0, 0
    for symbol, length in sorted(lengths.items(), key=lambda item: (item[1], item[0])):
        code <<= length - before
        table[symbol] = int(f"{code:0{length}b}"[::-1], 2), length
        code, before = code + 1, length
    return table


def _header(start: int) -> tuple[int, int]:
    """Bits before the first byte's code, first bit lowest, and their number (RFC 1950; RFC 1951, 3.2.7)."""
    repeat = 16
    length_lengths = {repeat: 1, OTHER_BITS: 2, WINDOW_BITS: 3, 1: 4, 7: 5, 8: 5}
    length_code = _canonical_code(length_lengths)
    order = (16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1)
    fields = [(0x78, 8), (0x01, 8)]  # zlib: deflate with a 32 KiB window, fastest
    fields += [(1, 1), (2, 2)]  # last block, dynamic code
    fields += [(len(EXTRA_BITS) - 1, 5), (1, 5), (len(order) - 4, 4)]
    fields += [(length_lengths.get(symbol, 0), 3) for symbol in order]

    def run(length: int, count: int) -> None:
        fields.append(length_code[length])
        count -= 1
        while count >= 3:
            repeats = min(count, 6)
            fields.extend((length_code[repeat], (repeats - 3, 2)))
            count -= repeats
        fields.extend([length_code[length]] * count)

    if start:
        run(OTHER_BITS, start)
    run(WINDOW_BITS, WINDOW)
    run(OTHER_BITS, 256 - WINDOW - start + 2)  # with the first two of EXTRA_BITS
    fields += [length_code[8], length_code[7]]
    fields += [length_code[1]] * 2  # distances: none occurs, but two of one bit make a complete code
    bits = count = 0
    for value, width in fields:
        bits |= value << count
        count += width
    return bits, count
