"""Parameters of one axis: symbols, values, units and sources."""

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Self

from armsim.checks import checked_number, hint
from armsim.choices import CHOICES
from armsim.paper import TABLES, printed_value

#: Source of a value that the paper does not give.
OUR_CHOICE = "our choice"
_FROM_OTHERS = "Section 4: computed from the other parameters"

_SET_VELOCITY = 10.0  # V; the paper sets K_1 so that this voltage gives _VELOCITY
_VELOCITY = 1.0  # m/s


def _parameter(unit: str, description: str, source: str, zero: bool = False, **more: Any) -> Any:
    """Field of a parameter that must be positive, or nonnegative if `zero` is true."""
    metadata = {"unit": unit, "description": description, "source": source, "zero": zero}
    return field(metadata=metadata, **more)


@dataclass(frozen=True, kw_only=True)
class AxisParameters:
    """Constants of one axis of the robot arm, in SI units, named as in the paper.

    Create one with `paper_x_axis` and change it with `replace`. The metadata of each field hold
    its unit, description and source.

    Parameters
    ----------
    K_1 : float, optional
        Set-velocity gain. By default it follows the paper's rule: 10 V at the input gives 1 m/s
        in the steady state of the seven-state model. Viscous friction and finite `K_e` are
        included; static friction vanishes at that speed.
    **others : float
        All other parameters are required.

    Raises
    ------
    TypeError
        If a value is not a real number (bools and strings are not).
    ValueError
        If a value is not finite or has the wrong sign.
    """

    R_a: float = _parameter("Ω", "armature resistance", "Table 3")
    L_a: float = _parameter("H", "armature inductance", "Table 3 (printed L)")
    K_b: float = _parameter("N m/A", "motor torque constant; also V s/rad", "Table 3")
    J_m: float = _parameter("kg m²", "armature inertia, no load", "Table 3")
    B_m: float = _parameter("N m s/rad", "armature damping", "Table 3", zero=True)
    K_t: float = _parameter("V s/rad", "tachometer gain", "Table 3")
    r_g: float = _parameter("m", "motor gear radius", "Table 3")
    H: float = _parameter("m", "gear backlash, half the gap", "Table 3", zero=True)
    M: float = _parameter("kg", "arm mass", "Table 3")
    T_z: float = _parameter("s", "compensation zero time constant", "Table 4", zero=True)
    T_p: float = _parameter("s", "compensation pole time constant", "Table 4; Section 4")
    T_r: float = _parameter("s", "preamplifier roll-off time constant", "Table 4")
    K_2: float = _parameter("V/V", "tachometer feedback gain", "Table 4; Section 4", zero=True)
    K_i: float = _parameter("A/V", "transconductance gain", "Table 4")
    K_e: float = _parameter("V/V", "forward gain of the power unit", OUR_CHOICE)
    V_M: float = _parameter("V", "motor voltage limit", "Table 4")
    V_L: float = _parameter("V", "controller preamplifier limit", "Table 5")
    B_a: float = _parameter("N s/m", "arm friction coefficient", "Table 5", zero=True)
    b_g: float = _parameter("N s/m", "gear friction coefficient", "Table 5", zero=True)
    K_g: float = _parameter("N/m", "gear stiffness", "Table 5")
    F_0: float = _parameter("N", "static friction", OUR_CHOICE, zero=True)
    v_s: float = _parameter("m/s", "static friction threshold (paper's v)", OUR_CHOICE, zero=True)
    K_1: float = _parameter("V/V", "set-velocity gain", _FROM_OTHERS, zero=True, default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_given_K_1", self.K_1)
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if item.name == "K_1" and value is None:
                value = _gain_for_set_velocity(self)
            value = checked_number(item.name, value, above=0.0, zero=item.metadata["zero"])
            if not 1e-30 <= (value or 1.0) <= 1e30:  # so that products of several stay finite
                raise ValueError(f"{item.name} = {value!r}: it must lie between 1e-30 and 1e30")
            object.__setattr__(self, item.name, value)

    @classmethod
    def paper_x_axis(cls, *, fit: str = "ndp", **changes: float) -> Self:
        """Build the x axis of the paper: Tables 3 to 5, T_p = 0.04 s, K_2 at its maximum.

        Parameters
        ----------
        fit : {"ndp", "rk6"}
            Column of Table 5: "Novel Dormand-Prince Technique" or "RK-Sixth Order Technique".
        **changes : float
            Values that replace the paper's, by name.

        Raises
        ------
        ValueError
            If `fit` or a name is unknown, or a value is out of range.
        TypeError
            If a value is not a real number.
        """
        if fit not in ("ndp", "rk6"):
            raise ValueError(f"fit {fit!r}: not a column of Table 5; allowed are 'ndp' and 'rk6'")
        _check_names(cls, changes)
        values = {
            row["field"]: printed_value(row.get(fit) or row["value"])
            for row in (*TABLES["table3"], *TABLES["table4"], *TABLES["table5"])
            if row.get("field") not in (None, "K_1")
        }
        return cls(**(values | {"T_p": 0.04} | CHOICES["axis"]["x"] | changes))

    def replace(self, **changes: float | None) -> Self:
        """Return a changed copy; `K_1` is recomputed by its rule unless it was given.

        Parameters
        ----------
        **changes : float
            New values by name. ``K_1=None`` restores the computed gain.

        Raises
        ------
        ValueError, TypeError
            As on construction, or if a name is not a parameter.
        """
        _check_names(type(self), changes)
        gain = {"K_1": self._given_K_1}  # type: ignore[attr-defined]
        return dataclasses.replace(self, **(gain | changes))


def _gain_for_set_velocity(p: AxisParameters) -> float:
    """Gain K_1 for which 10 V gives exactly 1 m/s in the steady state of eq. (10)-(14)."""
    motor_velocity = _VELOCITY / p.r_g
    current = (p.B_m * motor_velocity + p.r_g * p.B_a * _VELOCITY) / p.K_b
    motor_voltage = p.R_a * current + p.K_b * motor_velocity
    preamplifier_output = current / p.K_i + motor_voltage / p.K_e
    return (preamplifier_output + p.K_2 * p.K_t * motor_velocity) / _SET_VELOCITY


def _check_names(cls: type, changes: dict[str, Any]) -> None:
    known = [item.name for item in dataclasses.fields(cls)]
    for name, value in changes.items():
        if name not in known:
            raise ValueError(f"{name} = {value!r}: no such parameter; {hint(name, known)}")
