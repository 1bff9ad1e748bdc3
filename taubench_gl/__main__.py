"""``python -m taubench_gl``: the command line."""

from taubench_gl.apps.cli import main

if __name__ == "__main__":
    main()
