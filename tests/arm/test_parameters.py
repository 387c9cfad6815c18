"""The parameters against the paper, typed here a second time, and against a solved steady state."""

import dataclasses
import math
import pickle
from fractions import Fraction

import numpy as np
import pytest

from armsim.arm import AxisParameters
from armsim.arm.dynamics import Region, affine
from armsim.paper import TABLES

# Tables 3 and 4 and Section 4 of the paper.
SHARED = {
    "R_a": 0.56,
    "L_a": 0.00235,
    "K_b": 0.289,
    "J_m": 0.000847,
    "B_m": 0.000733,
    "K_t": 0.0668,
    "r_g": 0.00573,
    "H": 0.00001,
    "M": 146,
    "T_z": 0.00705,
    "T_p": 0.04,
    "T_r": 0.000159,
    "K_2": 870,
    "K_i": 3,
    "V_M": 95,
}
# Table 5, both columns.
FITTED = {
    "ndp": {"V_L": 2.783, "B_a": 211, "b_g": 1500, "K_g": 5.264e6},
    "rk6": {"V_L": 2.77, "B_a": 212, "b_g": 1500, "K_g": 5.275e6},
}
OURS = {"K_e": 100, "F_0": 20, "v_s": 0.01}
NAMES = [item.name for item in dataclasses.fields(AxisParameters)]
MAY_BE_ZERO = {"B_m", "H", "T_z", "K_2", "B_a", "b_g", "F_0", "v_s", "K_1"}


@pytest.fixture
def p():
    return AxisParameters.paper_x_axis()


@pytest.mark.parametrize("fit", ["ndp", "rk6"])
def test_every_value_is_the_papers(fit):
    p = AxisParameters.paper_x_axis(fit=fit)
    values = dataclasses.asdict(p)
    del values["K_1"]
    assert values == SHARED | FITTED[fit] | OURS


def test_printed_values_that_are_not_used_are_the_papers_too():
    """Ranges, both prints of K_b and the saturation current; pages show them."""
    cells = {
        (row["symbol"], row.get("value") or (row["ndp"], row["rk6"]))
        for table in ("table3", "table4", "table5")
        for row in TABLES[table]
    }
    assert {
        ("K_b", "0.289 volt sec/rad"),
        ("K_b", "0.289 N m/amp"),
        ("T_p", "0.0071 to 4.74 sec"),
        ("K_1", "0 to 3333"),
        ("K_2", "80 to 870"),
        ("I_M", ("8.125 amp", "8.0 amp")),
    } <= cells
    assert len(cells) == 10 + 7 + 5


def test_the_default_fit_is_the_novel_dormand_prince_column(p):
    assert p == AxisParameters.paper_x_axis(fit="ndp")


def test_saturation_current_is_near_the_printed_one(p):
    # Table 5 prints 8.125 A for K_i V_L = 8.349 A, and 8.0 A for 8.31 A: within 5 %.
    assert p.K_i * p.V_L == pytest.approx(8.125, rel=0.05)
    rk6 = AxisParameters.paper_x_axis(fit="rk6")
    assert rk6.K_i * rk6.V_L == pytest.approx(8.0, rel=0.05)


# --- the gain K_1 -----------------------------------------------------------------------------


def test_K_1_is_the_papers_1014(p):
    assert round(p.K_1) == 1014


@pytest.mark.parametrize(
    "changes",
    [{}, {"fit": "rk6"}, {"K_2": 400.0}, {"K_e": 7.0}, {"B_a": 300.0, "B_m": 0.01}, {"R_a": 2.0}],
)
def test_with_K_1_ten_volts_give_one_metre_per_second(changes):
    p = AxisParameters.paper_x_axis(**changes)
    assert _steady_velocity(p) == pytest.approx(1.0, rel=1e-10)  # condition about 1e5


def test_K_1_leaves_the_limits_out():
    """Only the middle branches count: tight limits do not change the rule."""
    free = AxisParameters.paper_x_axis()
    assert free.replace(V_L=0.01, V_M=0.01).K_1 == free.K_1


@pytest.mark.parametrize("name", ["H", "F_0", "v_s", "T_p", "T_z", "T_r", "L_a", "M", "J_m", "K_g"])
def test_K_1_does_not_depend_on_what_a_steady_state_does_not_see(p, name):
    assert p.replace(**{name: 2 * getattr(p, name)}).K_1 == p.K_1


def _steady_velocity(p):
    """Arm velocity at 10 V from the state equations: the gear pushes and nothing accelerates.

    Within the region the equations are affine. Unknown are y1, y2, y3, y4 and y6, with the arm at
    y0 = 0 and y5 = 0; the equations are those of y1, y3, y5 and y6, and that the gear keeps its
    wind-up.
    """
    A, B, c = affine(p, Region(preamplifier=0, power=0, contact=1, friction=0))
    unknown, rows = [1, 2, 3, 4, 6], [1, 3, 5, 6]
    matrix = np.vstack([A[np.ix_(rows, unknown)], [1, 0, -p.r_g, 0, 0]])
    right = -np.append((B * 10.0 + c)[rows], 0.0)
    size = np.abs(matrix).max(axis=1)
    return np.linalg.solve(matrix / size[:, None], right / size)[0]


# --- changing -----------------------------------------------------------------------------------


def test_changes_go_in_by_name():
    p = AxisParameters.paper_x_axis(T_p=0.06, K_e=50.0, F_0=0, v_s=0)
    assert (p.T_p, p.K_e, p.F_0, p.v_s) == (0.06, 50.0, 0.0, 0.0)


def test_replace_changes_one_value_and_keeps_the_rest(p):
    changed = p.replace(M=100.0)
    assert changed.M == 100.0
    assert p.M == 146.0
    assert changed.replace(M=146.0) == p


def test_replace_computes_K_1_again(p):
    assert p.replace(K_2=400.0) == AxisParameters.paper_x_axis(K_2=400.0)
    assert p.replace(K_2=400.0).K_1 < p.K_1


def test_a_given_K_1_stays_until_it_is_withdrawn(p):
    given = p.replace(K_1=1000.0)
    assert given.replace(K_2=400.0).K_1 == 1000.0
    assert given.replace(K_2=400.0, K_1=None) == p.replace(K_2=400.0)
    assert AxisParameters.paper_x_axis(K_1=5.0).replace(K_2=1.0).K_1 == 5.0


def test_K_1_has_no_other_default_than_the_rule():
    values = SHARED | FITTED["ndp"] | OURS
    assert AxisParameters(**values) == AxisParameters.paper_x_axis()
    with pytest.raises(TypeError, match="M"):
        AxisParameters(**{name: value for name, value in values.items() if name != "M"})


def test_is_frozen_and_can_be_a_key(p):
    with pytest.raises(dataclasses.FrozenInstanceError):
        p.M = 1.0
    assert {p: "x"}[AxisParameters.paper_x_axis()] == "x"


@pytest.mark.parametrize("given", [None, 1000.0])
def test_a_pickled_copy_is_equal_and_remembers_whether_K_1_was_given(p, given):
    p = p.replace(K_1=given)
    copy = pickle.loads(pickle.dumps(p))
    assert copy == p
    assert copy.replace(K_2=1.0) == p.replace(K_2=1.0)


# --- validation ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("t_p", "T_p"), ("B_A", "B_a"), ("Ke", "K_e"), ("v", "v_s"), ("K1", "K_1"), ("Tp", "T_p")],
)
def test_a_wrong_name_is_answered_with_the_right_one(p, wrong, right):
    for call in (AxisParameters.paper_x_axis, p.replace):
        with pytest.raises(ValueError, match=f"{wrong} = 3.5: no such.*did you mean {right}"):
            call(**{wrong: 3.5})


def test_a_name_unlike_any_other_is_answered_with_the_list(p):
    with pytest.raises(ValueError, match=r"zzzzzz = 1: no such parameter; allowed are R_a, L_a"):
        p.replace(zzzzzz=1)


def test_a_wrong_fit_is_answered_with_the_right_ones():
    with pytest.raises(ValueError, match=r"'rk5'.*'ndp' and 'rk6'"):
        AxisParameters.paper_x_axis(fit="rk5")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, -1e-300, 10**400])
def test_a_number_out_of_range_is_refused(p, name, value):
    with pytest.raises(ValueError, match=f"^{name} = .*(positive|not negative)"):
        p.replace(**{name: value})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [True, "1.0", 1j, [1.0], np.ones(1), np.True_])
def test_what_is_no_real_number_is_refused(p, name, value):
    with pytest.raises(TypeError, match=f"^{name} = .*{type(value).__name__}"):
        p.replace(**{name: value})


@pytest.mark.parametrize("name", [name for name in NAMES if name != "K_1"])
def test_none_is_refused_where_there_is_no_rule(p, name):
    with pytest.raises(TypeError, match=f"^{name} = None"):
        p.replace(**{name: None})


@pytest.mark.parametrize("name", NAMES)
def test_zero_is_allowed_just_where_nothing_divides_by_it(p, name):
    if name in MAY_BE_ZERO:
        assert getattr(p.replace(**{name: 0}), name) == 0.0
    else:
        with pytest.raises(ValueError, match=f"^{name} = 0 .*positive"):
            p.replace(**{name: 0})


@pytest.mark.parametrize("value", [2, np.float64(2), np.float32(2), np.int64(2), Fraction(2)])
def test_every_real_number_type_becomes_a_float(p, value):
    K_e = p.replace(K_e=value).K_e
    assert K_e == 2.0
    assert type(K_e) is float


# --- metadata -----------------------------------------------------------------------------------


@pytest.mark.parametrize("item", dataclasses.fields(AxisParameters), ids=lambda item: item.name)
def test_every_field_has_unit_description_and_source(item):
    for key in ("unit", "description", "source"):
        assert item.metadata[key].strip()


def test_just_the_values_the_paper_does_not_give_are_marked_as_ours():
    sources = {item.name: item.metadata["source"] for item in dataclasses.fields(AxisParameters)}
    assert {name for name, source in sources.items() if source == "our choice"} == set(OURS)
    assert {name for name, source in sources.items() if "Table 5" in source} == set(FITTED["ndp"])
    assert {name for name, source in sources.items() if "Table 3" in source} == {
        "R_a", "L_a", "K_b", "J_m", "B_m", "K_t", "r_g", "H", "M"
    }  # fmt: skip
    assert {name for name, source in sources.items() if "Table 4" in source} == {
        "T_z", "T_p", "T_r", "K_2", "K_i", "V_M"
    }  # fmt: skip


def test_units_agree_with_the_equations():
    """K_b y6 is a torque and K_b y3 a voltage, so in SI the two printed K_b are one number."""
    units = {item.name: item.metadata["unit"] for item in dataclasses.fields(AxisParameters)}
    assert units["K_b"].startswith("N m/A")
    assert {units[name] for name in ("V_M", "V_L")} == {"V"}
    assert {units[name] for name in ("T_z", "T_p", "T_r")} == {"s"}
    assert {units[name] for name in ("r_g", "H")} == {"m"}
    assert {units[name] for name in ("B_a", "b_g")} == {"N s/m"}
    assert {units[name] for name in ("K_1", "K_2", "K_e")} == {"V/V"}
    assert units["J_m"] == "kg m²"
