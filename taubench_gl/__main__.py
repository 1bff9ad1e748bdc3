"""``python -m taubench_gl`` and the console script: the command line."""

import sys
from typing import NoReturn


def main() -> NoReturn:
    """Exits as ``apps.cli.main`` does; with 130 also where it is interrupted while everything is being imported."""
    try:
        from taubench_gl.apps.cli import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
