"""Arguments that are refused, in words that name them; and runs that cannot be continued."""

import difflib
import math
from collections.abc import Iterable
from numbers import Integral, Real


class IntegrationError(ArithmeticError):
    """The solution could not be continued."""


def checked_number(
    name: str, value: object, *, above: float = -math.inf, zero: bool = False
) -> float:
    """Return a value as float if it is a finite real number.

    Parameters
    ----------
    name : str
        What the value is, for the message.
    value : object
        The value; a bool and a string are no numbers.
    above : float
        0.0 if it has to be positive.
    zero : bool
        Whether zero is allowed as well.

    Raises
    ------
    TypeError, ValueError
        If the value is not as above; the message says what is allowed.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"{name} = {value!r} is a {type(value).__name__}; a real number is needed")
    try:
        number = float(value)
    except OverflowError:  # a huge integer
        number = math.inf
    if not math.isfinite(number) or number < above or (number == above and not zero):
        allowed = "" if above == -math.inf else " and not negative" if zero else " and positive"
        raise ValueError(f"{name} = {value!r} is not allowed; it must be finite{allowed}")
    return number


def checked_count(name: str, value: object, least: int = 1) -> int:
    """Return a value if it is an integer of at least `least`.

    Raises
    ------
    TypeError, ValueError
        If it is not; the message says what is allowed.
    """
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name} = {value!r} is a {type(value).__name__}; an integer is needed")
    if value < least:
        raise ValueError(f"{name} = {value!r} is not allowed; it must be at least {least}")
    return int(value)


def hint(name: object, known: Iterable[str]) -> str:
    """Tell what was probably meant by a name that is not known, and what is."""
    by_case = {item.lower(): item for item in known}
    near = difflib.get_close_matches(str(name).lower(), by_case, n=1, cutoff=0.5)
    mean = f"did you mean {by_case[near[0]]}? " if near else ""
    return f"{mean}allowed are {', '.join(by_case.values())}"
