"""Settings of a campaign spoilt at random: keys, types, values, paths, and the text itself."""

from __future__ import annotations

import datetime
import math
from random import Random
from typing import Any

import tomli_w

from tests.rom.sound_campaign import FILES, sound_settings

OUTSIDE = "outside.h5"  # a sound record beside the campaign's folder, which nobody may read
LEAVING = ("link.h5", "links/outside.h5")  # links inside the folder that lead to it
PATHS = (
    f"../{OUTSIDE}", f"records/../../{OUTSIDE}", f"..\\{OUTSIDE}", f"/{OUTSIDE}", "/etc/passwd",
    "/dev/zero.h5", "C:\\a.h5", "\\\\host\\a.csv", "file:///etc/a.h5", "~/a.h5", *LEAVING, "loop.h5",
    "pipe.h5", "folder.h5", "records", "", ".", "..", ".h5", "campaign.toml", "a\0b.h5", "a\nb.h5",
    "a" * 300 + ".h5", "a/" * 3000 + "a.h5", "records/LOOSENING.h5", "records//loosening.h5",
    "./cycled.mat", "%2e%2e/a.h5",
    "\xe9.h5", "e\u0301.h5", "\u202e5h.a", *FILES,
)  # fmt: skip
TEXTS = (
    "", " ", "lo", "so", "ground", "joint", "bolted", "loosening", "nan", "ground ", "\u0391", "\u202eol",
    "a\nb", "a\tb", "\x1b[31m", "\x7f", "\U0001d487" * 40, "x" * 5000, "'; --", "{0}", "%s", "null",
)  # fmt: skip
NUMBERS = (0, -1, 1, 2, 0.1, 5e-324, 1e-300, 1e308, -1e308, 2**63, -(2**63), 10**400, math.nan, math.inf)
OTHERS = (
    True, False, datetime.date(2025, 1, 1), datetime.datetime(2025, 1, 1, 12), datetime.time(1), [], [[]],
    [{}], ["lo"], ["lo", "so"], [1, 2], [2, 1], [0.0, 1e308], {}, {"a": {}},
)  # fmt: skip
LINES = (
    b"body = 1", b"[[body]]", b"[body]", b"[windows]", b"a = " + b"9" * 5000, b"a = 0x" + b"f" * 5000,
    b"bolt = 0x" + b"f" * 5000, b"a = " + b"[" * 3000 + b"]" * 3000, b"a" + b".a" * 3000 + b" = 1",
    b'name = "\\ud800"', b"name = '\xff'", b"\0", b"a = 2025-02-30", b"a = 1e999", b"a = +nan",
    b"\xef\xbb\xbf", b'x = """', b"=", b"# \x01", b"[sampling]\nmotion_rate_hz = 400",
    b'[[record]]\nfile = "a.h5"',
)  # fmt: skip


def random_tables(random: Random) -> bytes:
    """The sound settings with a few keys lost, renamed, repeated or of another value."""
    data = sound_settings()
    for _ in range(random.choice((1, 1, 2, 3))):
        if random.random() < 0.25:
            random.choice(data.get("record") or [{}])["file"] = random.choice(PATHS)
        else:
            _change(random, data)
            if not all(isinstance(record, dict) for record in _listed(data.get("record"))):
                break
    return tomli_w.dumps(data).encode()


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [None]


def _change(random: Random, data: dict[str, Any]) -> None:
    table: Any = data
    key: Any = random.choice(sorted(data))
    while isinstance(table[key], dict | list) and table[key] and random.random() < 0.8:
        table = table[key]
        key = random.choice(sorted(table) if isinstance(table, dict) else range(len(table)))
    match random.choice(("value", "value", "lost", "renamed", "again")):
        case "lost":
            del table[key]
        case "renamed" if isinstance(table, dict):
            table[random.choice(TEXTS)] = table.pop(key)
        case "again" if isinstance(table, list):
            table.append(table[key])
        case _:
            table[key] = random.choice(random.choice((TEXTS, NUMBERS, PATHS, OTHERS)))


def random_text(random: Random) -> bytes:
    """The sound settings as text with bytes lost, repeated or added."""
    text = tomli_w.dumps(sound_settings()).encode()
    for _ in range(random.choice((1, 1, 2, 4))):
        start = random.randrange(len(text) + 1)
        stop = min(start + random.choice((0, 1, 3, 30, 500)), len(text))
        lines = text.splitlines(keepends=True)
        text = random.choice(
            (
                text[:start],
                text[:start] + text[stop:],
                text[:stop] + text[start:],
                text[:start] + random.randbytes(3) + text[stop:],
                text[:start] + random.choice(LINES) + text[stop:],
                b"".join([*lines, random.choice(LINES), b"\n"]),
                b"".join([*lines, *lines[:1]]),
                b"".join([random.choice(LINES), b"\n", *lines]),
            )
        )
    return text
