"""Carries shaders/ and assets/ into the wheel as taubench_gl/_data; everything else is in pyproject.toml.

A checkout keeps them at the top, where people look for them; paths.py finds them in either place.
"""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
FOLDERS = ("shaders", "assets")


class BuildWithData(build_py):
    def run(self):
        super().run()
        if self.editable_mode:
            return  # paths.py reads the checkout itself: an edited shader takes effect at once
        data = Path(self.build_lib) / "taubench_gl" / "_data"
        # A build folder is reused between builds: a shader deleted since must not ride along.
        shutil.rmtree(data, ignore_errors=True)
        for folder in FOLDERS:
            shutil.copytree(ROOT / folder, data / folder)


setup(cmdclass={"build_py": BuildWithData})
