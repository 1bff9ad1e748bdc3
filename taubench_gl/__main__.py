"""``python -m taubench_gl``: the command line."""

import sys

if __name__ == "__main__":
    try:
        from taubench_gl.apps.cli import main
    except KeyboardInterrupt:  # while everything is still being imported
        sys.exit(130)
    main()
