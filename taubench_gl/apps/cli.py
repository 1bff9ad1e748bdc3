"""The command line ``taubench-gl``: options become calls, errors become exit codes.

Every command imports its libraries when it runs, so ``--help`` needs neither OpenGL nor NumPy.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import shlex
import sys
from pathlib import Path
from typing import NoReturn, TextIO

import click
from click.shell_completion import get_completion_class

from taubench_gl import __version__
from taubench_gl.apps.batch_command import batch
from taubench_gl.apps.benchmark_command import benchmark
from taubench_gl.apps.capture_command import capture
from taubench_gl.apps.check_command import check
from taubench_gl.apps.compare_command import compare
from taubench_gl.apps.conformance_command import conformance
from taubench_gl.apps.convert_command import convert
from taubench_gl.apps.cost_command import cost
from taubench_gl.apps.demo_command import demo
from taubench_gl.apps.doctor_command import doctor
from taubench_gl.apps.evaluate_command import evaluate
from taubench_gl.apps.export_command import export
from taubench_gl.apps.inspect_command import inspect
from taubench_gl.apps.options import Commands, command
from taubench_gl.apps.paper_command import paper
from taubench_gl.apps.reference_command import reference
from taubench_gl.apps.reject_command import reject
from taubench_gl.apps.report_command import report, share
from taubench_gl.apps.reuse_command import reuse
from taubench_gl.apps.scenes_command import scenes
from taubench_gl.apps.screen import EXIT_INTERRUPTED
from taubench_gl.apps.selftest_command import selftest
from taubench_gl.apps.stages import show_stages
from taubench_gl.apps.stress_command import stress
from taubench_gl.apps.view_command import view
from taubench_gl.errors import TaubenchError, printable

log = logging.getLogger(__name__)
EXIT_ERROR = 2
_REFUSED = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a full or failing disk."""
SHELLS = ("bash", "zsh", "fish")
SECTIONS = {
    "Measure": (evaluate, inspect, compare, report, share),
    "Reuse and rejection": (reuse, reject, benchmark),
    "Studies": (batch, paper, cost, stress),
    "Look": (view, demo),
    "Files and scenes": (export, convert, capture, check, conformance, reference, scenes),
    "Machine": (doctor, selftest),
}
"""Commands by purpose, for the help."""


class Program(Commands):
    """The program: the group of all commands."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> tuple:
        """A scene in place of a command is answered with what to type."""
        if args[0] not in self.commands and _names_scene(args[0]):
            scene = shlex.quote(args[0])
            raise click.UsageError(
                f"{args[0]} is no command (type: taubench-gl evaluate {scene}, or view, inspect)", ctx
            )
        return super().resolve_command(ctx, args)


def _names_scene(word: str) -> bool:
    from taubench_gl.scene import READERS  # not for --help

    return word.startswith("exr:") or Path(word).suffix.lower() in READERS


@click.group(
    cls=Program,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(__version__, prog_name="taubench-gl")
def cli() -> None:
    """Measure how much of each frame the next one can reuse, on which pixels, and the error of a wrong reuse.

    Examples:
      taubench-gl doctor
      taubench-gl inspect scene.glb
      taubench-gl evaluate scene.glb --out results
      taubench-gl view results
      taubench-gl compare results other-results
      taubench-gl selftest
      taubench-gl scenes make eternal-valley-fps valley.glb
      taubench-gl stress scene.glb --camera vr --out hard.glb

    Errors end with exit code 2 and one line; TAUBENCH_DEBUG=1 adds the traceback.
    """


@command()
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print the script that completes commands and options in SHELL.

    Examples:
      source <(taubench-gl completion bash)
      taubench-gl completion zsh >> ~/.zshrc
      taubench-gl completion fish > ~/.config/fish/completions/taubench-gl.fish
    """
    maker = get_completion_class(shell)
    assert maker is not None, shell  # click has all three
    click.echo(maker(cli, {}, "taubench-gl", "_TAUBENCH_GL_COMPLETE").source())


for members in SECTIONS.values():
    for member in members:
        cli.add_command(member)
cli.add_command(completion)
cli.sections = {heading: [member.name for member in members] for heading, members in SECTIONS.items()}
cli.sections["Machine"].append(completion.name)


def main(arguments: list[str] | None = None) -> NoReturn:
    """Entry point of the console script.  Always exits: 0, 2 for an error, 130 when interrupted."""
    show_stages()
    for stream in (sys.stdout, sys.stderr):
        # A terminal that cannot show a dash or a superscript gets a question mark, not a traceback.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    log.info("%s", printable(shlex.join(["taubench-gl", *(sys.argv[1:] if arguments is None else arguments)])))
    try:
        code = cli.main(args=arguments, prog_name="taubench-gl", standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()  # a full disk is reported below, not by the interpreter at exit
    except TaubenchError as error:
        if _debugging():
            raise
        click.echo(f"taubench-gl: error: {error}", err=True)
        code = EXIT_ERROR
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        code = EXIT_ERROR
    except click.UsageError as error:
        message = error.format_message().rstrip(".")
        path = error.ctx.command_path if error.ctx is not None else "taubench-gl"
        hint = "" if message.endswith(")") else f" (see '{path} --help')"
        click.echo(f"taubench-gl: error: {message}{hint}", err=True)
        code = EXIT_ERROR
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("taubench-gl: interrupted", err=True)
        code = EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of the output has closed it, as head does.
        _drop_output(sys.stdout)
        code = 1
    except OSError as error:
        if error.errno not in _REFUSED or _debugging():
            raise
        _drop_output(sys.stdout)
        with contextlib.suppress(OSError):  # messages may go to the same disk
            done = "read or written" if error.errno == errno.EIO else "written"
            message = f"{error.filename or 'a file'} cannot be {done}: {error.strerror}"
            click.echo(f"taubench-gl: error: {message}", err=True)
        code = EXIT_ERROR
    sys.exit(code if isinstance(code, int) else 0)


def _debugging() -> bool:
    return os.environ.get("TAUBENCH_DEBUG", "") not in ("", "0")


def _drop_output(stream: TextIO) -> None:
    """Send the rest of ``stream`` to the null device; otherwise the interpreter fails again when it flushes at exit."""
    try:
        stream.flush()
        return
    except OSError:
        pass
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
