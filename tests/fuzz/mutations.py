"""Mutations of files: bits, cuts, blocks, lengths that lie; in text also words and lines."""

import re
from collections.abc import Callable, Sequence

import numpy as np

Generator = np.random.Generator
EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1)
WORDS = (
    "-1", "0", "1e308", "-1e-320", "1e999", ".nan", ".inf", "NaN", "inf", "9" * 30, "9" * 5000,
    "0x7fffffffffffffff", "1_000", "2001-01-01", "12:30:45", "true", "off", "null", "~", "''",
    "[]", "{}", "[[]]", "[1, [2]]", "{a: {b: 1}}", "&a [*a]", "*a", "!!python/object:os.system x",
    "!!binary aGk=", "!!set {a}", "!!float x", "!!int ''", "!!timestamp 1", "? [1]\n: 2", "<<: 1",
    "../../x", "/etc/passwd", "\x00", "\x1b[31mred", "\u202e", "a\nb", "\t", "'", '"', "self",
    "x" * 300, "os:x", "type", "1..2000000000", "1..5", "%", "#", "---", "--- a\n--- b", "[" * 300,
    "{a: " * 200, "float64[99999999] a", "string<=9 b", "/*", "(1)", "1 << 99", "base", "folder",
)  # fmt: skip
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][\w/]*")


def mutated(base: bytes, rng: Generator, text: bool, others: Sequence[bytes] = ()) -> bytes:
    """A base with one to six mutations.

    Args:
        base: a file.
        rng: of the choice.
        text: whether it is text, with words and lines.
        others: files of which blocks are taken.
    """
    kinds = [*TEXT, *BINARY] if text else BINARY
    for _ in range(int(rng.integers(1, 7))):
        if not base:
            break
        kind = kinds[int(rng.integers(len(kinds)))]
        base = (
            kind(base, rng) if others == () or rng.random() < 0.9 else _spliced(base, rng, others)
        )
    return base


def _at(content: bytes, rng: Generator) -> int:
    """A place, half of the time among the first bytes, where headers are."""
    size = len(content)
    return int(rng.integers(min(size, 256) if rng.random() < 0.5 else size))


def _flip(content: bytes, rng: Generator) -> bytes:
    made = bytearray(content)
    made[_at(content, rng)] ^= 1 << int(rng.integers(8))
    return bytes(made)


def _byte(content: bytes, rng: Generator) -> bytes:
    made = bytearray(content)
    made[_at(content, rng)] = int(rng.integers(256))
    return bytes(made)


def _extreme(content: bytes, rng: Generator) -> bytes:
    width = int(rng.choice([1, 2, 4, 8]))
    value: int = EXTREMES[int(rng.integers(len(EXTREMES)))] % 256**width
    at, little = _at(content, rng), rng.random() < 0.7
    return (
        content[:at] + value.to_bytes(width, "little" if little else "big") + content[at + width :]
    )


def _cut(content: bytes, rng: Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _without(content: bytes, rng: Generator) -> bytes:
    at = _at(content, rng)
    return content[:at] + content[at + int(rng.integers(1, 64)) :]


def _repeated(content: bytes, rng: Generator) -> bytes:
    at = _at(content, rng)
    block = content[at : at + int(rng.integers(1, 256))]
    return content[:at] + block * int(rng.integers(2, 20)) + content[at:]


def _noise(content: bytes, rng: Generator) -> bytes:
    at = _at(content, rng)
    return content[:at] + rng.bytes(int(rng.integers(1, 32))) + content[at:]


def _spliced(content: bytes, rng: Generator, others: Sequence[bytes]) -> bytes:
    other = others[int(rng.integers(len(others)))] or b"\0"
    start, at = int(rng.integers(len(other))), _at(content, rng)
    return content[:at] + other[start : start + int(rng.integers(1, 512))] + content[at:]


def _word(content: bytes, rng: Generator) -> bytes:
    """Another word in place of a number or a word."""
    found = list((NUMBER if rng.random() < 0.5 else WORD).finditer(content))
    if not found:
        return content
    place = found[int(rng.integers(len(found)))]
    word = WORDS[int(rng.integers(len(WORDS)))].encode()
    return content[: place.start()] + word + content[place.end() :]


def _lines(content: bytes, rng: Generator) -> bytes:
    """A line that is repeated, left out, moved, or indented otherwise."""
    lines = content.split(b"\n")
    line = lines.pop(int(rng.integers(len(lines))))
    at = int(rng.integers(len(lines) + 1))
    for made in ([line, line], [], [line], [b"  " + line], [line.lstrip()])[int(rng.integers(5))]:
        lines.insert(at, made)
    return b"\n".join(lines)


def _value(content: bytes, rng: Generator) -> bytes:
    """Another value behind a colon, an equals sign or a comma."""
    places = [found.end() for found in re.finditer(rb"[:=,]\s*", content)]
    if not places:
        return content
    at = places[int(rng.integers(len(places)))]
    end = re.compile(rb"[,}\]\n#]|$").search(content, at)
    word = WORDS[int(rng.integers(len(WORDS)))].encode()
    return content[:at] + word + content[end.start() if end else at :]


BINARY: list[Callable[[bytes, Generator], bytes]] = [
    _flip, _flip, _byte, _extreme, _extreme, _cut, _without, _repeated, _noise,
]  # fmt: skip
TEXT: list[Callable[[bytes, Generator], bytes]] = [_word, _word, _value, _value, _lines, _repeated]
