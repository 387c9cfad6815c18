"""The paper's methods and the parts of the arm: one order, one key and one look for each."""

from typing import Any

from armsim.methods.tableaux import DP4, DP5, EULER, RK4_GILL, RK5, RK6
from reportkit.figures import INK, MARKERS, PALETTE

#: What a colour means wherever one of these appears.
COLOUR = dict(zip(("arm", "motor", "command", "gear", "limit"), PALETTE, strict=True))

#: The corrected methods, in the order of the report.
METHODS = (EULER, RK4_GILL, RK5, RK6, DP5, DP4)
#: By the name of a method: what stands for it in the name of a recorded value.
KEY = {method.name: method.name.split()[0].replace("-", "_") for method in METHODS}
#: By the name of a method: properties of its line.
LOOK: dict[str, dict[str, Any]] = {
    method.name: {"color": colour, "marker": marker, "linestyle": "-"}
    for method, colour, marker in zip(METHODS, (*PALETTE, INK), (*MARKERS, "P"), strict=True)
}
