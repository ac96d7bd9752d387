"""Runs docs/read-results.py, as a user would, on a smoke run: python tests/cross/read_results.py PATH_TO_LUMENAV.

Fails where the script fails, prints another name than it was given, or draws an empty picture.
Needs pyarrow==21.0.0 and matplotlib==3.10.6 (Python 3.11), no display.
"""
import os
import pathlib
import subprocess
import sys
import tempfile

root = pathlib.Path(__file__).resolve().parents[2]
lumenav = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else root / "target" / "release" / "lumenav").resolve()
with tempfile.TemporaryDirectory() as scratch:
    run, picture = pathlib.Path(scratch) / "run", pathlib.Path(scratch) / "errors.png"
    scenario = "scenarios/smoke/helix.toml"
    subprocess.run([lumenav, "run", scenario, "--out", run, "--record", "none", "-q"], cwd=root, check=True)
    environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
    script = root / "docs" / "read-results.py"
    command = [sys.executable, script, run, picture]
    told = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
    assert told.strip() == str(picture), told
    data = picture.read_bytes()
    assert data.startswith(b"\x89PNG\r\n\x1a\n") and len(data) > 10_000, f"{len(data)} bytes"
print("docs/read-results.py: ok")
