"""What the command line does with errors: one line, the right exit code, a traceback on request."""

from __future__ import annotations

import errno

import pytest
import typer
from typer.testing import CliRunner

import waveformer
from waveformer.cli import CommandGroup, app, options
from waveformer.simulator.errors import MeshError

FAILURES = {
    "mesh": lambda: MeshError("mesh.empty", "cup.ply holds\nno faces"),
    "disk": lambda: OSError(errno.ENOSPC, "No space left on device", "/data/scan.zarr"),
    "permission": lambda: PermissionError(errno.EACCES, "Permission denied", "/data/locked.zarr"),
    "interrupt": KeyboardInterrupt,
    "defect": lambda: ZeroDivisionError("a defect"),
}


@pytest.fixture
def run(monkeypatch):
    """Run a small application with the project's command group; its one command fails as asked."""
    monkeypatch.delenv("WAVEFORMER_DEBUG", raising=False)
    small = typer.Typer(cls=CommandGroup, pretty_exceptions_enable=False)
    small.callback()(options)

    @small.command()
    def fail(kind: str) -> None:
        raise FAILURES[kind]()

    return lambda *arguments, **keywords: CliRunner().invoke(small, arguments, **keywords)


@pytest.mark.parametrize(
    ("kind", "code", "line"),
    [
        ("mesh", 1, "error: cup.ply holds no faces"),
        ("disk", 1, "error: No space left on device: /data/scan.zarr"),
        ("permission", 1, "error: Permission denied: /data/locked.zarr"),
        ("interrupt", 130, "interrupted; nothing half-written was kept"),
    ],
)
def test_expected_errors_are_one_line(run, kind, code, line):
    result = run("fail", kind)
    assert result.exit_code == code
    assert result.stderr == line + "\n"
    assert result.stdout == ""


def test_a_defect_of_the_program_is_not_hidden(run):
    assert isinstance(run("fail", "defect").exception, ZeroDivisionError)


@pytest.mark.parametrize("arguments", [("--debug", "fail", "mesh"), ("fail", "mesh", "--debug")])
def test_debug_shows_the_traceback(run, arguments):
    result = run(*arguments)
    assert result.exit_code == 1
    assert "Traceback (most recent call last)" in result.stderr
    assert result.stderr.endswith("error: cup.ply holds no faces\n")


def test_debug_through_the_environment(run):
    assert "Traceback" in run("fail", "mesh", env={"WAVEFORMER_DEBUG": "1"}).stderr


def test_after_two_dashes_debug_is_an_argument(run):
    assert isinstance(run("fail", "--", "--debug").exception, KeyError)


@pytest.mark.parametrize("arguments", [("fail",), ("fail", "mesh", "--no-such-option"), ("no-such-command",)])
def test_usage_errors(run, arguments):
    assert run(*arguments).exit_code == 2


def test_version():
    result = CliRunner().invoke(app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout == f"waveformer {waveformer.__version__}\n"


def test_every_command_has_a_description():
    result = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert result.exit_code == 0
    assert "doctor" in result.stdout
    for command in app.registered_commands:
        assert command.callback is not None
        assert command.callback.__doc__, command.callback.__name__
