"""Numbers from text as programs write it: encodings, separators, decimal commas, headers, ids, and the XYZ format.

Whatever has two meanings is refused with one line that says how to tell which is meant: a wrong guess would grow a bed
that looks right. The last line of a file tells how its columns are parted, since it is neither title nor header.
"""

from __future__ import annotations

import codecs
import csv
import re
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import FileFormatError
from grainsdem.foreign import hold_words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_MARKS = {  # that of UTF-32 first: it begins like that of UTF-16
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([ed][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)
_FORTRAN = re.compile(r"(?<=[\d.,])[dD](?=[+-]?\d)")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_UNIT = re.compile(r"[\[(].*")
_IDS = {"", "id", "ids", "index", "no", "nr", "number", "label", "grain", "particle", "point"}
_CHOICES = (
    "which columns are x, y and z? Name them in a first line, such as 'id x y z' or 'x y z radius', parted as the "
    "numbers are"
)


Line = tuple[int, str]
"""Number of a line in its file, from 1, and its text; a plain tuple, since files have millions."""


def decoded(content: bytes) -> str:
    """Return the text of a file: UTF-8, or what its byte-order mark says.

    Notes
    -----
    Without a mark, what is not UTF-8 is taken for Latin-1: numbers are the same in both, and only a header's words may
    differ.
    """
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            text = content[len(mark) :].decode(encoding)
            hold_words(text.encode())
            return text
    hold_words(content)
    if b"\0" in content:
        raise FileFormatError("it holds zero bytes: no text, or UTF-16 without a byte-order mark; save it as UTF-8")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def positions(content: bytes) -> Floats:
    """Return the points of a text file, shape (n, 2) or (n, 3); shape (0, 3) where it holds none.

    Raises
    ------
    FileFormatError
        If it holds something else, or something that could be read in two ways; the message has no path.
    """
    text = decoded(content)
    lines, comments = _without_comments(text)
    if not lines:
        return np.empty((0, 3))
    number, first = lines[0]
    if first.strip().isdecimal():
        return _counted(text.splitlines()[number - 1 :], number)
    separator, lines = _separated(lines)
    names, rows = _headed(lines, comments, separator)
    if not rows:
        return np.empty((0, 3))
    named = axes_of(names)
    columns = named or _unnamed(rows, names, separator)
    points = _numbers(rows, columns, separator)
    if not named and len(_split(rows[0][1], separator)) == len(columns) == 3 and may_have_ids(points):
        raise FileFormatError(
            "the first of three columns is of whole numbers, all unlike: an id, or x? Name the columns in a first "
            "line, 'id x y' or 'x y z', parted as the numbers are"
        )
    return points


def listed(content: bytes) -> Floats:
    """Return the numbers of a text file that holds one list, shape (n,): one a line, or all of them parted by blanks.

    Raises
    ------
    FileFormatError
        If it holds something else; the message has no path.
    """
    lines, _ = _without_comments(decoded(content))
    if not lines:
        return np.empty(0)
    separator, lines = _separated(lines)
    if len(lines) > 1 and not any(is_number(field) for field in _split(lines[0][1], separator)):
        lines = lines[1:]
    most = max(len(_split(line[1], separator)) for line in lines)
    if separator is not None and most > 1 and len(lines) > 1:
        raise FileFormatError(
            f"one list of numbers is read, one a line; got {most} columns (in a number the decimals follow a point)"
        )
    cut = [(line[0], field) for line in lines for field in _split(line[1], separator) if field]
    if not cut:
        raise FileFormatError("it holds no number")
    return _numbers(cut, [0], "\t")[:, 0]


def may_have_ids(points: Floats) -> bool:
    """Return whether the first column may be ids: three or more whole numbers, all unlike, that count or stand alone.

    They stand alone where the other columns are not of whole numbers, as those of a lattice are.
    """
    first = points[:, 0]
    if len(first) < 3 or (first != np.floor(first)).any() or len(np.unique(first)) < len(first):
        return False
    is_counting = bool((np.diff(first) == 1.0).all())
    return is_counting or bool((points[:, 1:] != np.floor(points[:, 1:])).any())


def is_number(text: str) -> bool:
    """Return whether a text is a number, its decimals behind a point or a comma."""
    return bool(_NUMBER.fullmatch(text))


def axes_of(names: Sequence[str]) -> list[int]:
    """Return which of the named columns are x, y and, where there is one, z; none where x or y is missing.

    Examples
    --------
    >>> axes_of(["id", "Position X", "Position Y", "Position Z", "radius"])
    [1, 2, 3]
    >>> axes_of(["Points:0", "Points:1", "Points:2"])
    [0, 1, 2]
    """
    found = []
    for axis in "xyz":
        exact = [k for k, name in enumerate(names) if _UNIT.sub("", name).strip().lower() == axis]
        likely = exact or [k for k, name in enumerate(names) if _axis(name) == axis]
        if len(likely) > 1:
            shown = ", ".join(repr(names[k]) for k in likely)
            raise FileFormatError(f"columns {shown} could all be {axis}; name the right one {axis}")
        found += likely
        if not likely and axis != "z":
            return []
    return found


def _axis(name: str) -> str:
    """Return the axis that a column's name speaks of, its unit left out: ``x``, ``pos_x``, ``X [mm]``, ``Points:0``."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", _UNIT.sub("", name))
    words = [word for word in re.split(r"[^a-z0-9]+", spaced.lower()) if word]
    if len(words) == 2 and words[0] == "points" and words[1] in ("0", "1", "2"):  # as ParaView writes them
        return "xyz"[int(words[1])]
    axes = [word for word in words if word in ("x", "y", "z")]
    return axes[0] if len(axes) == 1 else ""


def _without_comments(text: str) -> tuple[list[Line], list[Line]]:
    """Return the lines that hold something, and the comments."""
    numbered = enumerate(text.splitlines(), 1)
    if not any(sign in text for sign in ("#", "%", "//", "sep=")):
        return [line for line in numbered if line[1].strip()], []
    lines, comments = [], []
    for number, line in numbered:
        kept, sign, said = line.partition("#")
        is_comment = line.lstrip().startswith(("%", "//"))
        if kept.strip() and not is_comment and not re.fullmatch(r"sep=.", kept.strip()):  # a word to Excel
            lines.append((number, kept))
        elif sign or is_comment:
            comments.append((number, said if sign else line.strip().lstrip("%/")))
    return lines, comments


def _separated(lines: list[Line]) -> tuple[str | None, list[Line]]:
    """Return what parts the columns, None for blanks, and the lines without a separator at their ends."""
    last = lines[-1][1].strip()
    bare = re.sub(r'"[^"]*"', '""', last)
    if ";" in bare:
        separator: str | None = ";"
    elif re.search(r"\s,|,\s", bare):
        separator = ","
    elif "\t" in bare:
        separator = "\t"
    elif " " in bare:
        separator = None
    else:
        separator = "," if "," in bare else None
    if separator not in (None, "\t") and all(line[1].endswith(separator) for line in lines[1:]):
        lines = [(line[0], line[1].removesuffix(separator)) for line in lines]
    return separator, lines


def _split(text: str, separator: str | None) -> list[str]:
    """Return the fields of a line, without their quotes."""
    if separator is None:
        return [field.strip('"') for field in text.split()]
    text = text.strip() if separator == "\t" else text
    if '"' not in text:
        return [field.strip() for field in text.split(separator)]
    return [field.strip() for field in next(csv.reader([text], delimiter=separator, skipinitialspace=True))]


def _headed(lines: list[Line], comments: list[Line], separator: str | None) -> tuple[list[str], list[Line]]:
    """Return the names of the columns, if there are any, and the lines that hold points."""
    titles: list[tuple[Line, list[str]]] = []
    for k, line in enumerate(lines):
        fields = _split(line[1], separator)
        numeric = [is_number(field) for field in fields]
        if all(numeric[1:]) and (sum(numeric) > 1 or len(fields) == 1 == sum(numeric)):
            break
        if not any(numeric) and axes_of(fields):
            return _matched(fields, lines[k + 1 :], separator), lines[k + 1 :]
        titles.append((line, fields))
    rows = lines[len(titles) :]
    if not rows:
        raise FileFormatError(f"no line holds numbers in columns; line {lines[-1][0]} is {lines[-1][1][:40]!r}")
    width = len(_split(rows[0][1], separator))
    for line, fields in titles:
        if len(fields) == width and any(map(is_number, fields)):
            wrong = next(field for field in fields if not is_number(field))
            raise FileFormatError(f"line {line[0]}: {wrong!r} is no number")
    if titles:
        return (titles[-1][1] if len(titles[-1][1]) == width else []), rows
    before = [comment[1] for comment in comments if comment[0] < rows[0][0]]
    likely = [names for text in reversed(before) for names in (_split(text, separator), text.split())]
    return next((names for names in likely if len(names) == width and axes_of(names)), []), rows


def _matched(names: list[str], rows: list[Line], separator: str | None) -> list[str]:
    """Return names, one for each column; R names rows in a column without a name, and quotes them."""
    if not rows:
        return names
    width = len(_split(rows[0][1], separator))
    if len(names) == width + 1 and not names[-1]:
        return names[:-1]
    first = rows[0][1].strip()
    if width == len(names) + 1 and (first.startswith('"') or not is_number(_split(first, separator)[0])):
        return ["", *names]
    if width != len(names):
        raise FileFormatError(f"{len(names)} columns have names, {', '.join(names)}; line {rows[0][0]} has {width}")
    return names


def _unnamed(rows: list[Line], names: list[str], separator: str | None) -> list[int]:
    """Return the columns of points that no header names, or raise an error that says how to name them."""
    fields = _split(rows[0][1], separator)
    columns = list(range(len(fields)))
    if not is_number(fields[0]):
        if not fields[0][:1].isalpha():
            raise FileFormatError(f"line {rows[0][0]}: {fields[0]!r} is no number, and no label")
        columns = columns[1:]
    elif names and names[0].strip('" ').lower() in _IDS:
        raise FileFormatError(f"columns {', '.join(map(repr, names))}: {_CHOICES}")
    if len(columns) not in (2, 3):
        count = f"{len(columns)} columns" if len(columns) > 1 else "one column"
        raise FileFormatError(f"points have two or three coordinates; got {count}: {_CHOICES}")
    return columns


def _numbers(rows: list[Line], columns: list[int], separator: str | None) -> Floats:
    """Return the numbers in some columns of lines, shape (n, n_columns), or raise an error that names the line."""
    width = len(_split(rows[0][1], separator))
    texts = [line[1] for line in rows]
    is_plain = not any('"' in text for text in texts)
    commas = separator != "," and any("," in text for text in texts)
    if is_plain and not commas and not any(_FORTRAN.search(text) for text in texts[:1]):
        some = None if columns == list(range(width)) else columns
        # With all columns numpy sees for itself whether lines are of one length.
        if some is None or all(len(_split(text, separator)) == width for text in texts):
            try:
                return np.loadtxt(texts, delimiter=separator, usecols=some, comments=None, ndmin=2)
            except ValueError:  # told below, with the line
                pass
    cut = []
    for line in rows:
        fields = _split(line[1], separator)
        if len(fields) != width:
            raise FileFormatError(f"line {line[0]} has {len(fields)} columns, line {rows[0][0]} has {width}")
        cut.append([fields[column] for column in columns])
        wrong = next((field for field in cut[-1] if not is_number(field)), None)
        if wrong is not None:
            raise FileFormatError(f"line {line[0]}: {wrong!r} is no number")
    return _valued(cut, separator)


def _valued(cut: list[list[str]], separator: str | None) -> Floats:
    """Return the values of texts that are numbers, with decimals behind a point, or behind a comma."""
    with_comma = [field for fields in cut for field in fields if "," in field]
    if with_comma and any("." in field for fields in cut for field in fields):
        raise FileFormatError(f"numbers have points and commas, such as {with_comma[0]!r}; write decimals with points")
    # Where ; parts columns, commas are decimal: that is why.
    if with_comma and separator != ";" and all(map(_THOUSANDS.fullmatch, with_comma)):
        raise FileFormatError(
            f"{with_comma[0]!r} may have a decimal comma or one of thousands; write decimals with points"
        )
    return np.array([[float(_FORTRAN.sub("e", field).replace(",", ".")) for field in fields] for fields in cut])


def _counted(text: Sequence[str], first: int) -> Floats:
    """Return the points of a file that begins with their number: XYZ, Qhull's, or the number alone."""
    count = int(text[0])
    after = [(first + k, line.strip()) for k, line in enumerate(text[1:], 1)]
    filled = [line for line in after if line[1]]
    behind = [line for line in after[1:] if line[1]]
    if len(behind) == count:
        return _atoms(behind, after[0][1]) if behind else np.empty((0, 3))
    if len(filled) == count:
        rows = filled
    elif count in (2, 3) and filled and filled[0][1] == str(len(filled) - 1):
        rows = filled[1:]
    elif len(behind) > count and re.fullmatch(r"\d+", behind[count][1]):
        raise FileFormatError(f"it holds several times, the second at line {behind[count][0]}; keep one")
    else:
        raise FileFormatError(f"line {first} says that there are {count} points, and {len(behind)} lines follow")
    separator, rows = _separated(rows)
    return _numbers(rows, _unnamed(rows, [], separator), separator)


def _atoms(rows: list[Line], comment: str) -> Floats:
    """Return the points of the XYZ format: after their number and a comment, a species and x, y, z in each line."""
    separator, rows = _separated(rows)
    fields = _split(rows[0][1], separator)
    properties = re.search(r'Properties="?([\w:]+)', comment)
    if properties is not None:  # extended XYZ: name, kind and number of columns of each
        parts = properties[1].split(":")
        widths = [int(part) if part.isdigit() else 0 for part in parts[2::3]]
        if "pos" in parts[::3]:
            start = sum(widths[: parts[::3].index("pos")])
            return _numbers(rows, list(range(start, start + 3)), separator)
    is_species = not is_number(fields[0]) or all(re.fullmatch(r"\d+", _split(r[1], separator)[0]) for r in rows)
    if len(fields) < 4 and is_number(fields[0]):
        return _numbers(rows, _unnamed(rows, [], separator), separator)
    if not is_species:
        raise FileFormatError(f"XYZ has a species and x, y, z in each line; got {rows[0][1][:40]!r}: {_CHOICES}")
    return _numbers(rows, list(range(1, min(4, len(fields)))), separator)
