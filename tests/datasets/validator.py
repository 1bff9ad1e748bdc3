"""Runs the Khronos glTF validator (npm package gltf-validator) if node and the package are installed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

VARIABLE = "GLTF_VALIDATOR"
"""Environment variable: the folder in which ``npm install gltf-validator`` was run."""

SCRIPT = """
const validator = require(process.argv[1]); const fs = require("fs");
const bytes = new Uint8Array(fs.readFileSync(process.argv[2]));
validator.validateBytes(bytes, {maxIssues: 0}).then(r => console.log(JSON.stringify(r.issues)));
"""


def errors(path: Path) -> list[str]:
    """Errors found by the validator.  Skips the test if it cannot run."""
    node = shutil.which("node")
    folder = os.environ.get(VARIABLE)
    if node is None or folder is None:
        pytest.skip(f"Khronos validator: needs node and {VARIABLE}, a folder with 'npm install gltf-validator'")
    package = Path(folder) / "node_modules" / "gltf-validator"
    if not package.is_dir():
        pytest.skip(f"Khronos validator: no gltf-validator in the node_modules of {VARIABLE}")
    done = subprocess.run([node, "-e", SCRIPT, package, path], capture_output=True, text=True, timeout=300, check=True)
    issues = json.loads(done.stdout)
    found = [f"{m['code']} {m.get('pointer')}" for m in issues["messages"] if m["severity"] == 0]
    assert len(found) == issues["numErrors"]
    return found
