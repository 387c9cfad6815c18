"""Where the numbers of a report come from: software, computer, run times and data."""

import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement

from reportkit import text
from reportkit.program import run
from reportkit.project import Project
from reportkit.timing import computer, installed

#: In an export of a repository git writes the commit into this file (``export-subst``).
ARCHIVED = ".git_archival.txt"


class Commit(NamedTuple):
    """The commit that a folder is of."""

    name: str = ""  #: empty if it is not known
    changed: bool | None = None  #: whether files differ from it or are new; None if not known
    date: str = ""


def software(project: Project) -> list[tuple[str, str]]:
    """List what `versions` finds; the report's own version ends with its commit, if known."""
    found, commit = versions(project), commit_of(project.root)
    found[project.name] += f", commit {commit.name[:7]}" if commit.name else ""
    found[project.name] += " with changes" if commit.changed else ""
    return [*found.items()]


def versions(project: Project) -> dict[str, str]:
    """Return the versions of the report, Python and the packages that the report requires.

    These are the requirements of the installed distribution and of its extra ``project.extra``,
    and ``project.versions``.
    """
    wanted = metadata.requires(project.name) if installed(project.name) else []
    extra = {"extra": project.extra}
    needed = [
        r.name for r in map(Requirement, wanted or []) if not r.marker or r.marker.evaluate(extra)
    ]
    names = sorted({*needed, *project.versions} - {project.name}, key=str.lower)
    found = {name: installed(name) or "not installed" for name in (project.name, "Python", *names)}
    return found | {"Python": platform.python_version()}


def commit_of(root: Path) -> Commit:
    """Return the commit of a folder.

    The folder is the top of a repository, or an export of one with the file `ARCHIVED`. Whether an
    export was changed cannot be known.
    """
    # A program that git itself has started finds another repository by these.
    others = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}

    def git(*words: str) -> str:
        command = ["git", "--no-optional-locks", "-C", str(root), *words]
        done = subprocess.run(command, env=others, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    with suppress(OSError, subprocess.CalledProcessError):
        if os.path.samefile(git("rev-parse", "--show-toplevel"), root):
            name, date = git("log", "-1", "--format=%H %cs").split()
            return Commit(name, bool(git("status", "--porcelain")), date)
    archived = (root / ARCHIVED).read_text() if (root / ARCHIVED).is_file() else ""
    node = re.search(r"^node: ([0-9a-f]+)$", archived, re.MULTILINE)
    return Commit(node[1] if node else "")


def keep(project: Project, folder: Path) -> None:
    """Write ``provenance.toml``: the commit and whether it was changed, the lock, the versions.

    What is not known is left out.
    """
    commit, lock = commit_of(project.root), _sum(project.lock) if project.lock.is_file() else ""
    known = {"commit": commit.name, "changed": commit.changed, "lock_sha256": lock}
    lines = [f"{key} = {json.dumps(one)}" for key, one in known.items() if one not in ("", None)]
    lines += ["", "[versions]"]
    lines += [f"{json.dumps(name)} = {json.dumps(one)}" for name, one in versions(project).items()]
    text.write(folder / "provenance.toml", "\n".join([*lines, ""]))


def _sum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def bundle(results: Path, file: Path) -> None:
    """Pack the executed notebooks with their values, tables, data and figures; the same each time.

    Parameters
    ----------
    results, file
        The folder of the results, and the ZIP file to write.
    """
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(results.glob("[0-9][0-9]_*.*")):
            if path.suffix in (".ipynb", ".json", ".csv", ".svg", ".md"):
                entry = zipfile.ZipInfo(f"results/{path.name}")  # of 1980, not of today
                archive.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)


def run_times(results: Path) -> Iterator[tuple[str, str]]:
    """List the executed notebooks, as links, each with the seconds that it took."""
    for path in text.studies(results, ".ipynb"):
        seconds = results / f"{path.stem}-seconds.txt"
        told = seconds.read_text().strip() if seconds.exists() else "–"
        yield f"{{doc}}`{path.stem} <{results.name}/{path.stem}>`", told


def sums(project: Project) -> list[tuple[str, str]]:
    """List the SHA-256 sums of the data files, each with the file's path from the root.

    Expected results only judge, so they are left out.
    """
    files = (path for path in sorted(project.data.rglob("*")) if path.is_file())
    return [
        (_sum(path), str(path.relative_to(project.root)))
        for path in files
        if project.expected not in path.parents and path.parent.name != "__pycache__"
    ]


def write(project: Project, results: Path) -> None:
    """Write ``appendix-*`` beside the results: four tables for pages, and ``SHA256SUMS``."""
    data, packages, date = sums(project), software(project), commit_of(project.root).date
    short = [(f"`{name}`", f"`{digest[:16]}`") for digest, name in data]
    parts = {
        "software.md": text.markdown_table(["package", "version"], packages),
        "version.md": f"**Version** {packages[0][1]}{date and ', '}{date}\n",
        "computer.md": f"{computer()}\n",
        "run-times.md": text.markdown_table(["notebook", "run time / s"], run_times(results), [1]),
        "sums.md": text.markdown_table(["file", "SHA-256, first 16 digits"], short),
        "SHA256SUMS": "".join(f"{digest}  {name}\n" for digest, name in data),
    }
    for name, content in parts.items():
        text.write(results / f"appendix-{name}", content)
    bundle(results, results / "appendix-results.zip")


def main(results: Path) -> None:
    """Run ``python -m reportkit.provenance RESULTS``; see `write`."""
    write(Project.find(), results)


if __name__ == "__main__":
    sys.exit(run(main, sys.argv[1:]))
