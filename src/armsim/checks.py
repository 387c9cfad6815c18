"""Argument checks whose messages name the argument, and the error for failed integrations."""

import difflib
from collections.abc import Iterable
from contextlib import suppress
from math import inf, isfinite
from numbers import Integral, Real
from textwrap import shorten

import numpy as np

#: Types that convert to float, or count as integers, but are no real numbers. (Other objects are:
#: fractions, for example.)
_ODD = (bool, np.bool_, str, bytes, type(None), np.complexfloating, np.datetime64, np.timedelta64)


class IntegrationError(ArithmeticError):
    """Failure of an integration before its end."""


def checked_number(name: str, value: object, *, above: float = -inf, zero: bool = False) -> float:
    """Return a finite real number as a float, or raise an error.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : object
        The value; bools and strings are rejected.
    above : float
        0.0 if the value must be positive.
    zero : bool
        Whether zero is allowed as well.

    Raises
    ------
    TypeError, ValueError
        If the value has the wrong type or is out of range; the message says what is allowed.
    """
    if isinstance(value, _ODD) or not isinstance(value, Real):
        raise TypeError(f"{name} = {value!r} is a {type(value).__name__}; a real number is needed")
    try:
        number = float(value)
    except OverflowError:  # a huge integer
        number = inf
    if not isfinite(number) or number < above or (number == above and not zero):
        allowed = "" if above == -inf else " and not negative" if zero else " and positive"
        raise ValueError(f"{name} = {value!r} is not allowed; it must be finite{allowed}")
    return number


def checked_count(name: str, value: object, least: int = 1) -> int:
    """Return an integer that is at least `least`, or raise an error.

    Raises
    ------
    TypeError, ValueError
        If the value is not such an integer; the message says what is allowed.
    """
    if isinstance(value, _ODD) or not isinstance(value, Integral):
        raise TypeError(f"{name} = {value!r} is a {type(value).__name__}; an integer is needed")
    if value < least:
        raise ValueError(f"{name} = {value!r} is not allowed; it must be at least {least}")
    return int(value)


def checked_type(name: str, value: object, kind: type, example: str = "") -> None:
    """Raise a TypeError if a value is not of a type."""
    if not isinstance(value, kind):
        such = f", such as {example}" if example else ""
        raise TypeError(f"{name} = {value!r}: a {kind.__name__} is needed{such}")


def reals(name: str, value: object) -> np.ndarray:
    """Return real numbers as a new array of floats of the same shape, or raise an error.

    Raises
    ------
    ValueError
        If the value contains text, dates, complex numbers, masked or missing values, or rows of
        different lengths.
    """
    with suppress(TypeError, ValueError, OverflowError):
        given = np.asarray(value)
        odd = given.dtype == object and any(isinstance(one, _ODD) for one in given.flat)
        if given.dtype.kind in "iufO" and not odd and not np.ma.is_masked(value):
            return np.array(given, dtype=float)
    raise ValueError(f"{name} = {shorten(repr(value), 100)}: real numbers are needed")


def checked_row(name: str, value: object, size: int = 0) -> np.ndarray:
    """Return a row (n,) of finite numbers as a new array, or raise an error.

    Raises
    ------
    ValueError
        If the value is no such row, or has not `size` numbers where that is given.
    """
    row = reals(name, value)
    if row.ndim != 1 or row.size != (size or row.size or 1) or not np.isfinite(row).all():
        needed = f"one row of {size or 'one or more'} finite numbers is needed"
        raise ValueError(f"{name} = {shorten(repr(value), 100)}: {needed}")
    return row


def checked_times(t: object, start: float, end: float, name: str = "t") -> np.ndarray:
    """Return a time or times as a row (n,), if all lie within a run from `start` to `end`.

    Raises
    ------
    ValueError
        If one does not, or the times are neither a number nor a row.
    """
    times, (low, high) = np.atleast_1d(reals(name, t)), sorted((start, end))
    if times.ndim > 1:
        raise ValueError(f"{name} has shape {times.shape}; a number or one row is needed")
    outside = times[~((times >= low) & (times <= high))]
    if outside.size:
        raise ValueError(f"{name} = {outside[0]} is outside the run; allowed is {low} to {high}")
    return times


def hint(name: object, known: Iterable[str]) -> str:
    """Suggest the most similar known name for an unknown one, and list all known names."""
    by_case = {item.lower(): item for item in known}
    near = difflib.get_close_matches(str(name).lower(), by_case, n=1, cutoff=0.5)
    mean = f"did you mean {by_case[near[0]]}? " if near else ""
    return f"{mean}allowed are {', '.join(by_case.values())}"
