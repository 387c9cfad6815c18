"""The paper's methods and the parts of the arm: one order, one key and one look for each."""

from typing import Any

from armsim.methods import tableaux
from reportkit.figures import INK, MARKERS, PALETTE

#: What a colour means wherever one of these appears.
COLOUR = dict(zip(("arm", "motor", "command", "gear", "limit"), PALETTE, strict=True))

#: The corrected methods, in the order of the report.
METHODS = (
    tableaux.EULER,
    tableaux.RK4_GILL,
    tableaux.RK5,
    tableaux.RK6,
    tableaux.DP5,
    tableaux.DP4,
)
#: By the name of a method: what stands for it in the name of a recorded value.
KEY = {method.name: method.name.split()[0].replace("-", "_") for method in METHODS}
#: By the name of a method: properties of its line.
LOOK: dict[str, dict[str, Any]] = {
    method.name: {"color": colour, "marker": marker, "linestyle": "-"}
    for method, colour, marker in zip(METHODS, (*PALETTE, INK), (*MARKERS, "P"), strict=True)
}
