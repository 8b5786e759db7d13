"""MkDocs hook: scripts of ``examples/gallery`` become pages, with what they print and draw.

A script is a notebook in the percent format of jupytext. The build runs it, unless neither it nor
the packages have changed since: what it gave lies in ``.cache/docs``. The picture of a cell with
``picture="NAME"`` is ``pictures/NAME.png``, for other pages to show.

With ``DOCS_GALLERY=unrun`` in the environment nothing is run, and pictures are blank: for checks of
links.
"""

import base64
import hashlib
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import jupytext
import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbconvert import MarkdownExporter

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted((ROOT / "examples" / "gallery").glob("*.py"))
CACHE = ROOT / ".cache" / "docs"
BLANK = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNk+A8AAQUBAScY42YAAAAASUVORK5CYII="
)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the gallery and their pictures."""
    for script in SCRIPTS:
        notebook = executed(script)
        new = {f"pictures/{name}.png": picture for name, picture in pictures(notebook).items()}
        body, resources = MarkdownExporter().from_notebook_node(
            notebook, {"output_files_dir": script.stem}
        )
        new |= {f"gallery/{name}": content for name, content in resources["outputs"].items()}
        source = f"\n\n---\n\n*Run by the build of this site. [The script]({script.name})*\n"
        new |= {
            f"gallery/{script.stem}.md": body + source,
            f"gallery/{script.name}": script.read_bytes(),
        }
        for path, content in new.items():
            files.append(File.generated(config, path, content=content))
    return files


def pictures(notebook: Any) -> dict[str, bytes]:
    """Return the pictures of cells that name theirs; blank ones of cells that were not run."""
    drawn = {}
    for cell in notebook.cells:
        if "picture" in cell.metadata:
            outputs = (one["data"] for one in cell.get("outputs", ()) if "data" in one)
            found = [data["image/png"] for data in outputs if "image/png" in data]
            if cell.get("execution_count") and not found:
                raise ValueError(f"picture {cell.metadata['picture']}: its cell draws nothing")
            drawn[cell.metadata["picture"]] = base64.b64decode(found[0]) if found else BLANK
    return drawn


def executed(script: Path) -> Any:
    """Return the notebook of a script with its outputs, run where no run of it is stored."""
    notebook = jupytext.read(script)
    if os.environ.get("DOCS_GALLERY") == "unrun":
        return notebook
    stored = CACHE / f"{script.stem}-{digest(script)}.ipynb"
    if not stored.exists():
        print(f"docs: running {script.name}", flush=True)
        with tempfile.TemporaryDirectory(dir=_folder(ROOT / ".cache" / "run")) as folder:
            where = {"metadata": {"path": folder}}
            client = NotebookClient(notebook, timeout=600, resources=where)
            # Figures that no pyplot made are shown from then on, too.
            notebook.cells.insert(0, nbformat.v4.new_code_cell("%matplotlib inline"))
            client.execute(env=_environment(), stderr=subprocess.DEVNULL)
        del notebook.cells[0]
        for old in _folder(CACHE).glob(f"{script.stem}-*.ipynb"):
            old.unlink()
        nbformat.write(notebook, stored)
    return nbformat.read(stored, as_version=4)


def _environment() -> dict[str, str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    return os.environ | {
        "MPLBACKEND": "module://matplotlib_inline.backend_inline",
        "PYTHONPATH": path,
    }


def _folder(path: Path) -> Path:
    path.mkdir(parents=True, exist_ok=True)
    return path


def digest(script: Path) -> str:
    """Return a digest of the script, the packages and the data: what its outputs depend on."""
    content = hashlib.sha256(script.read_bytes())
    for package in ("robotmodels", "estimators", "oed", "examples/data"):
        for file in sorted((ROOT / package).rglob("*")):
            if file.suffix in (".py", ".yaml", ".urdf", ".mat"):
                content.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return content.hexdigest()[:16]
