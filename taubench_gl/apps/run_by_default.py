"""Groups whose command ``run`` is implied."""

from __future__ import annotations

import click


class RunByDefault(click.Group):
    """``GROUP ARGUMENT...`` is ``GROUP run ARGUMENT...`` unless the first argument is a command or asks for help."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)
