"""How a crate packs its tables: differences of whole numbers in few bits, inside a block of LZ4."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_PIECE = 1 << 18  # numbers packed at once, a multiple of four: codes are four a byte

_BYTES = np.array([0, 1, 2, 4])
"""Bytes that follow for each two-bit code: the commonest difference has none."""


def packed(*parts: bytes | memoryview) -> bytes:
    """Return bytes as one block of LZ4 without matches, which every decoder takes.

    Matching would make the tables smaller, not the file: most of it is points and normals, which are not packed.
    """
    n = sum(len(part) for part in parts)
    if n < 15:
        return b"".join([bytes([0, n << 4]), *parts])
    whole, rest = divmod(n - 15, 255)
    return b"".join([b"\x00\xf0", b"\xff" * whole, bytes([rest]), *parts])


def packed_ints(values: ArrayLike) -> bytes:
    """Return whole numbers of 32 bits packed: length of the packed bytes, then those."""
    numbers = np.asarray(values, dtype=np.int32)
    kinds, often = np.unique(_differences(numbers, 0), return_counts=True)
    common = kinds[often.argmax()]
    codes, bytes_ = [], []
    for start in range(0, numbers.size, _PIECE):
        piece = _differences(numbers, start)
        coded = _codes(piece, common)
        codes.append(_two_bits(coded))
        bytes_.append(_variable(piece, coded))
    body = packed(common.tobytes(), *codes, *bytes_)
    return len(body).to_bytes(8, "little") + body


def _differences(numbers: NDArray[np.int32], start: int) -> NDArray[np.int32]:
    """Return the differences of a piece to the numbers before; of 32 bits they run over, and back when summed up."""
    before = numbers[start - 1] if start else np.int32(0)
    return np.diff(numbers[start : start + _PIECE], prepend=before)


def _codes(differences: NDArray[np.int32], common: np.int32) -> NDArray[np.uint8]:
    """Return the code of each difference: the commonest, or that it takes one, two or four bytes."""
    codes = np.full(differences.size, 3, dtype=np.uint8)
    codes[(differences >= -(1 << 15)) & (differences < 1 << 15)] = 2
    codes[(differences >= -(1 << 7)) & (differences < 1 << 7)] = 1
    codes[differences == common] = 0
    return codes


def _two_bits(codes: NDArray[np.uint8]) -> bytes:
    """Return four codes a byte, the first in its lowest bits."""
    four = np.zeros((-(-codes.size // 4), 4), dtype=np.uint8)
    four.ravel()[: codes.size] = codes
    joined: bytes = (four << np.array([0, 2, 4, 6], dtype=np.uint8)).sum(axis=1, dtype=np.uint8).tobytes()
    return joined


def _variable(numbers: NDArray[np.int32], codes: NDArray[np.uint8]) -> bytes:
    """Return the numbers, each in as many bytes as its code says."""
    kept = codes > 0
    numbers, sizes = numbers[kept], _BYTES[codes[kept]]
    ends = np.cumsum(sizes)
    out = np.zeros(int(ends[-1]) if ends.size else 0, dtype=np.uint8)
    for k in range(4):
        longer = sizes > k
        out[(ends - sizes + k)[longer]] = (numbers[longer] >> (8 * k)) & 0xFF
    return out.tobytes()


def rep(code: int, payload: Any, *, is_list: bool = False, is_inlined: bool = False) -> Any:
    """Return the 64 bits that stand for a value: its type, and the value itself or where it lies."""
    return payload | (code << 48) | (int(is_list) << 63) | (int(is_inlined) << 62)
