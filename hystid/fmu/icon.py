"""Picture of a model for importers: the curve of its reference result, force over displacement where it has both."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from hystid.numeric import Array

SIZE = 200  # pixels, as the standard proposes at least 100
_FINER = 2  # pixels of the drawing per pixel of the picture: edges without steps
_FRAME, _CURVE, _MARGIN = (0.35, 0.35, 0.35), (0.0, 0.36, 0.66), 0.12


def curve(x: Array, y: Array) -> Array:
    """The curve (n, 2) in a square from 0 to 1, first coordinate to the right, second upwards, with a margin."""
    both = np.stack([_spread(x), _spread(y)], axis=1)
    return _MARGIN + (1 - 2 * _MARGIN) * both


def _spread(values: Array) -> Array:
    low, high = float(np.min(values)), float(np.max(values))
    return (values - low) / (high - low) if high > low else np.full(len(values), 0.5)


def svg(points: Array, title: str) -> bytes:
    """The picture as lines. title: text that is escaped already."""
    corners = " ".join(f"{SIZE * a:.1f},{SIZE * (1 - b):.1f}" for a, b in points)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE} {SIZE}"><title>{title}</title>'
        f'<rect x="2" y="2" width="{SIZE - 4}" height="{SIZE - 4}" rx="6" fill="white" stroke="#595959" '
        f'stroke-width="3"/><polyline points="{corners}" fill="none" stroke="#005ca8" stroke-width="3" '
        f'stroke-linejoin="round"/></svg>\n'
    ).encode()


def png(points: Array) -> bytes:
    """The picture as pixels: white, a grey frame, the curve."""
    n = SIZE * _FINER
    picture = np.ones((n, n, 3))
    edge = 2 * _FINER
    for side in (np.s_[:edge], np.s_[-edge:], np.s_[:, :edge], np.s_[:, -edge:]):
        picture[side] = _FRAME
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]) if len(points) else np.zeros(1)
    if len(points):
        dense = np.linspace(0, way[-1], int(2 * n * way[-1]) + 2)
        columns, rows = (np.interp(dense, way, points[:, k]) * (n - 1) for k in (0, 1))
        for across in range(-_FINER, _FINER + 1):
            for down in range(-_FINER, _FINER + 1):
                if across**2 + down**2 <= _FINER**2 + 1:
                    picture[np.rint(n - 1 - rows + down).astype(int), np.rint(columns + across).astype(int)] = _CURVE
    small = picture.reshape(SIZE, _FINER, SIZE, _FINER, 3).mean(axis=(1, 3))
    return _png(np.rint(255 * small).astype(np.uint8))


def _png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG file (ISO 15948) of (rows, columns, 3) values."""
    rows, columns, _ = pixels.shape
    lines = np.concatenate([np.zeros((rows, 1), np.uint8), pixels.reshape(rows, -1)], axis=1)
    header = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    blocks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes(), 9)), (b"IEND", b""))
    body = b"".join(
        struct.pack(">I", len(d)) + kind + d + struct.pack(">I", zlib.crc32(kind + d)) for kind, d in blocks
    )
    return b"\x89PNG\r\n\x1a\n" + body
