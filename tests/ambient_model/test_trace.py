import contextlib
import gzip
import os

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_model.trace import LARGEST, Header, Row, TraceReader, write_trace
from refusals import refused

finite = st.floats(-LARGEST, LARGEST)
words = st.text(st.characters(exclude_characters='_,"', exclude_categories=["C", "Z"]), min_size=1, max_size=6)
names = st.builds("{}_{}".format, words, words).filter(lambda name: name != "time_s")
notes = st.dictionaries(
    words.filter(lambda word: ":" not in word and "#" not in word),
    st.text(st.characters(exclude_categories=["C"]), max_size=12).map(str.strip),
    max_size=3,
)


@st.composite
def tables(draw: st.DrawFn) -> tuple[list[str], list[Row]]:
    columns = draw(st.lists(names, max_size=4, unique=True))
    times = sorted(draw(st.lists(finite, max_size=6, unique=True)))
    return columns, [Row(time_s, draw(st.tuples(*[st.none() | finite] * len(columns)))) for time_s in times]


def read(path: str) -> tuple[Header, list[Row]]:
    with TraceReader(path) as reader:
        return reader.header, list(reader)


@given(tables(), notes, st.sampled_from(["trace.csv", "trace.csv.gz"]))
def test_what_is_written_is_read_back(folder: str, table: tuple[list[str], list[Row]], kept: dict, name: str) -> None:
    path = os.path.join(folder, name)
    columns, rows = table
    assert write_trace(path, columns, rows, kept) == len(rows)
    assert read(path) == (Header(tuple(columns), kept), rows)


def test_a_note_may_hold_quotes_commas_and_colons_and_two_lines_become_one(tmp_path) -> None:
    path = str(tmp_path / "trace.csv")
    write_trace(path, ["usb_degC"], [(0.0, [20.0])], {"map": 'a,"b",",c', "at": "12:30", "remark": "warm\nwindy"})
    assert read(path)[0].notes == {"map": 'a,"b",",c', "at": "12:30", "remark": "warm windy"}


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        ("time_s,usb_degC\n", (Header(("usb_degC",), {}), [])),
        ("time_s\n1\n2\n", (Header((), {}), [Row(1.0, ()), Row(2.0, ())])),
        (
            "time_s,usb_degC\r\n0,20.5\r\n\r\n1,\r\n",
            (Header(("usb_degC",), {}), [Row(0.0, (20.5,)), Row(1.0, (None,))]),
        ),
        ("time_s, usb_degC\n 0 , 20.5 \n1,  ", (Header(("usb_degC",), {}), [Row(0.0, (20.5,)), Row(1.0, (None,))])),
        ('"time_s","usb_degC"\n"0","2e1"\n', (Header(("usb_degC",), {}), [Row(0.0, (20.0,))])),
        ("\n# device: a\n\ntime_s,usb_degC\n-1,0\n", (Header(("usb_degC",), {"device": "a"}), [Row(-1.0, (0.0,))])),
        ("\ufeff# device: a\ntime_s\n0\n", (Header((), {"device": "a"}), [Row(0.0, ())])),
        ("\ufefftime_s\n0\n", (Header((), {}), [Row(0.0, ())])),
    ],
    ids=["header only", "time only", "CRLF", "spaces", "quotes", "notes", "mark and note", "mark"],
)
def test_what_the_contract_allows(write, content: str, wanted: tuple[Header, list[Row]]) -> None:
    assert read(write("trace.csv", content)) == wanted


HEAD = b"time_s,usb_degC\n"
ZIPPED = gzip.compress(HEAD + b"".join(b"%d,20\n" % k for k in range(2000)), mtime=0)

FAULTY = {
    # what is read, and the place and the cell that its message names
    "empty": (b"", "the file is empty"),
    "notes only": (b"# a: b\n\n", "the file is empty"),
    "first column": (b"# a: b\ntime,usb_degC\n", "line 2: 'time'"),
    "no unit": (b"time_s,usb\n", "line 1: 'usb'"),
    "empty unit": (b"time_s,usb_\n", "line 1: 'usb_'"),
    "empty name": (b"time_s,,\n", "line 1: ''"),
    "double column": (b"time_s,a_K,b_K,a_K\n", "line 1: 'a_K'"),
    "time twice": (b"time_s,time_s\n", "line 1: 'time_s'"),
    "comma in a name": (b'time_s,"a,b_K"\n', "line 1: 'a,b_K'"),
    "NUL in a name": (b"time_s,a\0_K\n", "line 1"),
    "text": (HEAD + b"0,20\n\n1,warm\n", "line 4, column usb_degC: 'warm'"),
    "text in the time": (HEAD + b"now,20\n", "line 2, column time_s: 'now'"),
    "decimal comma": (HEAD + b'0,"20,5"\n', "line 2, column usb_degC: '20,5'"),
    "NaN": (HEAD + b"0,NaN\n", "line 2, column usb_degC: 'NaN'"),
    "NaN beside a blank": (b"time_s,a_K,b_K\n0, ,nan\n", "line 2, column b_K: 'nan'"),
    "inf": (HEAD + b"0,-inf\n", "line 2, column usb_degC: '-inf'"),
    "an open thermocouple": (HEAD + b"0,20\n1,-9.9E+37\n", "line 3, column usb_degC: '-9.9E+37'"),
    "a time of its own": (HEAD + b"1.1e30,0\n", "line 2, column time_s: '1.1e30'"),
    "a line without an end": (HEAD + b"0," + b"0" * 2**20, "line 2: not CSV (a line"),
    "backwards": (HEAD + b"2,0\n1,0\n", "line 3, column time_s: 1 s does not"),
    "equal": (
        b"# a: b\n" + HEAD + b"1700000000.1,0\n1700000000.1,0\n",
        "line 4, column time_s: 1700000000.1 s does not",
    ),
    "no time": (HEAD + b",20\n", "line 2, column time_s: no time"),
    "short row": (HEAD + b"0\n", "line 2: 1 cells where the"),
    "long row": (HEAD + b"0,1,\n", "line 2: 3 cells where the"),
    "open quote": (HEAD + b'0,"20\n', "line 2: not CSV (unexpected end"),
    "not UTF-8": (HEAD + b"0,1\n1,\xb0\n", "line 3, column usb_degC: '\\udcb0'"),
    "not UTF-8 in a name": (b"# a: b\ntime_s,usb_\xb0C\n", "line 2: not UTF-8 text"),
    "not UTF-8 in a note": (b"# a: \xb0\n", "line 1: not UTF-8 text"),
    "NUL": (HEAD + b"0,1\0\n", "line 2"),
    "not gzip.gz": (HEAD, ""),
    "truncated.gz": (ZIPPED[:-4], "after line 2001"),
    "damaged.gz": (ZIPPED[:10] + b"\xff" * 10 + ZIPPED[20:], ""),
}


@pytest.mark.parametrize("case", FAULTY)
def test_a_faulty_file_is_refused_with_its_place(tmp_path, case: str) -> None:
    content, expected = FAULTY[case]
    place, _, fact = expected.partition(": ") if "line " in expected else ("", "", expected)
    path = tmp_path / ("trace.csv.gz" if case.endswith(".gz") else "trace.csv")
    path.write_bytes(content)
    [fault] = refused(read, str(path)).faults
    assert fault.place.startswith(place)
    assert fact in fault.problem
    assert fault.hint


VALID = b"# device: a\ntime_s,usb_degC,cpu_power_W\n0,20.5,\n1,,1e-3\n2,21,2\n"
pieces = st.sampled_from(
    [b",", b"\n", b"\r", b'"', b"#", b"\0", b"\xff", b"nan", b"1e999", b"_", b" ", b"\xef\xbb\xbf", b"1_0"]
)


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(content)))
        content = content[:at] + draw(pieces | st.binary(max_size=3)) + content[at + draw(st.integers(0, 4)) :]
    return content


compressed = st.binary(max_size=60) | damaged(gzip.compress(VALID, mtime=0)) | damaged(VALID).map(gzip.compress)
plain = st.binary(max_size=200) | damaged(VALID)


@given(st.tuples(plain, st.just("csv")) | st.tuples(compressed, st.just("csv.gz")))
@example((b"time_s,a_K,b_K\n0, ,nan\n", "csv"))
@settings(max_examples=300)
def test_arbitrary_bytes_are_rows_or_refused(folder: str, file: tuple[bytes, str]) -> None:
    path = os.path.join(folder, f"any.{file[1]}")
    with open(path, "wb") as stream:
        stream.write(file[0])
    before = float("-inf")
    with contextlib.suppress(Refused), TraceReader(path) as reader:
        for row in reader:
            assert before < row.time_s < float("inf")
            assert len(row.values) == len(reader.header.columns)
            assert all(value is None or abs(value) <= LARGEST for value in row.values)
            before = row.time_s


@pytest.mark.parametrize(
    ("columns", "rows", "place"),
    [
        *[([name], [], "header") for name in ("usb", "time_s", "a\n_K")],
        (["a_K", "a_K"], [], "header"),
        (["a_K"], [(0, [1.0]), (1, [float("nan")])], "row 2"),
        (["a_K"], [(0, [float("inf")])], "row 1"),
        (["a_K"], [(1, [None]), (1, [None])], "row 2"),
        (["a_K"], [(float("nan"), [None])], "row 1"),
        (["a_K"], [(1, [2.0, 3.0])], "row 1"),
    ],
)
def test_what_would_not_be_read_is_not_written(tmp_path, columns: list[str], rows: list, place: str) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("old")
    assert refused(write_trace, str(path), columns, rows).faults[0].place == place
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["trace.csv"]
