"""Device tables: what a logger wrote is what is read, or the file is refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbar.acquisition.report import Finding
from ballbar.acquisition.table.header import Layout
from ballbar.acquisition.table.table import Form, Table, read_table
from ballbar.cell.errors import LogError

COUNTERS = Layout(
    (";", ","), {"time": "integer", "b1": "integer", "b2": "integer"}, {"s1": "integer"}
)
MOTORS = Layout((",", ";", "\t"), {"time": "float", "m1": "float", "m2": "float"})
# [ns] near 2034 in time since 2000; the last digit is lost in a float64.
EPOCH = 1_100_000_000_000_000_001


def read(
    folder: Path, content: bytes | str, layout: Layout = COUNTERS
) -> tuple[Table, Form, list[Finding]]:
    raw = content if isinstance(content, bytes) else content.encode()
    (folder / "log.csv").write_bytes(raw)
    table, form = read_table(folder / "log.csv", "raw/log.csv", layout)
    return table, form, list(table.findings)


def refusal(folder: Path, content: bytes | str, layout: Layout = COUNTERS) -> str:
    with pytest.raises(LogError, match=r"^raw/log\.csv") as caught:
        read(folder, content, layout)
    return str(caught.value)


def kinds(findings: list[Finding]) -> list[tuple[str, tuple[int, ...], int]]:
    return [(entry.kind, entry.lines, entry.count) for entry in findings]


def test_nanosecond_stamps_and_counters_are_read_to_the_last_digit(tmp_path: Path) -> None:
    table, form, findings = read(
        tmp_path, f"time;b1;b2\n{EPOCH};4294967295;-5\n{EPOCH + 1};{2**63 - 1};{-(2**63)}\n"
    )
    assert table.columns["time"].dtype == np.int64
    assert table.columns["time"].tolist() == [EPOCH, EPOCH + 1]
    assert table.columns["b1"].tolist() == [4294967295, 2**63 - 1]
    assert table.columns["b2"].tolist() == [-5, -(2**63)]
    assert (form, findings) == (Form("utf-8", "semicolon", "point", 2), [])


def test_columns_are_found_by_name_in_any_order_and_separator_and_others_are_named(
    tmp_path: Path,
) -> None:
    table, form, findings = read(
        tmp_path, "note,b2,extra,time,s1,b1\nx,2,hello,10,7,1\ny,4,world,20,8,3\n"
    )
    assert {name: column.tolist() for name, column in table.columns.items()} == {
        "time": [10, 20],
        "b1": [1, 3],
        "b2": [2, 4],
        "s1": [7, 8],
    }
    assert form.separator == "comma"
    assert [(entry.kind, entry.severity, entry.sentence) for entry in findings] == [
        ("column not used", "warning", "note, extra.")
    ]


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r", "\n\r\n"])
@pytest.mark.parametrize("quote", ["", '"'])
@pytest.mark.parametrize("codec", ["utf-8", "utf-8-sig", "utf-16"])
def test_line_ends_quotes_and_encodings_do_not_change_the_numbers(
    tmp_path: Path, newline: str, quote: str, codec: str
) -> None:
    rows = [["time", "b1", "b2"], [str(EPOCH), "1", "2"], [str(EPOCH + 5), "3", "-4"]]
    text = "".join(";".join(f"{quote}{cell}{quote}" for cell in row) + newline for row in rows)
    table, _, findings = read(tmp_path, text.encode(codec))
    assert [table.columns[name].tolist() for name in COUNTERS.required] == [
        [EPOCH, EPOCH + 5],
        [1, 3],
        [2, -4],
    ]
    assert ("encoding" in [entry.kind for entry in findings]) == (codec != "utf-8")


def test_western_windows_bytes_in_an_unused_column_are_read_and_reported(tmp_path: Path) -> None:
    table, form, findings = read(
        tmp_path, "time;b1;b2;cost \u20ac\n1;2;3;l\u00e4ge\n".encode("cp1252")
    )
    assert table.columns["b2"].tolist() == [3]
    assert form.encoding == "cp1252"
    assert [(entry.kind, entry.sentence) for entry in findings] == [
        ("encoding", "read as cp1252."),
        ("column not used", "cost \u20ac."),
    ]


def test_a_last_line_without_line_end_is_dropped_even_at_full_width(tmp_path: Path) -> None:
    # Counter 2000000049 cut to 200000: full width, and wrong (notes/log_formats sec. H.5).
    table, form, findings = read(tmp_path, "time;b1;b2\n1;2;2000000001\n2;3;200000")
    assert table.columns["b2"].tolist() == [2000000001]
    assert form.rows_read == 1
    assert kinds(findings) == [("unterminated last line", (3,), 1)]


def test_nul_bytes_at_the_end_are_left_out_with_their_byte_range(tmp_path: Path) -> None:
    content = b"time;b1;b2\n1;2;3\n2;3;4\n3;4"
    table, _, findings = read(tmp_path, content + bytes(100))
    assert table.columns["time"].tolist() == [1, 2]
    assert kinds(findings) == [("NUL block at the end", (), 1), ("unterminated last line", (4,), 1)]
    assert f"bytes {len(content)} to {len(content) + 99} are NUL" in findings[0].sentence


def test_nul_bytes_inside_a_row_are_refused_with_their_byte_range(tmp_path: Path) -> None:
    message = refusal(tmp_path, b"time;b1;b2\r\n1;2;3\r\n2;\0\0\0\0;4\r\n3;4;5\r\n")
    assert "raw/log.csv:3: NUL bytes inside the row (bytes 21 to 24)" in message
    assert "(bytes 14 to 14)" in refusal(tmp_path, b"\xef\xbb\xbftime;b1;b2\n\0;2;3\n")
    assert "(bytes 24 to 25)" in refusal(tmp_path, "\ufefftime;b1;b2\n\0;2;3\n".encode("utf-16-le"))


def test_utf_16_without_mark_is_named_as_such(tmp_path: Path) -> None:
    assert "UTF-16 without byte order mark" in refusal(
        tmp_path, ("time;b1;b2\n" + "1;2;3\n" * 40).encode("utf-16-le")
    )


def test_blank_lines_are_skipped_and_line_numbers_still_those_of_the_file(tmp_path: Path) -> None:
    table, _, findings = read(tmp_path, "\ntime;b1;b2\n\n1;2;3\n   \n2;3;4\n")
    assert table.line.tolist() == [4, 6]
    assert table.location(1) == "raw/log.csv:6"
    assert kinds(findings) == [("blank line", (1, 3, 5), 3)]


def test_a_torn_line_in_the_middle_is_dropped_with_its_number(tmp_path: Path) -> None:
    lines = ["time;b1;b2"] + [f"{i};{i};{i}" for i in range(200)]
    lines[100] = "99;9"
    table, _, findings = read(tmp_path, "\n".join(lines) + "\n")
    assert 99 not in table.columns["time"]
    assert len(table) == 199
    assert kinds(findings) == [("torn line", (101,), 1)]
    assert findings[0].sentence == "expected 3 fields, got 2; treated as torn line and dropped."


def test_an_unclosed_quote_tears_one_line_only(tmp_path: Path) -> None:
    table, _, findings = read(tmp_path, 'time;b1;b2\n"1";"2";"3"\n"2";"3;"4"\n"3";"4";"5"\n')
    assert table.columns["time"].tolist() == [1, 3]
    assert kinds(findings) == [("torn line", (3,), 1)]


def test_more_than_one_torn_line_in_a_hundred_is_refused(tmp_path: Path) -> None:
    lines = ["time;b1;b2"] + [f"{i};{i};{i}" for i in range(200)]
    lines[100] = lines[120] = lines[140] = "99;9"
    assert (
        "raw/log.csv:101: 3 of 200 rows do not have the header's number of fields: expected 3 "
        "fields, got 2" in refusal(tmp_path, "\n".join(lines) + "\n")
    )


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read_where_the_separator_is_another(
    tmp_path: Path, separator: str
) -> None:
    text = "time;m1;m2\n0,5;-1,25;3.5\n1;2,5e-3;4.5\n".replace(";", separator)
    table, form, findings = read(tmp_path, text, MOTORS)
    assert [table.columns[name].tolist() for name in MOTORS.required] == [
        [0.5, 1.0],
        [-1.25, 0.0025],
        [3.5, 4.5],
    ]
    assert form.decimal == "comma"
    assert [(entry.kind, entry.sentence) for entry in findings] == [
        ("decimal comma", "read as decimal point in time, m1.")
    ]


def test_decimal_commas_with_comma_separator_are_refused(tmp_path: Path) -> None:
    message = refusal(tmp_path, "time,m1,m2\n" + "0,004,1,5,2,5\n" * 60, MOTORS)
    assert (
        "raw/log.csv:2: 6 fields, the header has 3: decimal comma with comma separator" in message
    )


def test_quoted_decimal_commas_with_comma_separator_are_refused(tmp_path: Path) -> None:
    assert "column time: '0,004' is not a number" in refusal(
        tmp_path, 'time,m1,m2\n"0,004","1,5","2,5"\n' * 2, MOTORS
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "raw/log.csv: the file is empty"),
        ("\0\0\0", "raw/log.csv: the file holds nothing but NUL bytes"),
        ("\n \n", "raw/log.csv: the file holds no complete line"),
        ("time;b1;b2", "raw/log.csv: the file holds no complete line"),
        ("time;b1;b2\n", "raw/log.csv: a header but no complete row below it"),
        ("time;b1;b2\n1;2\n", "raw/log.csv: the only row below the header is torn"),
        (
            "1;2;3\n2;3;4\n",
            "raw/log.csv:1: the first line holds numbers, not column names. Expected a header "
            "with time, b1, b2",
        ),
        (
            "time;b1;B2\n1;2;3\n",
            "raw/log.csv:1: column b2 missing; the header has 'time', 'b1', 'B2'. Is 'B2' meant?",
        ),
        ("position;x\n1;2\n", "raw/log.csv:1: columns time, b1, b2 missing"),
        ("time;b1;b2;b1\n1;2;3;4\n", "raw/log.csv:1: column b1 stands 2 times in the header"),
        (
            "time\tb1\tb2\n1\t2\t3\n",
            "raw/log.csv:1: fields are separated by tab; this dialect has semicolon or comma",
        ),
        (
            "time;b1;b2\n1,2,3\n2,3,4\n",
            "raw/log.csv:2: the header is separated by semicolon, the rows by comma",
        ),
        ("time;b1;b2\n1;2;3\n2;;4\n", "raw/log.csv:3: column b1: '' is an empty cell"),
        ("time;b1;b2\n1;2;3\n\n2;ERR;4\n", "raw/log.csv:4: column b1: 'ERR' is not a number"),
        ("time;b1;b2\n1;2;3\n2;1_000;4\n", "raw/log.csv:3: column b1: '1_000' is not a number"),
        (
            "time;b1;b2\n1.32959733843760E+017;2;3\n",
            "raw/log.csv:2: column time: '1.32959733843760E+017' is in exponent form",
        ),
        ("time;b1;b2\n1;2.0;3\n", "raw/log.csv:2: column b1: '2.0' is not a whole number"),
        ("time;b1;b2\n1;2,0;3\n", "raw/log.csv:2: column b1: '2,0' is not a number"),
        (f"time;b1;b2\n1;{2**63};3\n", "does not fit a 64-bit integer"),
        (f"time;b1;b2\n1;{'9' * 6000};3\n", "does not fit a 64-bit integer"),
    ],
)
def test_a_table_of_counters_that_cannot_be_trusted_is_refused(
    tmp_path: Path, content: str, message: str
) -> None:
    assert message in refusal(tmp_path, content)


def test_a_header_that_stands_again_is_left_out_and_the_row_below_begins_a_stretch(
    tmp_path: Path,
) -> None:
    table, _, findings = read(tmp_path, "time;b1;b2\n1;2;3\ntime;b1;b2\n2;3;4\n3;4;5\n")
    assert table.columns["time"].tolist() == [1, 2, 3]
    assert table.begins.tolist() == [False, True, False]
    assert kinds(findings) == [("header again", (3,), 1)]


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ("0;nan;1", "column m1: 'nan' is not a number"),
        ("0;1;-inf", "column m2: '-inf' is not a number"),
        ("0;1e999;1", "column m1: '1e999' is beyond the largest number"),
        ("0;1.234.567;1", "column m1: '1.234.567' is not a number"),
        ("0;1,234,567;1", "column m1: '1,234,567' is not a number"),
        ("0;\u0661;1", "column m1: '\u0661' is not a number"),
        ("0;0x10;1", "column m1: '0x10' is not a number"),
    ],
)
def test_a_cell_that_is_no_number_is_named_by_line_and_column(
    tmp_path: Path, cells: str, message: str
) -> None:
    assert f"raw/log.csv:3: {message}" in refusal(tmp_path, f"time;m1;m2\n0;1;2\n{cells}\n", MOTORS)


def test_points_and_commas_mixed_in_a_column_are_refused(tmp_path: Path) -> None:
    message = refusal(tmp_path, "time;m1;m2\n0;0,5;2\n1;0.75;2\n", MOTORS)
    assert "column m1 has decimal commas and decimal points: '0,5' and '0.75'" in message


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"raw/none.csv: no such file"):
        read_table(tmp_path / "none.csv", "raw/none.csv", COUNTERS)


INT64 = st.integers(-(2**63), 2**63 - 1)
FLOATS = st.floats(allow_nan=False, allow_infinity=False)
FORMS = st.tuples(
    st.sampled_from(",;"),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["", '"']),
    st.permutations(range(3)),
)


@settings(max_examples=60, deadline=None)
@given(rows=st.lists(st.tuples(INT64, INT64, INT64), min_size=1, max_size=30), form=FORMS)
def test_integers_written_are_the_integers_read(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[int, ...]], form
) -> None:
    table, _, findings = read(
        tmp_path_factory.mktemp("log"), written(("time", "b1", "b2"), rows, form)
    )
    assert (
        list(zip(*(table.columns[name].tolist() for name in ("time", "b1", "b2")), strict=True))
        == rows
    )
    assert findings == []


@settings(max_examples=60, deadline=None)
@given(
    rows=st.lists(st.tuples(FLOATS, FLOATS, FLOATS), min_size=1, max_size=30),
    form=FORMS,
    comma=st.booleans(),
)
def test_floats_written_are_the_floats_read_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]], form, comma: bool
) -> None:
    text = written(("time", "m1", "m2"), rows, (";", *form[1:]) if comma else form)
    text = text.replace(".", ",") if comma else text
    table, _, _ = read(tmp_path_factory.mktemp("log"), text, MOTORS)
    for column, name in enumerate(("time", "m1", "m2")):
        assert np.array([row[column] for row in rows]).tobytes() == table.columns[name].tobytes()


def written(names: tuple[str, ...], rows: list[tuple], form: tuple) -> str:
    separator, newline, quote, order = form
    lines = [[names[i] for i in order], *([repr(row[i]) for i in order] for row in rows)]
    return "".join(
        separator.join(f"{quote}{cell}{quote}" for cell in line) + newline for line in lines
    )


@settings(max_examples=150, deadline=None)
@given(cut=st.integers(0, 10_000))
def test_a_file_cut_anywhere_gives_a_prefix_of_its_rows_or_a_refusal(
    tmp_path_factory: pytest.TempPathFactory, cut: int
) -> None:
    rows = [(EPOCH + 10_000_000 * i, 4294967295 - 1234567 * i, 98765 * i) for i in range(20)]
    whole = written(("time", "b1", "b2"), rows, (";", "\r\n", "", (0, 1, 2))).encode()
    content = whole[: cut % len(whole)]
    if content.count(b"\r") < 2:  # not even the header and one row
        assert (
            "complete" in (message := refusal(tmp_path_factory.mktemp("log"), content))
            or "empty" in message
        )
        return
    table, _, findings = read(tmp_path_factory.mktemp("log"), content)
    rows_read = list(
        zip(*(table.columns[name].tolist() for name in ("time", "b1", "b2")), strict=True)
    )
    assert rows_read == rows[: content.count(b"\r") - 1]
    assert ("unterminated last line" in [entry.kind for entry in findings]) == (
        not content.endswith((b"\r", b"\n"))
    )


@pytest.mark.parametrize("end", ["\n", "\n\n"])  # read at once, and line by line
def test_a_header_is_looked_for_behind_up_to_200_lines(tmp_path: Path, end: str) -> None:
    preamble = "".join(f"key {k};value{end}" for k in range(200))
    rows = f"time;b1;b2{end}1;2;3{end}"
    table, _, findings = read(tmp_path, preamble + rows)
    assert table.columns["b2"].tolist() == [3]
    assert ("preamble", 200) in [(entry.kind, entry.count) for entry in findings]
    assert "column" in refusal(tmp_path, f"one more;value{end}" + preamble + rows)
