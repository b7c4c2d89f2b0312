"""Imports point one way only, files stay small, and every source folder is part of the wheel.

Sources are parsed, never imported.
"""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Folder order = data order = import order: what each folder may import besides itself.
ALLOWED = {
    "simulator": set(),
    "datagen": {"simulator"},
    "model": {"simulator", "datagen"},
    "eval": {"simulator", "datagen", "model"},
    "configs": set(),
}
# Folders whose name must always follow "waveformer.": a file imported under two names registers its
# Mitsuba plugins twice, silently.
NEVER_BARE = set(ALLOWED)
MAXIMUM_LINES = 500
# Names of standard modules that would be shadowed if the folder itself came onto the import path.
SHADOWING = {"signal.py", "select.py", "types.py", "random.py"}


def python_files(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def command_line_files() -> list[Path]:
    # Not rglob on waveformer/: its links lead back into the folders above.
    return sorted((ROOT / "waveformer").glob("*.py")) + python_files("waveformer/cli")


SOURCES = [*python_files(*ALLOWED), *command_line_files()]


def imported_names(path: Path) -> list[str]:
    """Full names of all modules a file imports, wherever the import stands."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.relative_to(ROOT)}:{node.lineno}: relative import"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def imported_parts(path: Path) -> set[str]:
    """The second component of every ``waveformer.…`` import."""
    parts = (name.split(".") for name in imported_names(path))
    return {part[1] for part in parts if part[0] == "waveformer" and len(part) > 1}


def test_there_is_something_to_check():
    assert len(SOURCES) > 10


@pytest.mark.parametrize("folder", ALLOWED)
def test_layers(folder):
    for path in python_files(folder):
        # __version__ is an attribute of the package, not a module.
        extra = imported_parts(path) - ALLOWED[folder] - {folder, "__version__"}
        assert not extra, f"{path.relative_to(ROOT)} may not import waveformer.{sorted(extra)}"


def test_no_bare_imports():
    for path in [*SOURCES, *python_files("tests", "benchmarks")]:
        bare = {name.split(".")[0] for name in imported_names(path)} & NEVER_BARE
        assert not bare, f"{path.relative_to(ROOT)}: import waveformer.{min(bare)}, not {min(bare)}"


def test_every_folder_is_packaged():
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    declared = tool["package-dir"]
    found = {path.parent.relative_to(ROOT).as_posix() for path in SOURCES}
    assert found <= set(declared.values()), "a folder is missing from package-dir in pyproject.toml"
    assert set(declared) == set(tool["packages"])


def test_links_for_static_tools():
    for folder in ALLOWED:
        link = ROOT / "waveformer" / folder
        # A clone without symbolic links holds a small text file here; the installed package does not need it.
        assert not link.is_symlink() or link.readlink() == Path("..") / folder


def test_files_stay_small():
    for path in SOURCES:
        lines = len(path.read_text(encoding="utf-8").splitlines())
        assert lines <= MAXIMUM_LINES, f"{path.relative_to(ROOT)} has {lines} lines: split it"


def test_no_standard_module_is_shadowed():
    assert not [path.relative_to(ROOT) for path in SOURCES if path.name in SHADOWING]
