"""`waveformer --help` and plain imports must not load what takes seconds."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {"mitsuba", "drjit", "torch", "trimesh", "pyvista", "vtk", "matplotlib", "scipy", "zarr"}
HEAVY |= {"dask", "distributed", "pyarrow", "h5py", "pandas", "xarray"}
COMMANDS = ["doctor", "demo", "simulate", "twin", "image", "view", "validate"]
COMMANDS += ["reconstruct", "evaluate", "generate", "propose", "export", "dataset"]

HELP = """
import sys
sys.argv = ["waveformer", *{arguments!r}]
from waveformer.cli import main
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
"""
LOADED = "print('LOADED', *sorted(set(sys.modules) & {heavy!r}))"


def loaded_by(code: str) -> set[str]:
    child = subprocess.run(
        [sys.executable, "-c", f"import sys\n{code}\n{LOADED.format(heavy=HEAVY)}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    return set(child.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["--version"]]
    + [["catalog", "scan", "--help"], ["catalog", "show", "--help"]]
    + [[command, "--help"] for command in COMMANDS],
)
def test_help_is_light(arguments):
    assert loaded_by(HELP.format(arguments=arguments)) == set()


@pytest.mark.parametrize(
    "module", ["waveformer", "waveformer.simulator", "waveformer.doctor", "waveformer.probes"]
)
def test_import_is_light(module):
    assert loaded_by(f"import {module}") == set()
