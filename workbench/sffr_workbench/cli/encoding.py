"""What the terminal's encoding cannot write is spelled in plain letters, instead of ending the command."""

from __future__ import annotations

import codecs
import io
import sys

SPELLED = "sffr-spelled"  # name of the way to treat such letters
PLAIN = {
    "µ": "u", "²": "2", "±": "+-", "×": "x", "·": "*", "°": " deg", "→": "->", "…": "...", "–": "-", "—": "-",  # noqa: RUF001
    "−": "-", "“": '"', "”": '"', "’": "'",  # noqa: RUF001
}  # fmt: skip


def spell_out() -> None:
    """Let both streams spell out what they cannot write; one that the user has told how to treat it keeps to that."""
    for stream in sys.stdout, sys.stderr:
        if isinstance(stream, io.TextIOWrapper):
            posix = stream.errors == "surrogateescape" and codecs.lookup(stream.encoding).name != "utf-8"
            if posix or stream.errors in ("strict", "backslashreplace"):
                stream.reconfigure(errors=SPELLED)


def _spell(error: UnicodeError) -> tuple[str, int]:
    """Return letters instead of those of an error, and where to go on; raise it if it is not one of encoding."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


codecs.register_error(SPELLED, _spell)
