"""Tests of files, numbers and tables as text."""

import pytest

from reportkit import text


def test_file_is_replaced_as_a_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.txt"
    text.write(path, "first\n")
    with pytest.raises(UnicodeEncodeError):
        text.write(path, "second \ud800\n")
    assert path.read_bytes() == b"first\n"
    text.write(path, "µ\n")
    assert path.read_bytes() == "µ\n".encode()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("value", "unit", "digits", "expected"),
    [
        (1.5, "m", 12, "1.5 m"),
        (1 / 3, "1", 3, "0.333"),
        (3, None, 12, "3"),
        (True, None, 12, "True"),
        ("RK6", None, 12, "RK6"),
        (1e-9, "s", 12, "1e-09 s"),
    ],
)
def test_number_keeps_its_unit(value, unit, digits, expected):
    assert text.number(value, unit, digits) == expected


def test_copies_of_studies_are_left_out(tmp_path):
    for stem in ("20_two", "10_one", "10_one (copy)", "10_one-Copy1", "10_one copy", "one", "1_x"):
        (tmp_path / f"{stem}.ipynb").touch()
    assert [path.stem for path in text.studies(tmp_path, ".ipynb")] == ["10_one", "20_two"]


def test_columns_are_aligned():
    table = text.columns(["name", "x"], [["a", "1.5"], ["longer", ""]])
    assert table.splitlines() == ["name    x", "------  ---", "a       1.5", "longer"]


@pytest.mark.parametrize(
    ("told", "text_of"),
    [
        ("1e-07", "10⁻⁷"),
        ("8.5e−05, 5e-06 to 0.0001", "8.5\u00a0·\u00a010⁻⁵, 5\u00a0·\u00a010⁻⁶ to 0.0001"),
        ("-4.1e+99 and 1.e-04", "-4.1\u00a0·\u00a010⁹⁹ and 10⁻⁴"),
        ("3e5 1.2.3e-4 9f1e-2 e-1 1e-2x", "3e5 1.2.3e-4 9f1e-2 e-1 1e-2x"),
    ],
)
def test_exponential_notation_is_set_as_powers(told, text_of):
    assert text.powers(told) == text_of
    assert text.markdown_table(["x"], [[told]]).splitlines()[-1] == f"| {text_of} |"


def test_a_number_stays_with_its_per_cent_sign():
    assert text.markdown_table(["5 %"], []).splitlines()[0] == "| 5\u00a0% |"


def test_digits_of_a_long_integer_stand_in_groups():
    cells = ["1400", "−87500 + 1.87500", "DOP85300", "$46732/4247$"]
    row = text.markdown_table(cells, []).splitlines()[0]
    assert row == "| 1400 | −87\u202f500 + 1.87500 | DOP85300 | $46732/4247$ |"


def test_markdown_table_escapes_its_cells():
    table = text.markdown_table(["a|b", "c"], [["x\ny", 1], ["|z|", 2.5]], right=[1])
    assert table == "| a\\|b | c |\n| --- | ---: |\n| x y | 1 |\n| \\|z\\| | 2.5 |\n"
