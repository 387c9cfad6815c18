"""The Dockerfile, the devcontainer and Binder's files: what they take, and that it is enough.

``tests/test_container.py FOLDER``, as root, follows the whole Dockerfile in a folder that holds a
fresh Debian, as debootstrap makes it: its packages, the environment, the book.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parents[1]


def instructions():
    """Pairs of instruction and argument of the Dockerfile."""
    text = re.sub(r"^#.*\n", "", (ROOT / "Dockerfile").read_text(encoding="utf-8"), flags=re.M)
    lines = text.replace("\\\n", " ").splitlines()
    return [tuple(line.split(maxsplit=1)) for line in lines if line]


def copy(destination, *more):
    """Copy what ``COPY .`` takes: all but the paths in .dockerignore, and but some more."""
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    patterns = [line for line in lines if line and not line.startswith("#")] + [*more]

    def left_out(folder, names):
        paths = {name: Path(folder, name).relative_to(ROOT).as_posix() for name in names}
        return [name for name in names if any(
            fnmatch(name, pattern[3:]) if pattern.startswith("**/") else paths[name] == pattern
            for pattern in patterns
        )]  # fmt: skip

    shutil.copytree(ROOT, destination, ignore=left_out, symlinks=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("container") / "armsim"
    copy(folder, ".git")  # where git may be at work
    return folder


def run(folder, *command, **variables):
    environment = {name: os.environ[name] for name in os.environ if "MAKE" not in name} | variables
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_container_builds_the_whole_book_by_default(folder):
    command = json.loads(dict(instructions())["CMD"])
    planned = run(folder, *command, "--dry-run", f"PYTHON={sys.executable}")
    assert "--require-hashes --only-binary=:all: -r environment.txt" in planned
    for notebook in (ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"):
        assert f"reportkit.execute notebooks/{notebook.name}" in planned
    assert "build . -W" in planned


def test_nothing_that_was_built_here_gets_into_the_container(folder):
    assert not [name for name in (".venv", "_build", "book/results") if (folder / name).exists()]
    assert not list(folder.rglob("__pycache__"))


def test_devcontainer_uses_the_same_system_and_environment():
    file = ROOT / ".devcontainer" / "devcontainer.json"
    settings = json.loads(file.read_text(encoding="utf-8"))
    assert (file.parent / settings["build"]["dockerfile"]).resolve() == ROOT / "Dockerfile"
    stages = [line for name, line in instructions() if name == "FROM"]
    assert stages == [f"debian:13-slim AS {settings['build']['target']}", "system"]
    assert ("RUN", settings["postCreateCommand"]) in instructions()


def test_binder_puts_the_locked_kernel_in_the_place_of_its_own(folder):
    python = folder / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\necho "$@" >> log\n')
    python.chmod(0o755)
    for stamp in (".locked", ".installed"):
        (folder / ".venv" / stamp).write_text(f"{folder.resolve()}\n")
    run(folder, "binder/postBuild", NB_PYTHON_PREFIX="/somewhere")
    told = (folder / "log").read_text()
    assert told == "-m ipykernel install --prefix /somewhere --name python3 --display-name armsim\n"


def test_binder_takes_a_python_that_is_served():
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    name, version = (ROOT / "binder" / "runtime.txt").read_text().strip().split("-")
    assert name == "python"
    assert version in SpecifierSet(wanted)


def follow(system):
    """Follow the Dockerfile in a folder that holds a Debian."""
    user, place = "0", "/"
    variables = {name: os.environ[name] for name in os.environ if name.startswith("PIP_")}
    variables["PATH"] = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
    for name, argument in instructions():
        if name == "USER":
            user, variables["HOME"] = argument, "/home/reader"
        elif name == "WORKDIR":
            place = argument
        elif name == "COPY":
            made = system / argument.split()[-1].lstrip("/")
            copy(made)
            subprocess.run(["chown", "-R", f"{user}:{user}", made], check=True)
        elif name in ("RUN", "CMD"):
            line = " ".join(json.loads(argument)) if name == "CMD" else argument
            print(f"{name} {line}", flush=True)
            inside = ["sh", "-c", f"cd {place} && {line}"]
            command = ["chroot", f"--userspec={user}:{user}", system, *inside]
            subprocess.run(command, env=variables, check=True)


if __name__ == "__main__":
    follow(Path(sys.argv[1]).resolve())
