"""Changes of files: of their bytes, lines, cells, values and arrays, and of what lies in their places."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping

from arrays import changed_arrays
from hypothesis import strategies as st
from odd import changed, texts
from trial import Content, Special

OUTSIDE = ("../outside/secret.txt", "../outside", "/dev/zero", ".", "..", "nowhere")  # nothing that could be harmed
PIECES = (
    b"\x00",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\r",
    b"\n\n",
    b"\t",
    b"{",
    b"}",
    b"[",
    b'"',
    b"-",
    b"9" * 400,
)


@st.composite
def changed_bytes(draw: st.DrawFn, content: bytes) -> tuple[bytes, str]:
    """Draw a change of bytes that knows nothing of their meaning."""
    way = draw(st.sampled_from(["flip", "flip", "cut", "cut", "insert", "remove", "zero", "repeat", "empty", "append"]))
    start = draw(st.integers(0, max(len(content) - 1, 0)))
    length = draw(st.sampled_from([1, 2, 4, 16, 100, 1000]))
    piece = draw(st.one_of(st.sampled_from(PIECES), st.binary(min_size=1, max_size=8)))
    data, story = bytearray(content), f"{way} at {start} of {len(content)}"
    if way == "flip":
        for place in (start, *draw(st.lists(st.integers(0, max(len(content) - 1, 0)), max_size=4))):
            if data:
                data[place] ^= 1 << draw(st.integers(0, 7))
    elif way == "cut":
        del data[start:]
    elif way == "insert":
        data[start:start] = piece
    elif way == "remove":
        del data[start : start + length]
    elif way == "zero":
        data[start : start + length] = bytes(len(data[start : start + length]))
    elif way == "repeat":
        data[start:start] = data[start : start + length] * draw(st.sampled_from([1, 3, 100]))
    elif way == "empty":
        data.clear()
    else:
        data += piece
    return bytes(data), story


@st.composite
def changed_lines(draw: st.DrawFn, content: bytes) -> tuple[bytes, str]:
    """Draw a change of a text's lines."""
    lines = content.decode("utf-8", "replace").split("\n")
    k = draw(st.integers(0, len(lines) - 1))
    way = draw(
        st.sampled_from(["drop", "twice", "indent", "dedent", "append", "front", "crlf", "word", "word", "mark"])
    )
    if way == "drop":
        del lines[k]
    elif way == "twice":
        lines.insert(k, lines[k])
    elif way == "indent":
        lines[k] = draw(st.sampled_from([" ", "  ", "\t"])) + lines[k]
    elif way == "dedent":
        lines[k] = lines[k].lstrip()
    elif way == "append":
        lines[k] += draw(texts)
    elif way == "front":
        lines[k] = draw(texts) + lines[k]
    elif way == "crlf":
        lines = [f"{line}\r" for line in lines]
    elif way == "mark":
        lines[0] = "\ufeff" + lines[0]
    else:
        words = lines[k].split(" ")
        words[draw(st.integers(0, len(words) - 1))] = draw(texts)
        lines[k] = " ".join(words)
    return "\n".join(lines).encode("utf-8", "surrogatepass"), f"line {k + 1}: {way}"


@st.composite
def changed_json(draw: st.DrawFn, content: bytes) -> tuple[bytes, str]:
    """Draw a change of a JSON file's values; NaN and infinities as Python writes them."""
    try:
        value = json.loads(content)
    except ValueError:
        return draw(changed_bytes(content))
    new, story = draw(changed(value))
    try:
        return json.dumps(new).encode("utf-8", "surrogatepass"), story
    except (RecursionError, TypeError):
        return b"[" * 100_000, f"{story}, or 100,000 brackets"


@st.composite
def changed_csv(draw: st.DrawFn, content: bytes) -> tuple[bytes, str]:
    """Draw a change of a table's cells, rows and columns."""
    rows = list(csv.reader(io.StringIO(content.decode("utf-8", "replace"), newline="")))
    if not rows or not rows[0]:
        return draw(changed_bytes(content))
    i, way = (
        draw(st.integers(0, len(rows) - 1)),
        draw(st.sampled_from(["cell", "cell", "cell", "row", "twice", "column"])),
    )
    j = draw(st.integers(0, max(len(rows[i]) - 1, 0)))
    new = draw(st.one_of(texts, st.sampled_from(["-1", "1e999", "nan", "1e300", "-1e300", "12345678901234567890"])))
    if way == "cell" and rows[i]:
        rows[i][j] = new
    elif way == "row":
        del rows[i]
    elif way == "twice":
        rows.insert(i, list(rows[i]))
    else:
        rows = [[*row[:j], *row[j + 1 :]] for row in rows]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode("utf-8", "surrogatepass"), f"row {i}, column {j}: {way} -> {new[:40]!r}"


def changed_content(name: str, content: bytes) -> st.SearchStrategy[tuple[bytes, str]]:
    """Return changes that suit a file's ending, and some that do not."""
    anyhow = changed_bytes(content)
    if name.endswith(".json"):
        return st.one_of(
            changed_json(content), changed_json(content), changed_json(content), changed_lines(content), anyhow
        )
    if name.endswith(".csv"):
        return st.one_of(changed_csv(content), changed_csv(content), changed_lines(content), anyhow)
    if name.endswith(".npz"):
        return st.one_of(changed_arrays(content), changed_arrays(content), changed_arrays(content), anyhow)
    return st.one_of(changed_lines(content), anyhow)


@st.composite
def changed_tree(
    draw: st.DrawFn, tree: Mapping[str, bytes], among: tuple[str, ...] = (""), most: int = 3
) -> tuple[dict[str, Content], str]:
    """Draw one to three changes of a folder's files.

    Args:
        draw: of hypothesis.
        tree: the files.
        among: starts of the names of those that are changed.
        most: how many changes.
    """
    new: dict[str, Content] = dict(tree)
    stories = []
    for _ in range(draw(st.integers(1, most))):
        names = [name for name, content in sorted(new.items()) if isinstance(content, bytes) and name.startswith(among)]
        if not names:
            break
        name = draw(st.sampled_from(names))
        way = draw(st.sampled_from([*["change"] * 14, "gone", "other", "place", "foreign"]))
        if way == "change":
            content = new[name]
            assert isinstance(content, bytes)
            new[name], story = draw(changed_content(name, content))
        elif way == "gone":
            del new[name]
            story = "removed"
        elif way == "other":
            source = draw(st.sampled_from(names))
            new[name] = new[source]
            story = f"is {source}"
        elif way == "place":
            new[name] = draw(
                st.one_of(
                    st.sampled_from([Special("folder"), Special("pipe"), Special("sparse", str(10**10))]),
                    st.sampled_from(OUTSIDE).map(lambda target: Special("link", target)),
                )
            )
            story = str(new[name])
        else:
            new[f"{name}.{draw(st.sampled_from(['txt', 'npz', 'json', '1', 'new']))}"] = b"thesis"
            story = "a foreign file beside it"
        stories.append(f"{name}: {story}")
    return new, "; ".join(stories)
