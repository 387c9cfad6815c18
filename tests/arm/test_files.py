"""Records and axis files: what is read, what is refused and how, and the committed ones."""

import dataclasses
import runpy
import tomllib

import numpy as np
import pytest

from armsim.arm import AxisParameters, simulate
from armsim.arm.files import read_axis, read_measurement, write_measurement
from armsim.arm.measurement import MIN_SAMPLES, Measurement, signals
from armsim.paths import DATA

RECORDS = DATA / "measurements"
P = AxisParameters.paper_x_axis()
T = np.arange(30) * 0.002 + 5.0
HEADER = "time [s],set_velocity [V],position [m],velocity [m/s],acceleration [m/s^2]"
ROWS = [f"{t:.3f},10,0.1,0.2,0.3" for t in T]


def written(folder, text, name="run.csv"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# --- files of records ---------------------------------------------------------------------------


def test_record_survives_the_way_through_a_file(tmp_path, rng):
    volts = np.where(T < 5.01, 0, 9.0)
    one = Measurement(T, volts, rng.random(30), rng.random(30) * 1e-9, np.zeros(30))
    write_measurement(tmp_path / "run.csv", one, "two lines\nof text")
    two = read_measurement(tmp_path / "run.csv")
    for item in dataclasses.fields(one):
        np.testing.assert_array_equal(getattr(one, item.name), getattr(two, item.name))


def test_columns_come_in_any_order_between_comments_and_from_windows(tmp_path):
    header = '# mine\r\n\r\n velocity [m/s] ,"time [s]",acceleration [m/s²],position[m],'
    rows = [f"0.2,{t:.3f},0.3,0.1,10" for t in T]
    text = "\ufeff" + "\r\n".join([header + "set_velocity [ V ]", *rows[:9], "# again", *rows[9:]])
    found = read_measurement(written(tmp_path, text))
    np.testing.assert_allclose(found.t, T)
    np.testing.assert_allclose(found.signals[:, 7], [0.1, 0.2, 0.3])
    assert found.schedule == ((0.0, 10.0),)


@pytest.mark.parametrize(("separator", "point"), [(";", ","), (";", "."), ("\t", ","), (",", ".")])
def test_separator_is_that_of_the_header(tmp_path, separator, point):
    text = "\n".join([HEADER, *ROWS]).replace(",", separator).replace(".", point)
    found = read_measurement(written(tmp_path, f"sep={separator}\n{text}\n{4 * separator}\n"))
    np.testing.assert_array_equal(found.t, T.round(3))
    np.testing.assert_array_equal(found.signals[:, 7], [0.1, 0.2, 0.3])


def changed(row, text):
    """The file with a row, counted as in an editor, replaced."""
    lines = [HEADER, *ROWS]
    lines[row - 1] = text
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "run.csv: the file has no header"),
        ("# only this\n", "run.csv: the file has no header"),
        (HEADER, f"run.csv: 0 samples; at least {MIN_SAMPLES} are needed"),
        ("\n".join([HEADER, *ROWS[:5]]), "run.csv: 5 samples"),
        (b"\x89PNG\r\n\x1a\n\0\0", "run.csv: not a text file"),
        (HEADER.encode("utf-16"), "run.csv: not a text file"),
        ("m\xb2".encode("latin-1"), "run.csv: not a text file"),
        (changed(1, HEADER.replace("position [m],", "")), "row 1: missing column position"),
        (changed(1, HEADER.replace("velocity [m/s]", "velocty [m/s]")), "did you mean velocity"),
        (changed(1, HEADER.replace("time", "Time")), "'Time' is known; did you mean time"),
        (changed(1, HEADER + ",time [s]"), "row 1: the column 'time' appears twice"),
        (changed(1, HEADER.replace("[m]", "[mm]")), "'position' has the unit 'mm'; allowed is 'm'"),
        (changed(1, HEADER.replace("time [s]", "time")), "'time' has the unit ''; allowed is 's'"),
        (changed(1, ROWS[0]), "row 1: no column '5.000' is known"),
        (changed(1, HEADER.replace(",", ";")), "row 2: 1 cells; the header has 5 columns"),
        (changed(1, HEADER.replace(",", " ")), "row 1: no column 'time"),
        (changed(7, "5,010,10,0,1,0,2,0,3"), "row 7: 9 cells; .*; decimal commas need semicolons"),
        (changed(7, '"5,010",10,"0,1",1,2'), "row 7: 7 cells; .*; decimal commas need semicolons"),
        (
            changed(7, "5.010,10,0.1,0.2,0.3").replace(",", ";") + "\n5,070;1;1;1;1",
            "row 2: time = '5.000' is not a number; the file has decimal commas",
        ),
        (changed(7, "5.010,10,0.1,0.2"), "row 7: 4 cells; the header has 5 columns"),
        (changed(7, "5.010,10,0.1,0.2,0.3,"), "row 7: 6 cells"),
        (changed(7, "5.010,10,,0.2,0.3"), "row 7: position = '' is not a number"),
        (changed(7, "5.010,ten,0.1,0.2,0.3"), "row 7: set_velocity = 'ten' is not a number"),
        (changed(7, "5.010,1_0,0.1,0.2,0.3"), "row 7: set_velocity = '1_0' is not a number"),
        (changed(7, "9" * 200_000), "row 7: 1 cells"),
        (changed(7, "5.010,10,nan,0.2,0.3"), "row 7: position = nan is not finite"),
        (changed(7, "5.010,10,0.1,-inf,0.3"), "row 7: velocity = -inf is not finite"),
        (changed(7, "5.008,10,0.1,0.2,0.3"), "row 7: time = 5.008 appears twice"),
        (changed(7, "4.008,10,0.1,0.2,0.3"), "row 7: time = 4.008 comes after 5.008"),
        (changed(7, "# lost"), "row 8: time = 5.012 is 0.004 s after .* sampling has to be even"),
    ],
)
def test_bad_record_is_refused_with_place_and_reason(tmp_path, text, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_measurement(written(tmp_path, text))
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)


def test_missing_file_says_so(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_measurement(tmp_path / "none.csv")


# --- files of axes ------------------------------------------------------------------------------

AXIS = (DATA / "axes" / "x.toml").read_text(encoding="utf-8")


def test_x_axis_is_the_papers():
    assert read_axis(DATA / "axes" / "x.toml")[0] == P


def test_instrument_of_the_axis_file_is_that_of_the_records():
    i = tomllib.loads((RECORDS / "truth.toml").read_text(encoding="utf-8"))["instrument"]
    steps = [2 * np.pi * P.r_g / i["counts"]]
    steps += [2 * i[f"{name}_range"] / 2 ** i[f"{name}_bits"] for name in SIGNALS[1:]]
    noise = [np.hypot(i[f"{n}_noise"], q / 12**0.5) for n, q in zip(SIGNALS, steps, strict=True)]
    _, instrument = read_axis(DATA / "axes" / "x.toml")
    np.testing.assert_allclose(instrument.deviations.ravel(), noise, rtol=5e-3)


SIGNALS = ("position", "velocity", "acceleration")


@pytest.mark.parametrize("name", ["x", "y", "z"])
def test_axis_runs_at_1_m_per_s_within_its_limits(name):
    p, _ = read_axis(DATA / "axes" / f"{name}.toml")
    run = simulate(p, 10.0, 3.0)
    v_c, v_m = (run.auxiliary([3.0])[item][0] for item in ("v_c", "v_m"))
    assert run(3.0)[1] == pytest.approx(1, abs=1e-3)
    assert abs(v_c) < p.V_L and abs(v_m) < p.V_M
    assert p.M <= P.M


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[axis]", "[axes]", "table 'axes' is not known; did you mean axis"),
        ("[axis]", "axis = 1\n[other]", "table 'other' is not known"),
        ("R_a =", "R_aa =", r"\[axis\]: value 'R_aa' is not known; did you mean R_a"),
        ("M = 146.0 ", "# ", r"\[axis\]: value M missing"),
        ("M = 146.0 ", "M = '146' ", r"\[axis\]: M = '146' is a str"),
        ("M = 146.0 ", "M = -1.0 ", r"\[axis\]: M = -1.0 is not allowed"),
        ("velocity = 5.01e-3", "velocity = true", r"\[instrument\]: velocity = True"),
        ("velocity = 5.01e-3", "velocity = 0", r"\[instrument\]: velocity = 0 is not allowed"),
        ("[instrument]", "[instrument", "not a TOML file"),
        ('"x"', '["x"]', r"\[axis\]: choices = \['x'\]; allowed are x, y, z"),
        ("[instrument]", "a = " + 5000 * "[", "not a TOML file"),
        ("M = 146.0 ", f"M = {10**400} ", r"\[axis\]: M = 1000.* is not allowed"),
    ],
)
def test_bad_axis_is_refused(tmp_path, old, new, message):
    path = written(tmp_path, AXIS.replace(old, new), "axis.toml")
    with pytest.raises(ValueError, match=f"axis.toml.*{message}"):
        read_axis(path)


def test_gain_may_be_given(tmp_path):
    path = written(tmp_path, AXIS.replace("[axis]", "[axis]\nK_1 = 900"), "axis.toml")
    assert read_axis(path)[0].K_1 == 900


# --- the committed records ----------------------------------------------------------------------


def test_script_makes_the_committed_records_again(tmp_path):
    script = runpy.run_path(str(RECORDS / "make_measurements.py"))
    script["main"](tmp_path)
    for name in ("x_axis_test.csv", "x_axis_test_curved.csv", "x_axis_move.csv"):
        assert (tmp_path / name).read_bytes() == (RECORDS / name).read_bytes()
        assert (RECORDS / name).read_text(encoding="utf-8").startswith("# SYNTHETIC")


def test_curved_motion_without_curvature_is_the_exact_one():
    script = runpy.run_path(str(RECORDS / "make_measurements.py"))
    script["TRUTH"]["curved"]["B_2"] = 0.0
    p, (t, volts) = script["true_axis"](), script["run"]()
    changes = [(t[n], volts[n]) for n in np.flatnonzero(np.diff(volts, prepend=0.0))]
    _, instrument = read_axis(DATA / "axes" / "x.toml")
    exact = signals(simulate(p, changes, t[-1])(t), t, p)
    error = (signals(script["curved_states"](p, t), t, p) - exact) / instrument.deviations
    assert np.abs(error).max() < 5e-3  # 7e-4 is seen
