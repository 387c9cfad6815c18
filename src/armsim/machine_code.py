"""Machine code that is kept between processes, and never outlives what it was made of.

Numba keeps the code of a function on disk until the *file* of that function changes. It does not
look at what else it has compiled into it: a helper, a constant, a named tuple of another module.
Here code is kept until its *fingerprint* changes, a digest of the function's instructions and, all
the way down, of every function and value that they name. Where that cannot be known, nothing is
kept, and each process compiles the function again.
"""

import builtins
import dis
import hashlib
import sys
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import config, njit, types
from numba.core.caching import _CacheLocator
from numba.extending import is_jitted
from numba.misc.appdirs import AppDirs

#: Packages known by their version: numba has implementations of its own for what is called there.
_LIBRARIES = {"builtins", "cmath", "math", "numba", "numpy", "scipy"}
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), np.generic, np.dtype)


class _Unknown(Exception):
    """What a function is made of cannot be told."""


def fingerprint(function: Callable) -> str | None:
    """Digest of all that the machine code of a function is made of, or None if it cannot be known.

    Parameters
    ----------
    function : callable
        A Python function, or one that numba compiles. Line numbers, comments and the docstring
        do not count.
    """
    digest = hashlib.sha256()
    try:
        for part in _parts(function, set()):
            digest.update(f"{part}\0".encode())
    except _Unknown:
        return None
    return digest.hexdigest()


def _parts(value: Any, seen: set[int]) -> Iterator[str]:
    """Texts that together tell a value that a function uses, each function once."""
    if is_jitted(value):
        yield from _parts(sorted(value.targetoptions.items()), seen)
        value = value.py_func
    if isinstance(value, _PLAIN):
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, tuple | list):
        yield f"{type(value).__name__} of {len(value)}"
        for item in value:
            yield from _parts(item, seen)
    elif isinstance(value, set | frozenset):
        yield repr(sorted(map(repr, value)))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, types.Type | types.ExternalFunction):
        yield repr(value)
    elif _library(value):
        yield f"{_name(value)} {_version(_name(value).partition('.')[0])}"
    elif isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields"):
        yield f"{_name(value)} {value._fields}"
    elif isinstance(value, FunctionType):
        if id(value) not in seen:
            seen.add(id(value))
            yield from _function_parts(value, seen)
    else:
        raise _Unknown(value)


def _function_parts(function: FunctionType, seen: set[int]) -> Iterator[str]:
    if function.__module__ not in sys.modules:  # of a script that runpy runs: not found again
        raise _Unknown(function)
    yield from _parts(function.__defaults__ or (), seen)
    cells = function.__closure__ or ()
    for cell in cells:
        yield from _parts(cell.cell_contents, seen)
    yield from _code_parts(function.__code__, function, seen)


def _code_parts(code: CodeType, function: FunctionType, seen: set[int]) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr((code.co_argcount, code.co_names, code.co_varnames, code.co_freevars))
    for constant in code.co_consts:
        if isinstance(constant, CodeType):  # a lambda or comprehension inside
            yield from _code_parts(constant, function, seen)
        elif constant != function.__doc__:
            yield from _parts(constant, seen)
    for value in _globals_used(code, function):
        yield from _parts(value, seen)


def _globals_used(code: CodeType, function: FunctionType) -> Iterator[Any]:
    """Values of the global names in a code, through modules: of ``np.linalg.eig`` the function."""
    steps = list(dis.get_instructions(code))
    for n, step in enumerate(steps):
        if step.opname not in ("LOAD_GLOBAL", "LOAD_NAME"):
            continue
        places = function.__globals__, vars(builtins)
        place = next((place for place in places if step.argval in place), None)
        if place is None:
            raise _Unknown(step.argval)
        value = place[step.argval]
        for following in steps[n + 1 :]:
            if not isinstance(value, ModuleType) or "LOAD_" not in following.opname:
                break
            value = getattr(value, str(following.argval), None)
        yield value


def _name(value: Any) -> str:
    module = getattr(value, "__module__", None) or "builtins"
    return f"{module}.{getattr(value, '__qualname__', getattr(value, '__name__', value))}"


def _library(value: Any) -> bool:
    return callable(value) and _name(value).partition(".")[0] in _LIBRARIES


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return sys.version


# --- where it is kept -------------------------------------------------------------------------


class _Locator(_CacheLocator):
    """Tells numba where the code of a function is kept, and what makes it stale."""

    def __init__(self, function: FunctionType, stamp: str, folder: Path) -> None:
        self._stamp, self._folder = stamp, folder
        # Scripts share the module's name, generated functions share the module.
        file, module = function.__code__.co_filename, function.__module__
        place = f"{module} {file if module == '__main__' or file.startswith('<') else ''}"
        self._place = hashlib.sha256(place.encode()).hexdigest()[:12]

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return self._place

    @classmethod
    def from_function(cls, function: FunctionType, file: str) -> "_Locator | None":
        stamp = fingerprint(function)
        if stamp is None:
            return None
        for folder in _folders():
            self = cls(function, stamp, folder)
            try:
                self.ensure_cache_path()
            except OSError:
                continue
            return self
        return None


def _folders() -> Iterator[Path]:
    """Folders to keep code in; the first that can be written to is taken."""
    if config.CACHE_DIR:
        yield Path(config.CACHE_DIR, "armsim")
    yield Path(__file__).parent / "__pycache__"
    yield Path(AppDirs("armsim", appauthor=False).user_cache_dir)


def kept(**options: Any) -> Callable[[Callable], Callable]:
    """Make a decorator that compiles as `numba.njit` does and keeps the code if that is safe.

    Parameters
    ----------
    **options
        Of `numba.njit`.

    Returns
    -------
    callable
        Takes a function; what this calls must be defined already.
    """

    def compiled(function: Callable) -> Callable:
        before = config.CACHE_LOCATOR_CLASSES
        config.CACHE_LOCATOR_CLASSES = f"{__name__}._Locator"
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:  # no fingerprint, or no folder that can be written to
            return njit(**options)(function)
        finally:
            config.CACHE_LOCATOR_CLASSES = before

    return compiled


def generated(source: str, label: str, names: dict[str, Any], **options: Any) -> Callable:
    """Compile the one function that a source defines, and keep its code as `kept` does.

    Parameters
    ----------
    source : str
        Python source of one function.
    label : str
        What the function is made for: of the same label, only the newest code is kept.
    names : dict
        Global names that the source uses.
    **options
        Of `numba.njit`.
    """
    place = hashlib.sha256(f"{source}{label}".encode()).hexdigest()[:16]
    namespace = names | {"__name__": __name__}
    exec(compile(source, f"<generated {place}>", "exec"), namespace)
    (name,) = set(namespace) - set(names) - {"__name__", "__builtins__"}
    return kept(**options)(namespace[name])


def label(function: Any) -> str:
    """Where a compiled function is from: its file and its name."""
    code = function.py_func.__code__
    return f"{code.co_filename} {function.py_func.__qualname__}"
