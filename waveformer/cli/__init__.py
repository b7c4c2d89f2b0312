"""The `waveformer` command: one file per subcommand, all of them registered here.

Subcommands import heavy packages (mitsuba, torch, trimesh, pyvista, matplotlib) inside their functions,
so that `waveformer --help` answers at once.
"""

from __future__ import annotations

import traceback
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from waveformer import __version__
from waveformer.cli import catalog as catalog_command
from waveformer.cli import dataset as dataset_command
from waveformer.cli import demo as demo_command
from waveformer.cli import doctor as doctor_command
from waveformer.cli import evaluate as evaluate_command
from waveformer.cli import export as export_command
from waveformer.cli import generate as generate_command
from waveformer.cli import image as image_command
from waveformer.cli import propose as propose_command
from waveformer.cli import reconstruct as reconstruct_command
from waveformer.cli import simulate as simulate_command
from waveformer.cli import twin as twin_command
from waveformer.cli import validate as validate_command
from waveformer.cli import view as view_command
from waveformer.simulator.errors import WaveformerError

EXIT_ERROR = 1
EXIT_INTERRUPTED = 130


class CommandGroup(TyperGroup):
    """The command group that turns expected errors into one line on stderr and an exit code."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Accept --debug anywhere on the line, as users add it at the end of the command that failed."""
        options_end = args.index("--") if "--" in args else len(args)
        if "--debug" in args[:options_end]:
            args = ["--debug", *(arg for arg in args[:options_end] if arg != "--debug"), *args[options_end:]]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the subcommand.

        Raises:
            typer.Exit: code 1 after a WaveformerError or an OSError, 130 after Ctrl-C. Usage errors and
                defects of the program pass through (exit code 2, and a traceback).
        """
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            kept = str(error) or "nothing half-written was kept"
            raise _stop(ctx, f"interrupted; {kept}", EXIT_INTERRUPTED) from error
        except BrokenPipeError:
            raise  # `waveformer ... | head`: typer ends quietly
        except WaveformerError as error:
            raise _stop(ctx, f"error: {_one_line(str(error))}", EXIT_ERROR) from error
        except OSError as error:
            place = f": {error.filename}" if error.filename else ""
            raise _stop(
                ctx, f"error: {_one_line(error.strerror or str(error))}{place}", EXIT_ERROR
            ) from error


app = typer.Typer(
    name="waveformer",
    cls=CommandGroup,
    no_args_is_help=True,
    rich_markup_mode=None,  # rich help pages look better and take twice as long to appear
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"waveformer {__version__}")
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[
        bool, typer.Option("--debug", envvar="WAVEFORMER_DEBUG", help="Show the traceback of an error.")
    ] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """From a mesh to raw radar signals, and from the signals back to the shape."""


app.command()(doctor_command.doctor)
app.command()(demo_command.demo)
app.command()(simulate_command.simulate)
app.command()(twin_command.twin)
app.command()(generate_command.generate)
app.command()(export_command.export)
app.command()(propose_command.propose)
app.command()(image_command.image)
app.command()(reconstruct_command.reconstruct)
app.command()(evaluate_command.evaluate)
app.command()(view_command.view)
app.command()(validate_command.validate)
app.add_typer(dataset_command.app, name="dataset")
app.add_typer(catalog_command.app, name="catalog")


def main() -> None:
    """Entry point of the `waveformer` script."""
    app(prog_name="waveformer")


def _stop(ctx: Any, message: str, code: int) -> typer.Exit:
    """Print the message, after the traceback if --debug asks for it; to be raised while handling the error."""
    if ctx.params.get("debug"):
        traceback.print_exc()
    typer.echo(message, err=True)
    return typer.Exit(code)


def _one_line(text: str) -> str:
    return " ".join(text.split()) or "unknown error"
