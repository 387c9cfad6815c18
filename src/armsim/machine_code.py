"""Machine code that is kept between processes, and never outlives what it was made of.

Numba keeps the code of a function on disk until the *file* of that function changes. It does not
look at what else it has compiled into it: a helper, a constant, a named tuple of another module.
Here code is kept until its *fingerprint* changes, a digest of the function's instructions and, all
the way down, of every function and value that they name. Where that cannot be known, nothing is
kept, and each process compiles the function again.
"""

import builtins
import dis
import gc
import hashlib
import logging
import os
import pickle
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import wraps
from importlib import metadata
from operator import attrgetter
from pathlib import Path
from types import CodeType, EllipsisType, FunctionType, ModuleType
from typing import Any
from uuid import uuid4

import numpy as np
from numba import config, njit, types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.serialize import dumps
from numba.extending import _Intrinsic, is_jitted
from numba.misc.appdirs import AppDirs

try:
    import fcntl
except ImportError:  # on Windows each process compiles for itself
    fcntl = None  # type: ignore[assignment]

#: Known by their versions: numba has implementations of its own for what is called there.
_LIBRARIES = {"builtins", "cmath", "math", "numba", "numpy", "scipy"}
_VERSIONS = [sys.version, *(metadata.version(name) for name in ("numba", "numpy", "scipy"))]
_PLAIN = bool | int | float | complex | str | bytes | None | EllipsisType | np.generic | np.dtype
_KNOWN = _PLAIN | types.Type | types.ExternalFunction
#: Types of arguments whose texts tell all about them.
_SIMPLE = (types.Number, types.Boolean, types.Array, types.BaseTuple, types.Omitted, types.NoneType)

# Switched off by NUMBA_DISABLE_JIT, numba could not compile what works as machine code only.
config.DISABLE_JIT = 0


class _Unknown(Exception):
    """What a function is made of cannot be known."""


def fingerprint(function: Callable) -> str | None:
    """Digest of all that the machine code of a function is made of, or None if it cannot be known.

    Parameters
    ----------
    function : callable
        A Python function, or one that numba compiles. Line numbers, comments and the docstring
        do not count.
    """
    # KeyError, ValueError: a global name, or a variable outside the function, has no value yet.
    with suppress(_Unknown, KeyError, ValueError):
        return _digest([*_VERSIONS, *_parts(function, {})])
    return None


def _digest(texts: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:32]


def _parts(value: Any, seen: dict[int, int]) -> Iterator[str]:
    """Texts that together describe a value that a function uses, each function once."""
    if is_jitted(value):
        yield from _parts(sorted(value.targetoptions.items()), seen)
        value = value.py_func
    if isinstance(value, _Intrinsic):
        value = value._defn
    if isinstance(value, _KNOWN):
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, tuple | list):
        yield f"{type(value).__name__} {getattr(value, '_fields', len(value))}"
        for item in value:
            yield from _parts(item, seen)
    elif isinstance(value, set | frozenset):
        yield repr(sorted(map(repr, value)))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif name := _defined_in(value, _LIBRARIES):  # not what is made with their classes
        yield name
    elif isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields"):
        yield f"{value.__qualname__} {value._fields}"
    elif isinstance(value, FunctionType):
        known = len(seen)
        yield f"function {seen.setdefault(id(value), known)}"
        if seen[id(value)] == known:
            cells = [cell.cell_contents for cell in value.__closure__ or ()]
            yield from _parts([value.__defaults__, cells], seen)
            yield from _code_parts(value.__code__, value, seen)
    else:
        raise _Unknown(value)


def _code_parts(code: CodeType, function: FunctionType, seen: dict[int, int]) -> Iterator[str]:
    yield code.co_code.hex() + code.co_exceptiontable.hex()
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
    steps, names = list(dis.get_instructions(code)), vars(builtins) | function.__globals__
    for n, step in enumerate(steps):
        if step.opname not in ("LOAD_GLOBAL", "LOAD_NAME"):
            continue
        value = names[step.argval]
        for following in steps[n + 1 :]:
            if not isinstance(value, ModuleType) or "LOAD_" not in following.opname:
                break
            value = getattr(value, str(following.argval), None)
        yield value


def _defined_in(value: Any, modules: Iterable[str]) -> str:
    """Full name of a value, or "" if none of these modules has it under its name."""
    module = "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", getattr(value, "__name__", None))
    if module is None or name is None or module.partition(".")[0] not in modules:
        return ""
    with suppress(AttributeError, KeyError):
        return f"{module}.{name}" if attrgetter(name)(sys.modules[module]) is value else ""
    return ""


# --- where it is kept -------------------------------------------------------------------------


class _Files(NullCache):
    """The kept code of one function: a file for each signature.

    The name of a file holds all that its code is made of, and a file appears whole or not at all.
    So processes that compile at the same time never find each other's code under a wrong name, as
    they can by numba's own index.
    """

    def __init__(self, dispatcher: Any, folder: Path) -> None:
        # Scripts share the module's name, generated functions share the module.
        function = dispatcher.py_func
        file, module = function.__code__.co_filename, function.__module__
        place = file if module == "__main__" or file.startswith("<") else ""
        name = function.__qualname__.replace("<", "").replace(">", "")
        self._folder, self._base = folder, f"{name}-{_digest([module, place])[:12]}"
        self._dispatcher = dispatcher

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        # ImportError: a script that runpy runs is no module. The others: a damaged file.
        with suppress(OSError, ImportError, EOFError, pickle.UnpicklingError, _Unknown):
            data = self._file(sig, target_context.codegen()).read_bytes()
            return CompileResult._rebuild(target_context, *pickle.loads(data))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.lifted or data.library.has_dynamic_globals:  # it holds addresses of this process
            return
        with suppress(OSError, _Unknown):
            file = self._file(sig, data.codegen)
            own = file.name.rsplit(".", 2)[0]  # with the stamp, without the types of arguments
            for old in set(self._folder.glob(f"{self._base}.*")):
                if not old.name.startswith(own):
                    old.unlink(missing_ok=True)
            new = file.with_suffix(f".{uuid4().hex}")
            new.write_bytes(dumps(data._reduce()))
            new.replace(file)

    def _file(self, sig: Any, codegen: Any) -> Path:
        # Not when the function is defined: what it calls may be defined, or changed, later.
        if (stamp := fingerprint(self._dispatcher)) is None:
            raise _Unknown(self._dispatcher)
        arguments = [part for kind in getattr(sig, "args", sig) for part in _type_parts(kind)]
        digest = _digest([*arguments, repr(codegen.magic_tuple())])
        return self._folder / f"{self._base}.{stamp[:20]}.{digest[:20]}.nbc"


def _type_parts(kind: types.Type) -> Iterator[str]:
    """Texts that together describe the type of an argument."""
    if not isinstance(kind, _SIMPLE):
        raise _Unknown(kind)
    yield str(kind)
    if isinstance(kind, types.BaseNamedTuple):
        if not (name := _defined_in(kind.instance_class, sys.modules.keys() - {"__main__"})):
            raise _Unknown(kind)  # another process would not take it for the same class
        yield f"{name} {kind.fields}"
    for item in kind.types if isinstance(kind, types.BaseTuple) else ():
        yield from _type_parts(item)


def _folder() -> Path | None:
    """Folder to keep code in: the first that can be written to, if there is one."""
    places = [Path(__file__).parent / "__pycache__", Path(AppDirs("armsim").user_cache_dir)]
    for folder in [Path(config.CACHE_DIR, "armsim"), *places] if config.CACHE_DIR else places:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    return None


def kept(**options: Any) -> Callable[[Callable], Callable]:
    """Make a decorator that compiles as `numba.njit` does and keeps the code if that is safe.

    Parameters
    ----------
    **options
        Of `numba.njit`.

    Returns
    -------
    callable
        Takes a function.
    """

    def compiled(function: Callable) -> Callable:
        dispatcher, folder = njit(**options)(function), _folder()
        if folder is not None:
            dispatcher._cache = _Files(dispatcher, folder)
        dispatcher.compile = _quickly(dispatcher.compile)
        return dispatcher

    return compiled


def _quickly(compile_: Callable) -> Callable:
    """Spare a quarter of the compiler's time, half of it by not collecting garbage.

    The other half is LLVM's third level of optimisation. It would make the states at given times
    a twelfth faster; the runs that we timed take as long without it. The lock keeps another thread
    from taking these settings for the user's.
    """

    @wraps(compile_)
    @global_compiler_lock
    def compiled(*arguments: Any) -> Any:
        collecting, optimised = gc.isenabled(), config.OPT
        gc.disable()
        config.OPT = min(optimised, type(optimised)(2))
        try:
            return compile_(*arguments)
        finally:
            config.OPT = optimised
            if collecting:
                gc.enable()

    return compiled


def generated(source: str, names: dict[str, Any], **options: Any) -> Callable:
    """Compile the one function that a source defines, and keep its code as `kept` does.

    Of the same source, only the newest code is kept for compiled functions of the same files and
    names. What is typed at a prompt or in a notebook is in no file.

    Parameters
    ----------
    source : str
        Python source of one function.
    names : dict
        Global names that the source uses.
    **options
        Of `numba.njit`.
    """
    codes = [value.py_func.__code__ for value in names.values() if is_jitted(value)]
    # A notebook's cell has the name of a file that no other process has.
    files = [code.co_filename * Path(code.co_filename).is_file() for code in codes]
    place = _digest([source, *files, *(code.co_qualname for code in codes)])[:16]
    namespace = names | {"__name__": __name__}
    exec(compile(source, f"<generated {place}>", "exec"), namespace)
    (name,) = set(namespace) - set(names) - {"__name__", "__builtins__"}
    return kept(**options)(namespace[name])


# --- while it is compiled ---------------------------------------------------------------------


@contextmanager
def announced(name: str, function: Callable) -> Iterator[None]:
    """Log a warning if the compilation in the block is not done, or read from disk, in two seconds.

    Without a handler of the application, logging writes warnings to standard error. If several
    processes come to compile `function`, the first one does, and the others read its code.
    """
    text = f"armsim: compiling {name}; this takes some ten seconds"
    timer = threading.Timer(2.0, logging.getLogger("armsim").warning, (text,))
    timer.start()
    try:
        with _turn(function):
            yield
    finally:
        timer.cancel()


@contextmanager
def _turn(function: Callable) -> Iterator[None]:
    """Wait for other processes that are in such a block for the same function, if it is kept."""
    stamp, folder = fingerprint(function), _folder()
    with ExitStack() as stack:
        with suppress(OSError):  # some file systems have no locks
            if fcntl and stamp and folder:
                file = folder / f"{stamp}.lock"
                handle = stack.enter_context(file.open("w"))
                stack.callback(file.unlink, missing_ok=True)
                fcntl.flock(handle, fcntl.LOCK_EX)
        yield
