import contextlib
import gzip
import os
import sys

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_model.trace import LARGEST, Header, Row, TraceReader, write_trace

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


def test_a_note_may_hold_quotes_commas_and_colons(tmp_path) -> None:
    path = str(tmp_path / "trace.csv")
    write_trace(path, ["usb_degC"], [(0.0, [20.0])], {"map": 'a,"b",",c', "at": "12:30"})
    assert read(path)[0].notes == {"map": 'a,"b",",c', "at": "12:30"}


def test_a_note_of_two_lines_becomes_one(tmp_path) -> None:
    path = str(tmp_path / "trace.csv")
    write_trace(path, ["usb_degC"], [], {"remark": "warm\nwindy"})
    assert read(path)[0].notes == {"remark": "warm windy"}


def test_numpy_numbers_and_integers_are_written_as_numbers(tmp_path) -> None:
    import numpy as np

    path = tmp_path / "trace.csv"
    write_trace(str(path), ["usb_degC", "charging_on"], [(np.float64(0.1), [np.float64(20.5), 1])])
    assert path.read_text() == "time_s,usb_degC,charging_on\n0.1,20.5,1.0\n"


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
def test_what_the_contract_allows(tmp_path, content: str, wanted: tuple[Header, list[Row]]) -> None:
    path = tmp_path / "trace.csv"
    path.write_bytes(content.encode())
    assert read(str(path)) == wanted


HEAD = b"time_s,usb_degC\n"
NUMBER = "correct it, or leave the cell empty for a missing value"
FINITE = "leave the cell empty for a missing value"
SORT = "sort the rows and drop doubles: time must increase"
CUT = "fill or cut the row; an empty cell is a missing value"
CSV = "save it as UTF-8 CSV"
ZIPPED = gzip.compress(HEAD + b"".join(b"%d,20\n" % k for k in range(2000)), mtime=0)
COPY = "cut off or damaged? copy it again"

FAULTY = {
    "empty": (b"", "the file is empty; a trace starts with a header line 'time_s,<name>_<unit>,...'"),
    "notes only": (b"# a: b\n\n", "the file is empty; a trace starts with a header line 'time_s,<name>_<unit>,...'"),
    "first column": (
        b"# a: b\ntime,usb_degC\n",
        "line 2: the first column is 'time', not 'time_s'; "
        "put the time in seconds first, or use 'ambient-trainer import'",
    ),
    "no unit": (b"time_s,usb\n", "line 1: column 'usb' names no unit; name it <name>_<unit>, such as usb_degC"),
    "empty unit": (b"time_s,usb_\n", "line 1: column 'usb_' names no unit; name it <name>_<unit>, such as usb_degC"),
    "empty name": (b"time_s,,\n", "line 1: column '' names no unit; name it <name>_<unit>, such as usb_degC"),
    "double column": (b"time_s,a_K,b_K,a_K\n", "line 1: column 'a_K' stands twice; rename or remove one"),
    "time twice": (b"time_s,time_s\n", "line 1: column 'time_s' stands twice; rename or remove one"),
    "comma in a name": (
        b'time_s,"a,b_K"\n',
        "line 1: column 'a,b_K' holds a comma, a quote or a control character; rename it without",
    ),
    "NUL in a name": (
        b"time_s,a\0_K\n",
        r"line 1: column 'a\x00_K' holds a comma, a quote or a control character; rename it without"
        if sys.version_info >= (3, 11)
        else f"line 1: not CSV (line contains NUL); {CSV}",
    ),
    "text": (HEAD + b"0,20\n\n1,warm\n", f"line 4, column usb_degC: 'warm' is not a number; {NUMBER}"),
    "text in the time": (HEAD + b"now,20\n", f"line 2, column time_s: 'now' is not a number; {NUMBER}"),
    "decimal comma": (HEAD + b'0,"20,5"\n', f"line 2, column usb_degC: '20,5' is not a number; {NUMBER}"),
    "NaN": (HEAD + b"0,NaN\n", f"line 2, column usb_degC: 'NaN' is not a finite number; {FINITE}"),
    "NaN beside a blank": (
        b"time_s,a_K,b_K\n0, ,nan\n",
        f"line 2, column b_K: 'nan' is not a finite number; {FINITE}",
    ),
    "inf": (HEAD + b"0,-inf\n", f"line 2, column usb_degC: '-inf' is not a finite number; {FINITE}"),
    "an open thermocouple": (
        HEAD + b"0,20\n1,-9.9E+37\n",
        f"line 3, column usb_degC: '-9.9E+37' is beyond any measurement; {FINITE}",
    ),
    "a time of its own": (HEAD + b"1.1e30,0\n", f"line 2, column time_s: '1.1e30' is beyond any measurement; {FINITE}"),
    "a line without an end": (
        HEAD + b"0," + b"0" * 2**20,
        "line 2: not CSV (a line of more than 1048576 characters); save it as UTF-8 CSV",
    ),
    "1e999": (HEAD + b"1e999,0\n", f"line 2, column time_s: '1e999' is not a finite number; {FINITE}"),
    "backwards": (HEAD + b"2,0\n1,0\n", f"line 3, column time_s: 1 s does not come after 2 s; {SORT}"),
    "equal": (
        b"# a: b\n" + HEAD + b"1700000000.1,0\n1700000000.1,0\n",
        f"line 4, column time_s: 1700000000.1 s does not come after 1700000000.1 s; {SORT}",
    ),
    "no time": (HEAD + b",20\n", "line 2, column time_s: no time; every row needs one"),
    "short row": (HEAD + b"0\n", f"line 2: 1 cells where the header has 2; {CUT}"),
    "long row": (HEAD + b"0,1,\n", f"line 2: 3 cells where the header has 2; {CUT}"),
    "open quote": (HEAD + b'0,"20\n', f"line 2: not CSV (unexpected end of data); {CSV}"),
    "not UTF-8": (
        HEAD + b"0,1\n1,\xb0\n",
        rf"line 3, column usb_degC: '\udcb0' is not a number; {NUMBER}",
    ),
    "not UTF-8 in a name": (b"# a: b\ntime_s,usb_\xb0C\n", f"line 2: not UTF-8 text; {CSV}"),
    "not UTF-8 in a note": (b"# a: \xb0\n", f"line 1: not UTF-8 text; {CSV}"),
    "NUL": (
        HEAD + b"0,1\0\n",
        rf"line 2, column usb_degC: '1\x00' is not a number; {NUMBER}"
        if sys.version_info >= (3, 11)
        else f"line 2: not CSV (line contains NUL); {CSV}",
    ),
    "not gzip.gz": (HEAD, f"cannot be read (Not a gzipped file (b'ti')); {COPY}"),
    "truncated.gz": (
        ZIPPED[:-4],
        f"after line 2001: cannot be read (Compressed file ended before the end-of-stream marker was reached); {COPY}",
    ),
    "damaged.gz": (
        ZIPPED[:10] + b"\xff" * 10 + ZIPPED[20:],
        f"cannot be read (Error -3 while decompressing data: invalid block type); {COPY}",
    ),
}


@pytest.mark.parametrize("case", FAULTY)
def test_a_faulty_file_is_refused_with_its_place(tmp_path, case: str) -> None:
    content, message = FAULTY[case]
    path = tmp_path / ("trace.csv.gz" if case.endswith(".gz") else "trace.csv")
    path.write_bytes(content)
    with pytest.raises(Refused) as refused:
        read(str(path))
    assert str(refused.value) == f"{path}: {message}"


@pytest.mark.parametrize("suffix", ["csv", "csv.gz"])
def test_what_is_no_file_is_refused(tmp_path, suffix: str) -> None:
    path = tmp_path / f"trace.{suffix}"
    with pytest.raises(Refused) as refused:
        read(str(path))
    assert (
        str(refused.value) == f"{path}: cannot be read (No such file or directory); check the name and the permissions"
    )
    path.mkdir()
    with pytest.raises(Refused) as refused:
        read(str(path))
    assert str(refused.value) == f"{path}: cannot be read (Is a directory); check the name and the permissions"


def test_good_rows_come_before_the_fault(tmp_path) -> None:
    path = tmp_path / "trace.csv"
    path.write_bytes(HEAD + b"0,20\n1,21\n2,x\n")
    with TraceReader(str(path)) as reader:
        rows = iter(reader)
        assert [next(rows), next(rows)] == [Row(0.0, (20.0,)), Row(1.0, (21.0,))]
        with pytest.raises(Refused, match="line 4, column usb_degC"):
            next(rows)


def assert_rows_or_refused(path: str) -> None:
    """Rows that keep every promise of the reader, or a refusal; any other exception fails the test."""
    before = float("-inf")
    with contextlib.suppress(Refused), TraceReader(path) as reader:
        for row in reader:
            assert before < row.time_s < float("inf")
            assert len(row.values) == len(reader.header.columns)
            assert all(value is None or abs(value) <= LARGEST for value in row.values)
            before = row.time_s


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


@given(st.binary(max_size=200) | damaged(VALID))
@example(b"time_s,a_K,b_K\n0, ,nan\n")
@settings(max_examples=400)
def test_arbitrary_bytes_are_rows_or_refused(folder: str, content: bytes) -> None:
    path = os.path.join(folder, "any.csv")
    with open(path, "wb") as stream:
        stream.write(content)
    assert_rows_or_refused(path)


@given(st.binary(max_size=60) | damaged(gzip.compress(VALID, mtime=0)) | damaged(VALID).map(gzip.compress))
@settings(max_examples=300)
def test_arbitrary_compressed_bytes_are_rows_or_refused(folder: str, content: bytes) -> None:
    path = os.path.join(folder, "any.csv.gz")
    with open(path, "wb") as stream:
        stream.write(content)
    assert_rows_or_refused(path)


@pytest.mark.parametrize(
    ("columns", "rows", "message"),
    [
        (["usb"], [], "header: column 'usb' names no unit; name it <name>_<unit>, such as usb_degC"),
        (["a_K", "a_K"], [], "header: column 'a_K' stands twice; rename or remove one"),
        (["time_s"], [], "header: column 'time_s' stands twice; rename or remove one"),
        (["a\n_K"], [], r"header: column 'a\n_K' holds a comma, a quote or a control character; rename it without"),
        (["a_K"], [(0, [1.0]), (1, [float("nan")])], "row 2: [1.0, nan] is no sample of 1 values after 0 s"),
        (["a_K"], [(0, [float("inf")])], "row 1: [0.0, inf] is no sample of 1 values after -inf s"),
        (["a_K"], [(1, [None]), (1, [None])], "row 2: [1.0, None] is no sample of 1 values after 1 s"),
        (["a_K"], [(float("nan"), [None])], "row 1: [nan, None] is no sample of 1 values after -inf s"),
        (["a_K"], [(1, [2.0, 3.0])], "row 1: [1.0, 2.0, 3.0] is no sample of 1 values after -inf s"),
    ],
)
def test_what_would_not_be_read_is_not_written(tmp_path, columns: list[str], rows: list, message: str) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("old")
    if rows:
        message += "; time increases, and what is not a finite number, or a huge one, is missing: nothing was written"
    with pytest.raises(Refused) as refused:
        write_trace(str(path), columns, rows)
    assert str(refused.value) == f"{path}: {message}"
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["trace.csv"]
