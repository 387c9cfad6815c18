"""The Makefile's rules, with stand-ins for the slow programs, in a folder with a space."""

import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = """
    environment.txt environment-dev.txt pyproject.toml _config.yml _toc.yml index.md book/page.md
    book/_static/a.css
    src/armsim/code.py data/paper/table.toml data/paper/claims.toml data/second_opinions.toml
    data/sensitivity/verdicts.csv data/expected/20_two.json
    notebooks/10_one.ipynb notebooks/20_two.ipynb
"""
PYTHON = """#!/bin/sh
env > environment
[ "$2" = pip ] && echo pip >> log && echo "$@" >> pip && exit
[ "$2" = reportkit.claims ] && echo verdicts >> log && touch "$3"/verdicts{.csv,.md} && exit
[ "$2" = armbook.architecture ] && touch "$3"/appendix-{modules.md,architecture.svg} && exit
case $2 in *jupyter_book*) echo html >> log; mkdir -p _build/html; exit;; esac
echo "$3" >> log
grep -q fail "$3" && exit 1
name="$4/$(basename "$3" .ipynb)"
mkdir -p "$4" && touch "$name.json" "$name-a.svg" && cp "$3" "$4" && touch "$name-seconds.txt"
""".replace("/bin/sh", "/bin/bash")


class Tree:
    """A small repository that notes what make does in it."""

    def __init__(self, root: Path):
        self.root = root
        for name in SOURCES.split():
            self.write(name)
        shutil.copy(ROOT / "Makefile", root)
        self.write(".venv/bin/python", PYTHON).chmod(0o755)
        self.write(".venv/.locked")
        self.write(".venv/.installed", f"{root.resolve()}\n")

    def write(self, name: str, text: str = "") -> Path:
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def make(self, *arguments: str) -> list[str]:
        """Run make, and list what it executed; all that is here was made long ago."""
        self.age()
        return self.make_now(*arguments)

    def age(self) -> None:
        for path in self.root.rglob("*"):
            status = path.stat()
            times = status.st_atime_ns, status.st_mtime_ns
            os.utime(path, ns=(times[0] - 10**10, times[1] - 10**10))

    def make_now(self, *arguments: str) -> list[str]:
        (self.root / "log").unlink(missing_ok=True)
        environment = {name: os.environ[name] for name in os.environ if "MAKE" not in name}
        self.last = subprocess.run(
            ["make", *arguments], cwd=self.root, env=environment, capture_output=True, text=True
        )
        log = self.root / "log"
        return sorted(log.read_text().split()) if log.exists() else []

    def touch(self, name: str) -> None:
        self.age()  # two times that are less than a tick of the system apart may be equal
        (self.root / name).touch()


ALL = ["html", "notebooks/10_one.ipynb", "notebooks/20_two.ipynb", "verdicts"]


@pytest.fixture
def tree(tmp_path):
    tree = Tree(tmp_path / "a book")
    assert tree.make("book") == ALL, tree.last.stderr
    tree.age()  # a file that is touched now is newer, however coarse the clock of the disk
    return tree


def test_nothing_changed_does_nothing(tree):
    assert tree.make("book") == []
    assert tree.last.stdout == f"The report: {tree.root}/_build/html/index.html\n"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("notebooks/20_two.ipynb", ["html", "notebooks/20_two.ipynb", "verdicts"]),
        ("src/armsim/code.py", ALL),
        ("data/paper/table.toml", ALL),
        ("data/paper/claims.toml", ["html", "verdicts"]),
        ("data/second_opinions.toml", ["html", "verdicts"]),
        ("data/sensitivity/verdicts.csv", ALL),
        ("data/measurements/new.csv", ALL),
        ("data/axes/new.toml", ALL),
        ("data/choices.toml", ALL),
        ("data/expected/20_two.json", []),
        ("src/armsim/__pycache__/code.pyc", []),
        ("book/page.md", ["html"]),
        ("book/_static/a.css", ["html"]),
        ("_toc.yml", ["html"]),
        ("pyproject.toml", ["pip"]),
        (".venv/.locked", sorted([*ALL, "pip"])),
    ],
)
def test_change_does_what_depends_on_it(tree, name, expected):
    tree.make("book")
    tree.write(name)
    assert tree.make_now("book") == expected
    assert tree.make("book") == []


def test_failing_notebook_stops_the_build(tree):
    tree.make("book")
    tree.write("notebooks/10_one.ipynb", "fail")
    assert tree.make_now("book") == ["notebooks/10_one.ipynb"]
    assert tree.last.returncode != 0
    tree.write("notebooks/10_one.ipynb", "well")
    assert tree.make_now("book") == ["html", "notebooks/10_one.ipynb", "verdicts"]


def test_results_of_a_removed_notebook_go(tree):
    tree.write("book/results/20_two.json")
    tree.write("book/results/20_two-figure.svg")
    tree.make("book")
    (tree.root / "notebooks/20_two.ipynb").unlink()
    assert tree.make_now("book") == ["html", "verdicts"]
    left = {path.name for path in (tree.root / "book/results").iterdir()}
    assert not [name for name in left if name.startswith("20_two")]
    assert tree.make("book") == []


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("20_two.ipynb", ["html", "notebooks/20_two.ipynb", "verdicts"]),
        ("20_two.json", ["html", "notebooks/20_two.ipynb", "verdicts"]),
        ("20_two-a.svg", ["html", "notebooks/20_two.ipynb", "verdicts"]),
        ("verdicts.md", ["html", "verdicts"]),
        ("verdicts.csv", ["html", "verdicts"]),
        ("appendix-architecture.svg", ["html"]),
        ("appendix-modules.md", ["html"]),
    ],
)
def test_result_deleted_by_hand_is_made_again(tree, name, expected):
    (tree.root / "book/results" / name).unlink()
    assert tree.make("book") == expected
    assert (tree.root / "book/results" / name).exists()
    assert tree.make("book") == []


def test_file_that_a_changed_notebook_makes_no_more_is_not_missed(tree):
    tree.write("book/results/20_two-old.svg")
    tree.write("notebooks/20_two.ipynb", "changed")
    tree.make_now("book")
    (tree.root / "book/results/20_two-old.svg").unlink()
    tree.write("notebooks/20_two.ipynb", "changed again")
    tree.make_now("book")
    assert tree.make("book") == []


@pytest.mark.parametrize("folder", ["notebooks", "book/results"])
def test_copies_of_notebooks_are_no_part_of_the_book(tree, folder):
    for name in ("10_one (copy)", "10_one copy", "10_one-Copy1", "Untitled"):
        tree.write(f"{folder}/{name}.ipynb")
    assert tree.make("book") == [], tree.last.stderr
    assert (tree.root / "book/results/10_one-a.svg").exists()


@pytest.mark.parametrize(
    "name", ["my notes.md", "data/my run (2).csv", "src/a b/c.py", "book/50% #1.md"]
)
def test_file_with_a_name_that_make_cannot_take_is_no_input(tree, name):
    tree.write(name)
    assert tree.make("book") == [], tree.last.stderr
    assert tree.last.returncode == 0


@pytest.mark.parametrize("name", ["it's", "50% #1", "{a}", "a;b&c|d<e>(f)~!=", "Füße"])
def test_odd_folder_is_a_folder(tmp_path, name):
    tree = Tree(tmp_path / name)
    assert tree.make("book") == ALL, tree.last.stderr
    assert tree.last.stdout.endswith(f"The report: {tree.root}/_build/html/index.html\n")


@pytest.mark.parametrize("character", ':"$`\\*?[]')
def test_folder_that_no_environment_takes_is_refused_at_once(tmp_path, character):
    tree = Tree(tmp_path / f"a{character}b")
    assert tree.make("book") == []
    assert tree.last.returncode == 2
    assert f"contains {character}, which venv" in tree.last.stderr


def test_moved_folder_installs_the_package_again_and_executes_nothing(tree):
    tree.root = tree.root.rename(tree.root.with_name("another book"))
    assert tree.make("book") == ["pip"]
    assert 'has a new path: renewing "armsim"' in tree.last.stdout
    assert tree.make("book") == []


def test_settings_of_the_user_for_other_programs_are_ignored(tree, monkeypatch):
    ignored = {
        "PYTHONPATH", "PYTHONHOME", "PYTHONOPTIMIZE", "PYTHONWARNINGS", "PYTHONSTARTUP",
        "PYTHONINSPECT", "PYTHONUTF8", "PYTHONDONTWRITEBYTECODE", "NUMBA_DISABLE_JIT",
        "NUMBA_CPU_NAME", "MPLBACKEND", "MATPLOTLIBRC", "BASH_ENV",
    }  # fmt: skip
    for name in (*ignored, "MPLCONFIGDIR", "NUMBA_CACHE_DIR"):
        monkeypatch.setenv(name, "/nowhere")
    tree.touch("index.md")
    assert tree.make_now("book") == ["html"]
    environment = dict(re.findall("(.*?)=(.*)", (tree.root / "environment").read_text()))
    assert environment.keys() & ignored == set()
    assert environment["NUMBA_CACHE_DIR"] == "/nowhere"
    assert environment["MPLCONFIGDIR"] == f"{tree.root}/.venv/.matplotlib"


def test_interrupted_installation_does_not_count(tree):
    (tree.root / ".venv/.locked").unlink()
    tree.write("bin/python", "#!/bin/sh\ncase $2 in venv) exit 1;; esac\n").chmod(0o755)
    assert tree.make_now("book", f"PYTHON='{tree.root}/bin/python'") == []
    assert tree.last.returncode != 0
    assert not (tree.root / ".venv/.locked").exists()


def test_unfit_python_is_refused_with_advice(tree):
    tree.touch("environment.txt")
    tree.write("python3", "#!/bin/sh\n[ $1 = --version ] && echo Python 3.9.2 || exit 1\n").chmod(
        0o755
    )
    assert tree.make_now("book", "PYTHON=./python3") == []
    assert "needs Python 3.11, 3.12 or 3.13, and ./python3 is\nPython 3.9.2" in (tree.last.stderr)
    assert (tree.root / ".venv/bin/python").exists()


def test_platform_that_no_lock_serves_is_named(tree):
    tree.touch("environment.txt")
    intel_mac = """#!/bin/sh
[ "$1" = -c ] || exit 1
exec python3 -c "import platform, sysconfig
platform.system, platform.machine = lambda: 'Darwin', lambda: 'x86_64'
sysconfig.get_platform = lambda: 'macosx-13-x86_64'
$2"
"""
    tree.write("mac", intel_mac).chmod(0o755)
    assert tree.make_now("book", "PYTHON=./mac") == []
    assert tree.last.returncode == 2
    served = (
        "Linux (x86_64 or aarch64, with glibc) and macOS (arm64), and this is\nmacosx-13-x86_64\n"
    )
    assert served in tree.last.stderr
    assert (tree.root / ".venv/bin/python").exists()


def test_developers_packages_are_installed_for_developers_only(tree):
    assert not (tree.root / "pip").exists()
    assert tree.make("tools") == ["pip", "pip"]  # install, check
    (install, _) = (tree.root / "pip").read_text().splitlines()
    assert install.endswith("--require-hashes --only-binary=:all: -r environment-dev.txt")
    assert tree.make("tools") == tree.make("book") == []
    tree.touch("environment-dev.txt")
    assert tree.make_now("book") == []
    assert tree.make_now("tools") == ["pip", "pip"]


def test_locks_have_all_that_is_required_and_no_package_twice():
    def names(lines):
        return {re.match(r"[\w.-]+", line)[0] for line in lines if re.match(r"\w", line)}

    files = (ROOT / "environment.txt", ROOT / "environment-dev.txt")
    book, tools = (names(file.read_text().splitlines()) for file in files)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    assert names([*project["dependencies"], *extras["book"], *extras["build"]]) <= book
    assert names(extras["dev"]) - {"armsim"} <= book | tools
    assert book.isdisjoint(tools)
    assert {"pytest", "ruff", "mypy", "hypothesis"} <= tools


def test_machine_code_stays_until_distclean(tree):
    code = tree.write("src/armsim/__pycache__/loop.nbc")
    tree.make("clean")
    assert code.exists()
    tree.make("distclean")
    assert not code.exists() and not (tree.root / ".venv").exists()


def test_clean_removes_what_was_built_and_nothing_else(tree):
    tree.write("runs/20_two/20_two.json")
    tree.make_now("clean")
    left = {str(path.relative_to(tree.root)) for path in tree.root.rglob("*") if path.is_file()}
    built = {"Makefile", "environment"}
    left = {name for name in left if not name.startswith(".venv")}
    assert left - built == {*SOURCES.split(), "runs/20_two/20_two.json"}
