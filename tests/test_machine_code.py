"""Machine code kept on disk: when it is taken again, and when it must not be."""

import gc
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
import threading
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import numba
import pytest
from numba.core.registry import CPUDispatcher
from numba.extending import is_jitted

import armbook
import armsim
from armsim import machine_code
from armsim.machine_code import announced, fingerprint, kept

SRC = Path(__file__).parents[1] / "src"


# --- fingerprints: what a function is made of -----------------------------------------------------

SOURCE = """
import numpy as np
from numba import njit
from typing import NamedTuple

RATE = 1.0
TABLE = np.array([1.0, 2.0])
CHOICES = (1, 2)

class Axis(NamedTuple):
    mass: float
    drag: float

AXIS = Axis(1.0, 2.0)

@njit(fastmath=False)
def helper(x):
    return x + 1.0

def other(x):
    return x - 1.0

alias = other

def make(factor):
    def inner(x):
        return factor * x
    return inner

inner = make(3.0)

def function(t, y, scale=1.0):
    axis = Axis(1.0, 2.0)
    return scale * helper(RATE) + other(t) + alias(t) + inner(y) + TABLE[0] + len(CHOICES) \\
        + axis.mass + AXIS.drag + np.sin(2.0)
"""


def stamp(old="", new=""):
    """Fingerprint of `function` in the source after a change."""
    assert old in SOURCE
    namespace = {"__name__": "changing"}
    exec(compile(SOURCE.replace(old, new, 1), "changing.py", "exec"), namespace)
    return fingerprint(namespace["function"])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("x + 1.0", "x + 2.0"),  # a helper's body
        ("x - 1.0", "x * 1.0"),
        ("RATE = 1.0", "RATE = 1.01"),
        ("RATE = 1.0", "RATE = 1"),
        ("TABLE = np.array([1.0", "TABLE = np.array([-1.0"),
        ("CHOICES = (1, 2)", "CHOICES = (1, 2, 3)"),
        ("mass: float\n    drag: float", "drag: float\n    mass: float"),
        ("AXIS = Axis(1.0, 2.0)", "AXIS = Axis(1.0, 2.5)"),
        ("fastmath=False", "fastmath=True"),
        ("alias = other", "alias = helper"),
        ("make(3.0)", "make(4.0)"),  # a value of the function around it
        ("scale=1.0", "scale=2.0"),
        ("np.sin", "np.cos"),
        ("np.sin(2.0)", "np.sin(3.0)"),
    ],
)
def test_a_change_of_anything_that_is_compiled_changes_the_fingerprint(old, new):
    assert None not in (stamp(), stamp(old, new))
    assert stamp(old, new) != stamp()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("RATE = 1.0", "\n\n# Faster.\nRATE = 1.0"),
        ("    axis = Axis", '    """Add things."""\n    axis = Axis'),
        ("def other(x):", 'def other(x):\n    """One less."""\n    # because\n'),
        ("RATE = 1.0", "RATE = 1.0\nUNUSED = 7"),
    ],
)
def test_comments_docstrings_lines_and_what_is_not_used_do_not_count(old, new):
    assert stamp(old, new) == stamp() is not None


def test_a_field_of_a_named_tuple_by_another_name_is_noticed():
    """`POINT.x` is another number when the fields change places."""

    def read(names, values):
        fields = "".join(f"\n    {name}: float" for name in names)
        source = (
            f"from typing import NamedTuple\nclass P(NamedTuple):{fields}\n"
            f"POINT = P{values}\ndef function():\n    return POINT.x"
        )
        namespace = {"__name__": "points"}
        exec(source, namespace)
        return fingerprint(namespace["function"])

    assert read("xy", (1.0, 2.0)) != read("yx", (1.0, 2.0))


class Machine:
    """Nothing that a fingerprint knows."""

    ratio = 2.0


MACHINE = Machine()


@numba.vectorize
def ufunc(x):
    return x + 1


@pytest.mark.parametrize(
    "source",
    ["MACHINE", "Machine.ratio", "ufunc(t)", "not_defined_yet"],
)
def test_what_cannot_be_known_gives_none(source):
    assert fingerprint(eval(f"lambda t: {source}", globals())) is None
    assert fingerprint(eval(f"lambda t: {source}", dict(globals()) | {"__name__": "math"})) is None


def test_a_variable_without_a_value_gives_none():
    def outer():
        def inner(t):
            return later + t

        found = fingerprint(inner)
        later = 1.0
        return found, fingerprint(inner), later

    assert outer()[0] is None
    assert outer()[1] is not None


def test_functions_that_call_each_other_have_a_fingerprint():
    namespace = {"__name__": "circle"}
    exec("def f(x):\n    return g(x)\ndef g(x):\n    return f(x)", namespace)
    assert fingerprint(namespace["f"]) is not None


def kept_functions():
    for package in (armsim, armbook):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            module = importlib.import_module(found.name)
            for name, value in vars(module).items():
                if is_jitted(value) and value.__module__ == module.__name__:
                    yield pytest.param(value, id=f"{module.__name__}.{name}")


@pytest.mark.parametrize("function", list(kept_functions()))
def test_every_compiled_function_of_the_package_has_a_fingerprint(function):
    assert fingerprint(function) is not None


# --- files ----------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(machine_code.config, "CACHE_DIR", str(tmp_path))
    return tmp_path / "armsim"


class Pair(NamedTuple):
    a: float
    b: float


def first(pair):
    return pair.a


def hits(function):
    return sum(function.stats.cache_hits.values()), sum(function.stats.cache_misses.values())


def test_each_signature_has_its_own_file_and_code_is_taken_from_it(folder):
    def double(x):
        return 2 * x

    def use():
        function = kept()(double)
        assert (function(2), function(0.25)) == (4, 0.5)
        return hits(function)

    assert use() == (0, 2)
    assert len(list(folder.iterdir())) == 2
    assert use() == (2, 0)


def test_of_two_that_compile_the_same_the_second_waits_and_reads_the_code(folder):
    def double(x):
        return 2 * x

    one, other = kept()(double), kept()(double)
    there = threading.Event()

    def second():
        there.set()
        with announced("the other", other):
            assert other(2) == 4

    thread = threading.Thread(target=second)
    with announced("one", one):
        thread.start()
        there.wait()
        assert one(2) == 4
    thread.join()
    assert (hits(one), hits(other)) == ((0, 1), (1, 0))
    assert [file.suffix for file in folder.iterdir()] == [".nbc"]


def test_new_code_takes_the_place_of_old(folder):
    def function(rate):
        def decay(x):
            return rate * x

        return kept()(decay)

    assert function(2.0)(1.0) == 2.0
    (old,) = folder.iterdir()
    assert function(3.0)(1.0) == 3.0
    (new,) = folder.iterdir()
    assert old != new


def test_a_process_that_compiles_another_signature_at_the_same_time_does_no_harm(folder):
    """Both start with an empty folder; each finishes after the other has looked."""

    def double(x):
        return 2 * x

    here, there = kept()(double), kept()(double)
    here.compile((numba.float64,))
    there.compile((numba.int64,))
    third = kept()(double)
    assert (third(2), third(0.25)) == (4, 0.5)
    assert hits(third) == (2, 0)


def test_a_named_tuple_whose_fields_changed_places_is_compiled_anew(folder, monkeypatch):
    """The fields of an argument stand in its type; the function does not name them all."""
    assert kept()(first)(Pair(1.0, 2.0)) == 1.0

    class Swapped(NamedTuple):
        b: float
        a: float

    Swapped.__name__ = Swapped.__qualname__ = "Pair"
    monkeypatch.setitem(globals(), "Pair", Swapped)
    again = kept()(first)
    assert again(Swapped(1.0, 2.0)) == 2.0
    assert hits(again) == (0, 1)


def test_an_argument_that_is_a_function_is_not_kept(folder):
    @numba.njit
    def twice(x):
        return 2 * x

    def call(function, x):
        return function(x)

    assert kept()(call)(twice, 1.0) == 2.0
    assert not list(folder.iterdir())


def test_what_cannot_be_known_is_compiled_and_not_kept(folder):
    def grow(x):
        return ufunc(x)

    assert kept()(grow)(1.0) == 2.0
    assert not list(folder.iterdir())


def test_a_folder_that_cannot_be_written_to_is_passed_over(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setattr(machine_code.config, "CACHE_DIR", str(file))
    assert machine_code._folder() == Path(machine_code.__file__).parent / "__pycache__"


# --- from one process to the next -----------------------------------------------------------------

PROBLEM = """
import numpy as np
from numba import njit
import other

@njit
def rhs(t, y):
    return (other.slope(y[0]),)
"""
OTHER = """
from numba import njit

K = {constant}

@njit
def slope(y):
    return -{factor} * K * y
"""
SCRIPT = """
import problem
from armsim.methods import integrate, loops, tableaux

y = integrate(problem.rhs, (0, 1), [1.0], tableaux.RK6, 0.1).y[0, -1]
stats = loops.compiled_loop(problem.rhs, tableaux.RK6, 1, "additive", False).stats
print(f"{y:.5f} {sum(stats.cache_hits.values())} {sum(stats.cache_misses.values())}")
"""


def run(code, *places, **more):
    paths = os.pathsep.join(map(str, places))
    environment = os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"} | more
    found = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    return found.stdout.split()


def test_a_helper_or_constant_of_another_module_changes_the_next_process(tmp_path):
    (tmp_path / "problem.py").write_text(PROBLEM, encoding="utf-8")

    def result(constant, factor):
        text = OTHER.format(constant=constant, factor=factor)
        (tmp_path / "other.py").write_text(text, encoding="utf-8")
        return run(SCRIPT, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))

    assert result("1.0", "1.0") == ["0.36788", "0", "1"]
    assert result("1.0", "1.0") == ["0.36788", "1", "0"]  # read, not compiled
    assert result("2.0", "1.0") == ["0.13534", "0", "1"]
    assert result("1.0", "2.0") == ["0.13534", "0", "1"]


FLOW = """
from armbook.problems import region_flow
from armsim.arm import AxisParameters
from armsim.arm.dynamics import Region, constants, region_number

p = AxisParameters.paper_x_axis()
where = region_number(Region(0, 0, 1, 1))
y = (0.0, 0.1, 2 * p.H / p.r_g, 1.0, 0.0, 0.0, 0.0)
print(repr(region_flow(0.0, y, 10.0, where, constants(p))[1]))
print(sum(region_flow.stats.cache_hits.values()))
"""


def test_a_change_of_the_gear_force_reaches_the_problems_without_make(tmp_path):
    """`region_flow` calls `derivative`, which calls `gear_force` of the same module."""
    copy = tmp_path / "src"
    shutil.copytree(SRC, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "data").symlink_to(SRC.parent / "data")
    folder = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    before, _ = run(FLOW, copy, **folder)
    assert run(FLOW, copy, **folder) == [before, "1"]
    dynamics = copy / "armsim" / "arm" / "dynamics.py"
    text = dynamics.read_text(encoding="utf-8")
    assert text.count(" * c.K_g +") == 1
    dynamics.write_text(text.replace(" * c.K_g +", " * 1.01 * c.K_g +"), encoding="utf-8")
    after, hits_of_it = run(FLOW, copy, **folder)
    assert hits_of_it == "0"
    assert float(after) != float(before)


NO_MODULE = """
from numba import njit
from armsim.methods import integrate, tableaux

@njit
def rhs(t, y):
    return (-y[0],)

print(f"{integrate(rhs, (0, 1), [1.0], tableaux.RK6, 0.1).y[0, -1]:.5f}")
"""


def test_code_of_a_script_that_is_no_module_is_compiled_again(tmp_path):
    (tmp_path / "script.py").write_text(NO_MODULE, encoding="utf-8")
    code = f"import runpy; runpy.run_path({str(tmp_path / 'script.py')!r})"
    for _ in range(2):
        assert run(code, NUMBA_CACHE_DIR=str(tmp_path / "cache")) == ["0.36788"]


def test_options_of_the_function_itself_name_other_code(tmp_path, monkeypatch):
    """The same function with other options finds no code of the first, and the first finds its."""
    monkeypatch.setattr(machine_code.config, "CACHE_DIR", str(tmp_path))

    def twice(x):
        return 2.0 * x + 1.0

    def loads(**options):
        compiled = kept(**options)(twice)
        assert compiled(1.0) == 3.0
        return sum(compiled.stats.cache_hits.values())

    assert [loads(fastmath=False), loads(fastmath=False), loads(fastmath=True)] == [0, 1, 0]


@pytest.mark.parametrize("damage", [b"", b"no machine code"])
def test_a_damaged_file_is_compiled_again(tmp_path, monkeypatch, damage):
    monkeypatch.setattr(machine_code.config, "CACHE_DIR", str(tmp_path))

    def half(x):
        return 0.5 * x

    assert kept()(half)(3.0) == 1.5
    (file,) = tmp_path.rglob("*.nbc")
    file.write_bytes(damage)
    again = kept()(half)
    assert again(3.0) == 1.5 and not again.stats.cache_hits
    assert file.read_bytes() != damage


@pytest.mark.parametrize("fails", [False, True])
def test_a_compilation_leaves_the_settings_of_others_as_they_were(folder, monkeypatch, fails):
    config, seen = machine_code.config, []
    compile_ = CPUDispatcher.compile

    def watched(dispatcher, signature):
        seen.append((gc.isenabled(), int(config.OPT)))
        return compile_(dispatcher, signature)

    monkeypatch.setattr(CPUDispatcher, "compile", watched)
    before = gc.isenabled(), config.OPT
    function = kept()((lambda x: x + None) if fails else (lambda x: x + 1))
    with pytest.raises(numba.TypingError) if fails else nullcontext():
        assert function(2) == 3
    assert seen == [(False, 2)]
    assert (gc.isenabled(), config.OPT) == before


def test_threads_that_compile_at_a_time_leave_the_settings_as_they_were(folder, monkeypatch):
    """The second thread comes while the first compiles, and ends after it."""
    config, before, compile_ = machine_code.config, machine_code.config.OPT, CPUDispatcher.compile
    entered, ended = threading.Event(), threading.Event()

    def watched(dispatcher, signature):
        if dispatcher is one:
            second.start()
            entered.wait(0.5)  # with the lock it does not come
        else:
            entered.set()
            ended.wait(60)
        return compile_(dispatcher, signature)

    monkeypatch.setattr(CPUDispatcher, "compile", watched)
    one, two = kept()(lambda x: x + 1), kept()(lambda x: x + 2)
    second = threading.Thread(target=two, args=(1,))
    assert one(1) == 2
    ended.set()
    second.join()
    assert before == config.OPT
