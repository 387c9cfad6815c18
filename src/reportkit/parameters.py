"""The parameters of a notebook, read from its source without executing it.

In the cell tagged ``parameters`` each variable has a comment, on the lines above or at the end of
its line::

    T_p = 0.04  # s, time constant of the preamplifier; 0.001 to 10
    # s, step sizes; 2 or more values, each 1e-7 to 1e-3
    step_sizes = [1e-4, 5e-5]
    fit = "ndp"  # column of Table 5; ndp | rk6
    record = ""  # measured motion, empty for the published one; path

For a number the unit comes first (1 if it has none), then the meaning, then the allowed range:
``LOW to HIGH``, ``above LOW``, ``at least LOW`` or ``A | B``; for a list the same after ``each``,
with the number of values before it if that matters, and ``each half of the one before,`` if it
has to be. A bool needs only the help text. A default is a literal, or an entry of the report's
choices, such as ``CHOICES["move"]["velocity"]``.

What two parameters have to fulfil together stands on a line of its own, with ``<``, ``<=`` or
``!=`` between their names, and is checked before anything runs::

    # require: fine_step < coarse_step
"""

import ast
import difflib
import io
import json
import math
import operator
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tokenize import COMMENT, generate_tokens
from typing import Any

from reportkit.project import ProjectError
from reportkit.text import studies

_SYMBOLS = set("1 % s ms µs V A m mm µm km kg N J W mW Hz rad Ω H".split())
_LIST = re.compile(
    r"(?:(?P<count>\d+)(?P<more> or more)? values, )?"
    r"(?P<halved>each half of the one before, )?each (?P<range>.+)"
)
_REQUIRE = re.compile(r"^# require: *(.*)", re.MULTILINE)
_RELATIONS = {"<": operator.lt, "<=": operator.le, "!=": operator.ne}
_BOOLS = {"true": True, "yes": True, "false": False, "no": False}
_KINDS = {float: "a number", int: "an integer", bool: "true or false", str: "a text"}


class ParameterError(ProjectError):
    """A notebook or parameter is missing or invalid; the message is one line."""


@dataclass(frozen=True)
class Parameter:
    """One variable of the cell tagged ``parameters``, and its allowed values.

    `allowed` is the range as it stands in the comment; `kind` is the type of the value, or of
    each value where the default is a list.
    """

    name: str
    default: Any
    help: str
    unit: str | None
    allowed: str

    def __post_init__(self) -> None:
        numeric = not isinstance(self.default, str | bool)
        if numeric and not set(re.split("[ /]", (self.unit or "").rstrip("²³"))) <= _SYMBOLS:
            raise ParameterError(f"{self.name}: {self.unit!r} is not a unit; write 1 for none")
        if numeric and not self.allowed:
            raise ParameterError(f"{self.name}: the allowed range is missing")
        if not self.help:
            raise ParameterError(f"{self.name}: the help text is missing")
        self.check(self.default)

    @property
    def kind(self) -> type:
        """The type of the value, or of each value of a list."""
        kinds = {type(one) for one in self.default} if isinstance(self.default, list) else set()
        if isinstance(self.default, bool | str | int | float):
            return type(self.default)
        if kinds and kinds <= {int, float}:
            return float if float in kinds else int
        raise ParameterError(f"{self.name} = {self.default!r}: its type cannot be checked")

    @property
    def wanted(self) -> str:
        """The allowed values in words."""
        if self.allowed == "path":
            return "a file"
        one = _KINDS[self.kind]
        text = f"a list of {one.split()[1]}s" if isinstance(self.default, list) else one
        text += f", {self.allowed}" if self.allowed else ""
        return text + (f" ({self.unit})" if self.unit not in (None, "1") else "")

    def parse(self, text: str) -> Any:
        """Return the value that a text from the command line stands for.

        Raises
        ------
        ParameterError
            If the text is of another type, or its value is not allowed.
        """
        several = isinstance(self.default, list)
        inner = text.strip().removeprefix("[").removesuffix("]").rstrip(", ")
        try:
            value = [*map(self._read, inner.split(","))] if several else self._read(text)
        except (ValueError, KeyError):
            raise self._refusal(text) from None
        return self.check(value)

    def check(self, value: Any) -> Any:
        """Return a value as the notebook receives it: an integer as a float if need be.

        Raises
        ------
        ParameterError
            If the value is of another type, not finite or not allowed.
        """
        allowed = self.allowed
        if not isinstance(self.default, list):
            return self._checked(value, allowed, value)
        if not (match := _LIST.fullmatch(allowed)):
            raise ParameterError(f"{self.name}: {allowed!r} has no range for each value")
        least = int(match["count"] or 1)
        most = least if match["count"] and not match["more"] else math.inf
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise self._refusal(value)
        values = [self._checked(one, match["range"], value) for one in value]
        if len(set(values)) < len(values):
            raise ParameterError(f"{self.name} = {value}: each value only once")
        if match["halved"] and any(not math.isclose(a, 2 * b) for a, b in pairwise(values)):
            raise self._refusal(value)
        return values

    def _read(self, text: str) -> Any:
        return _BOOLS[text.strip().lower()] if self.kind is bool else self.kind(text)

    def _checked(self, value: Any, allowed: str, whole: Any) -> Any:
        if self.kind is float and type(value) is int and abs(value) < 1e300:
            value = float(value)
        if type(value) is not self.kind or (isinstance(value, float) and not math.isfinite(value)):
            raise self._refusal(whole)
        if allowed == "path":
            with suppress(OSError, ValueError):  # a name too long, or not UTF-8 as files need it
                path = str(Path(str(value)).resolve()) if value else ""
                if not path.encode() or Path(path).is_file():
                    return path
            odd = "its name is not UTF-8" if "\\udc" in repr(value) else "there is no such file"
            raise ParameterError(f"{self.name} = {value!r}: {odd}")
        if allowed and not self._fits(value, allowed):
            raise self._refusal(whole)
        return value

    def _fits(self, value: Any, allowed: str) -> bool:
        if "|" in allowed or self.kind is str:
            return str(value) in re.split(r"\s*\|\s*", allowed)
        with suppress(ValueError):
            match allowed.split():
                case ["above", low]:
                    return bool(value > float(low))
                case ["at", "least", low]:
                    return bool(value >= float(low))
                case [low, "to", high]:
                    return float(low) <= value <= float(high)
        raise ParameterError(f"{self.name}: {allowed!r} is not a range")

    def _refusal(self, value: Any) -> ParameterError:
        return ParameterError(f"{self.name} = {value!r}: expected {self.wanted}")


@dataclass(frozen=True)
class Notebook:
    """Description of a notebook, read from its source."""

    path: Path
    title: str
    summary: str
    parameters: Mapping[str, Parameter]
    conditions: Sequence[str] = ()

    def __post_init__(self) -> None:
        self.values((), {})

    @property
    def name(self) -> str:
        """The file name without its ending."""
        return self.path.stem

    @property
    def defaults(self) -> dict[str, Any]:
        """The published values."""
        return {name: item.default for name, item in self.parameters.items()}

    def values(self, texts: Iterable[tuple[str, str]], table: Mapping[str, Any]) -> dict[str, Any]:
        """Check parameters given as texts and as a table; the texts take precedence.

        Raises
        ------
        ParameterError
            If there is no such parameter, it is given twice, or its value is not allowed, alone
            or beside the others.
        """
        values: dict[str, Any] = {}
        for name, text in texts:
            if name in values:
                raise ParameterError(f"{name}: given twice")
            values[name] = self._parameter(name).parse(text)
        values = {name: self._parameter(name).check(v) for name, v in table.items()} | values
        whole = self.defaults | values
        for condition in self.conditions:
            try:
                one, relation, other = condition.split()
                holds = _RELATIONS[relation](whole[one], whole[other])
            except (LookupError, ValueError, TypeError):
                raise ParameterError(f"{condition!r} is not a condition") from None
            if not holds:
                given = ", ".join(f"{name} = {whole[name]!r}" for name in (one, other))
                raise ParameterError(f"{given}: expected {condition}")
        return values

    def _parameter(self, name: str) -> Parameter:
        if name not in self.parameters:
            hint = _nearest(name, self.parameters)
            raise ParameterError(f"{name}: not a parameter of {self.name}; {hint}")
        return self.parameters[name]


def read(path: Path, choices: Mapping[str, Any] | None = None) -> Notebook:
    """Read title, first sentence and parameters from the source of a notebook.

    Raises
    ------
    ParameterError
        If the file is not a notebook, or the comment of a parameter is missing or malformed.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        cells = [cell | {"source": "".join(cell["source"])} for cell in content["cells"]]
    except (OSError, ValueError, TypeError, LookupError) as error:
        raise ParameterError(f"{path} is not a notebook: {error!r}") from None
    text = next((cell["source"] for cell in cells if cell["cell_type"] == "markdown"), "")
    title, _, body = text.partition("\n")
    sentence = re.match(r"(?s).*?\.(?=\s+[A-Z]|\s*$)|.*", body.strip())
    summary = " ".join(sentence[0].split()).replace("$", "") if sentence else ""
    tagged = (cell for cell in cells if "parameters" in cell["metadata"].get("tags", ()))
    own = next(tagged, {"source": ""})["source"]
    try:
        conditions = _REQUIRE.findall(own)
        found = {item.name: item for item in _parameters(_REQUIRE.sub("", own), choices or {})}
        return Notebook(path, title.lstrip("# "), summary, found, conditions)
    except (SyntaxError, ValueError, LookupError) as error:
        raise ParameterError(f"{path}: {error}") from None


def find(name: str, folder: Path, choices: Mapping[str, Any] | None = None) -> Notebook:
    """Read the notebook with this name, or with this number or topic alone.

    Raises
    ------
    ParameterError
        If there is none; the message suggests the nearest name.
    """
    paths = {path.stem: path for path in sources(folder)}
    short = Path(name).name.removesuffix(".ipynb")
    fits = [stem for stem in paths if short in (stem, stem[:2], stem[3:])]
    if len(fits) != 1:
        raise ParameterError(f"{name}: no notebook in {folder}; {_nearest(short, paths)}")
    return read(paths[fits[0]], choices)


def sources(folder: Path) -> list[Path]:
    """List the notebooks of a folder.

    Raises
    ------
    ParameterError
        If there is none.
    """
    if not (paths := studies(folder, ".ipynb")):
        raise ParameterError(f"no notebooks in {folder}: they come with the repository, not with "
                             "the installed package")  # fmt: skip
    return paths


def _parameters(source: str, choices: Mapping[str, Any]) -> Iterable[Parameter]:
    # an import is that of the choices
    nodes = [node for node in ast.parse(source).body if not isinstance(node, ast.ImportFrom)]
    tokens = generate_tokens(io.StringIO(source).readline)
    comments = {t.start[0]: t.string.lstrip("#").strip() for t in tokens if t.type == COMMENT}
    last = 0
    for node in nodes:
        if not isinstance(node, ast.Assign) or not isinstance(node.targets[0], ast.Name):
            raise ParameterError(f"cell of parameters: {ast.unparse(node)} is not NAME = VALUE")
        begin, last = last, node.end_lineno or 0
        comment = " ".join(text for line, text in comments.items() if begin < line <= last)
        default = _default(node.value, choices)
        text, _, allowed = (part.strip() for part in comment.partition(";"))
        unit = None
        if not isinstance(default, str | bool):
            unit, _, text = (part.strip() for part in text.partition(","))
        yield Parameter(node.targets[0].id, default, text, unit, allowed)


def _default(node: ast.expr, choices: Mapping[str, Any]) -> Any:
    """Value of a literal, or of an entry of the choices."""
    if not isinstance(node, ast.Subscript):
        return choices if isinstance(node, ast.Name) else ast.literal_eval(node)
    return _default(node.value, choices)[ast.literal_eval(node.slice)]


def _nearest(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, known := list(known), n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else f"known are {', '.join(known) or 'none'}"
