"""The scripts of examples/ are short, and run."""

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda p: p.stem)
def test_a_script_runs(script, tmp_path, monkeypatch, capsys):
    assert len(script.read_text(encoding="utf-8").splitlines()) < 40
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out.strip()


LONG = ("campaign", "coverage")
GALLERY = [
    pytest.param(script, id=script.stem, marks=[pytest.mark.slow] * (script.stem in LONG))
    for script in sorted((EXAMPLES / "gallery").glob("*.py"))
]


@pytest.mark.parametrize("script", GALLERY)
def test_a_script_of_the_gallery_runs_and_draws(script, tmp_path, monkeypatch):
    """In its folder, as its data are sought from there; what the docs make of it: test_gallery."""
    content, drawn = script.read_text(encoding="utf-8"), []
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.setattr(plt, "show", lambda: drawn.extend(plt.get_fignums()))
    exec(compile(content, script.name, "exec"), {"__name__": "__main__"})
    plt.close("all")
    of_reports = len(re.findall(r"^reports\.plots\.", content, re.MULTILINE))  # a cell shows it
    assert len(set(drawn)) + of_reports == content.count("# %% picture=") > 0


EXECUTE = """
import sys, nbformat, nbclient
notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=300).execute()
print(nbformat.writes(notebook))
"""


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)
def test_the_cells_of_a_notebook_run(notebook, tmp_path, monkeypatch):
    """Cell by cell in one session of this process; what Jupyter makes of it is judged below."""
    shown = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: shown.extend(plt.get_fignums()))
    session = {"__name__": "__main__"}
    for number, cell in enumerate(json.loads(notebook.read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"cell {number}", "exec"), session)
    plt.close("all")
    assert shown


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs_in_jupyter(notebook, tmp_path):
    environment = os.environ | {"IPYTHONDIR": str(tmp_path), "JUPYTER_PLATFORM_DIRS": "1"}
    environment.pop("MPLBACKEND", None)  # the notebook's own shows figures
    run = subprocess.run(
        [sys.executable, "-c", EXECUTE, str(notebook)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    cells = json.loads(run.stdout)["cells"]
    assert any("image/png" in json.dumps(cell.get("outputs")) for cell in cells)
