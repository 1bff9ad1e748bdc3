"""``taubench-gl completion``: the line that makes a shell complete commands and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

SHELLS = ("bash", "zsh", "fish")
VARIABLE = "_TAUBENCH_GL_COMPLETE"


@click.command(
    epilog="""\b
Examples:
  source <(taubench-gl completion bash)
  taubench-gl completion zsh >> ~/.zshrc
  taubench-gl completion fish > ~/.config/fish/completions/taubench-gl.fish"""
)
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print the script that completes commands and options in SHELL."""
    maker = get_completion_class(shell)
    assert maker is not None, shell  # click has all three
    click.echo(maker(click.get_current_context().find_root().command, {}, "taubench-gl", VARIABLE).source())
