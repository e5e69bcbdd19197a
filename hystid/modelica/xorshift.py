"""Generators of random numbers, written anew from what their author published.

S. Vigna, "An experimental exploration of Marsaglia's xorshift generators, scrambled" (ACM TOMS 42, 2016) and
"Further scramblings of Marsaglia's xorshift generators" (J. Comput. Appl. Math. 315, 2017). A state is a row of
Integers, two for 64 bits, the lower half first. ``Modelica.Math.Random`` keeps the scrambled word as the next state of
the first two, where Vigna keeps the one before scrambling; its numbers are wanted here. The hash of a name is that of
A. Partow.
"""

from __future__ import annotations

from collections.abc import Sequence

_ALL = (1 << 64) - 1


def _halves(words: Sequence[int]) -> list[int]:
    """64-bit words as signed Integers of 32 bits."""
    parts = (part for w in words for part in (w & 0xFFFFFFFF, w >> 32))
    return [p - (1 << 32) if p >> 31 else p for p in parts]


def _words(state: Sequence[float]) -> list[int]:
    halves = [int(s) & 0xFFFFFFFF for s in state]
    return [low | high << 32 for low, high in zip(halves[::2], halves[1::2], strict=True)]


def _fraction(word: int) -> float:
    """Of 64 bits, a number in (0, 1]: the signed whole number over 2^64, and a half."""
    return (word - (1 << 64) if word >> 63 else word) * 2.0**-64 + 0.5


def xorshift64star(state: Sequence[float]) -> list[float]:
    """The number and the next state."""
    x = _words(state)[0]
    x ^= x >> 12
    x ^= x << 25 & _ALL
    x ^= x >> 27
    x = x * 2685821657736338717 & _ALL
    return [_fraction(x), *_halves([x])]


def xorshift128plus(state: Sequence[float]) -> list[float]:
    """The number and the next state."""
    a, b = _words(state)
    a ^= a << 23 & _ALL
    a = (a ^ b ^ a >> 17 ^ b >> 26) + b & _ALL
    return [_fraction(a), *_halves([b, a])]


def xorshift1024star(state: Sequence[float]) -> list[float]:
    """The number and the next state; the last Integer says where the round stands."""
    words, p = _words(state[:-1]), int(state[-1]) & 15
    a, p = words[p], p + 1 & 15
    b = words[p]
    b ^= b << 31 & _ALL
    words[p] = b ^ a ^ b >> 11 ^ a >> 30
    return [_fraction(words[p] * 1181783497276652981 & _ALL), *_halves(words), p]


def hashed(text: str) -> int:
    """A signed Integer of a text (A. Partow's AP hash)."""
    value = 0xAAAAAAAA
    for k, letter in enumerate(text.encode()):
        mixed = ~(value << 11) + (letter ^ value >> 5) if k % 2 else value << 7 ^ letter * (value >> 3)
        value = (value ^ mixed) & 0xFFFFFFFF
    return value - (1 << 32) if value >> 31 else value


GENERATORS = {
    "hy_xorshift64star": (xorshift64star, 2),
    "hy_xorshift128plus": (xorshift128plus, 4),
    "hy_xorshift1024star": (xorshift1024star, 33),
}
"""Name of the operation -> the generator, and the Integers of its state."""

C_TEXT = """\
#include <stdint.h>

static uint64_t hy_word(const double *half)
{
    return (uint64_t)(uint32_t)(int64_t)half[0] | (uint64_t)(uint32_t)(int64_t)half[1] << 32;
}

/* The number in (0, 1] for wanted = 0, else the Integer of that place, of words p and the ones after it. */
static double hy_drawn(int wanted, const uint64_t *words, uint64_t scrambled)
{
    const uint64_t part = wanted ? words[(wanted - 1) / 2] >> (wanted % 2 ? 0 : 32) & 0xffffffffu : 0;
    if (!wanted) return (double)(int64_t)scrambled * 0x1p-64 + 0.5;
    return part >> 31 ? (double)part - 4294967296.0 : (double)part;
}
"""

C_TEXTS = {
    "hy_xorshift64star": """\
static double hy_xorshift64star(int wanted, const double *state)
{
    uint64_t x = hy_word(state);
    x ^= x >> 12, x ^= x << 25, x ^= x >> 27;
    x *= 2685821657736338717u;
    return hy_drawn(wanted, &x, x);
}
""",
    "hy_xorshift128plus": """\
static double hy_xorshift128plus(int wanted, const double *state)
{
    const uint64_t b = hy_word(state + 2);
    uint64_t a = hy_word(state), words[2];
    a ^= a << 23;
    words[0] = b;
    words[1] = (a ^ b ^ a >> 17 ^ b >> 26) + b;
    return hy_drawn(wanted, words, words[1]);
}
""",
    "hy_xorshift1024star": """\
static double hy_xorshift1024star(int wanted, const double *state)
{
    const int last = (int)state[32] & 15, p = (last + 1) & 15;
    const uint64_t a = hy_word(state + 2 * last);
    uint64_t b = hy_word(state + 2 * p), words[16];
    if (wanted == 33) return p;
    for (int k = 0; k < 16; k++) words[k] = hy_word(state + 2 * k);
    b ^= b << 31;
    words[p] = b ^ a ^ b >> 11 ^ a >> 30;
    return hy_drawn(wanted, words, words[p] * 1181783497276652981u);
}
""",
}
