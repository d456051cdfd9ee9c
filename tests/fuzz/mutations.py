"""Good examples spoiled: bytes anywhere, words of the format, and values in their places.

Everything is drawn from a `random.Random`, so that a number names the case.
"""

from __future__ import annotations

import csv
import io
import json
import tomllib
import zipfile
from collections.abc import Callable
from copy import deepcopy
from random import Random
from typing import Any

import tomli_w

WORDS = (
    *(
        b"",
        b" ",
        b"\t",
        b"\n",
        b"\r",
        b"\r\n",
        b"\0",
        b"\xff",
        b"\xef\xbb\xbf",
        b"\xff\xfe",
        "\u2028".encode(),
    ),
    *(b"[", b"]", b"{", b"}", b"(", b")", b"[" * 50, b"{" * 5000, b"[" * 100_000, b'"', b"'", b'"""', b"\\"),
    *(b",", b",,", b";", b":", b":=", b"=", b"#", b"!", b".", b"-", b"--", b"*" * 8, b"/POS\n", b"/END\n"),
    *(b"0", b"-0", b"1", b"-1", b"1e308", b"-1e308", b"1e999", b"1e-320", b"9" * 30, b"9" * 400, b"9" * 5000),
    *(
        b"nan",
        b"NaN",
        b"inf",
        b"-Infinity",
        b"null",
        b"true",
        b"0x10",
        b"1_000",
        "٣".encode(),
        b"9E9",
        b"P[1:  ",
    ),
    *(
        b"CONST ",
        b"MoveL ",
        b"movej(",
        b"p[",
        b"=2",
        b"ok",
        b"free",
        b"x" * 200_000,
        b"a." * 1000,
        b" " * 10_000,
    ),
)
VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        0,
        1,
        -1,
        2,
        7,
        10**9,
        2**63 - 1,
        10**30,
        10**400,
        0.0,
        -0.0,
        1.5,
        -2.5,
        1e-320,
        1e18,
    ),
    *(
        1e308,
        -1e308,
        float("inf"),
        float("nan"),
        "",
        " ",
        "x",
        "T1",
        "free",
        "0",
        "1e5",
        "é\0",
        "\ud800",
        "x" * 10_000,
    ),
    *([], {}, [[]], [0], ["x"], [1, 2, 3], [1.0, "x"], [None] * 3, {"x": 1}, {"": {}}, [[1, 2, 3]] * 3),
)

Mutation = Callable[[bytes, Random], bytes]


def spoil_bytes(data: bytes, rng: Random) -> bytes:
    """Some places overwritten, cut out, doubled, swapped, or with a word put in."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
        b = min(b, a + rng.choice((1, 4, 30, 300, len(data))))
        word = rng.choice(WORDS)
        data = rng.choice(
            (
                data[:a] + word + data[a:],
                data[:a] + word + data[b:],
                data[:a] + data[b:],
                data[:b] + data[a:],
                data[:a] + bytes([rng.randrange(256)]) + data[a + 1 :],
                data[:a],
            )
        )
    return data


def spoil_lines(data: bytes, rng: Random) -> bytes:
    """Lines left out, doubled, swapped, or taken from elsewhere."""
    lines = data.splitlines(keepends=True) or [b""]
    for _ in range(rng.choice((1, 2, 5))):
        a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
        kind = rng.randrange(4)
        if kind == 0 and len(lines) > 1:
            del lines[a]
        elif kind == 1:
            lines.insert(a, lines[b])
        elif kind == 2:
            lines[a], lines[b] = lines[b], lines[a]
        else:
            lines[a] = spoil_bytes(lines[a], rng)
    return b"".join(lines)


def spoil_packed(data: bytes, rng: Random) -> bytes:
    """Spoil one part of an archive and pack it again."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as given, zipfile.ZipFile(out, "w") as packed:
        chosen = rng.choice(given.namelist())
        for name in given.namelist():
            part = given.read(name)
            packed.writestr(name, spoil_bytes(part, rng) if name == chosen else part)
    return out.getvalue()


def spoil_value(value: Any, rng: Random) -> Any:
    """Replace, remove, double, rename or move one value of a tree, in place if possible."""
    holders = [value]
    for each in holders:  # grows while it is walked
        inner = each.values() if isinstance(each, dict) else each
        holders += [item for item in inner if isinstance(item, dict | list) and item]
    holder = rng.choice(holders)
    key = rng.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
    kind = rng.randrange(5)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, dict):
        holder[rng.choice(("x", "", "format", "T1", str(key) * 2))] = holder.pop(key)
    elif kind == 2:
        other = rng.choice(holders)
        holder[key] = deepcopy(rng.choice(list(other.values()) if isinstance(other, dict) else other))
    elif kind == 3 and isinstance(holder, list):
        holder.append(deepcopy(holder[key]))
    elif isinstance(holder[key], float) and rng.random() < 0.5:
        holder[key] *= rng.choice((-1.0, 0.0, 1e-12, 1e6, 1e300))
    else:
        holder[key] = deepcopy(rng.choice(VALUES))
    return value


def spoil_json(data: bytes, rng: Random) -> bytes:
    """JSON with some values spoiled; it may hold what only Python's dialect can say."""
    value = json.loads(data)
    for _ in range(rng.choice((1, 1, 2))):
        value = spoil_value(value, rng) if value else value
    return json.dumps(value).encode()


def spoil_history(data: bytes, rng: Random) -> bytes:
    """Lines of JSON, one of them with a value spoiled."""
    lines = data.splitlines()
    k = rng.randrange(len(lines))
    lines[k] = spoil_json(lines[k], rng)
    return b"\n".join(lines)


def spoil_toml(data: bytes, rng: Random) -> bytes:
    """TOML with some values spoiled; what TOML cannot say is left as it was."""
    value = spoil_value(tomllib.loads(data.decode()), rng)
    try:
        return tomli_w.dumps(value).encode()
    except (TypeError, UnicodeEncodeError, ValueError):
        return spoil_bytes(data, rng)


def spoil_cells(data: bytes, rng: Random) -> bytes:
    """CSV with some cells or whole columns spoiled."""
    rows = list(csv.reader(io.StringIO(data.decode())))
    for _ in range(rng.choice((1, 1, 3))):
        k = rng.randrange(len(rows[0]))
        word = rng.choice((*WORDS, b"nan", b"180", b"1e12", b"0.5")).decode("utf-8", "replace")
        chosen = rows if rng.random() < 0.2 else [rng.choice(rows)]
        for row in chosen if chosen is not rows else rows[1:]:
            if k < len(row):
                row[k] = word[:2000] if chosen is rows else word
    out = io.StringIO()
    csv.writer(out, lineterminator=rng.choice(("\n", "\r\n", "\r"))).writerows(rows)
    return out.getvalue().encode("utf-8", "replace")
