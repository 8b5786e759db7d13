"""Scripts become pages with what they print and draw, and are run again when they change."""

import importlib.util
from pathlib import Path

import pytest

HOOKS = Path(__file__).parents[2] / "docs" / "hooks"
SCRIPT = """\
# %% [markdown]
# # A line
# %%
print("drawn below")
# %% picture="line"
import matplotlib.pyplot as plt

plt.plot([0, 1])
plt.show()
"""


@pytest.fixture
def gallery(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("gallery", HOOKS / "gallery.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "CACHE", tmp_path / "cache")
    return module


def test_a_script_is_run_once_until_it_changes(gallery, tmp_path, monkeypatch):
    script = tmp_path / "line.py"
    script.write_text(SCRIPT)
    notebook = gallery.executed(script)
    assert "drawn below" in notebook.cells[1].outputs[0]["text"]
    picture = gallery.pictures(notebook)["line"]
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 1000

    notebook.cells[2].outputs = []
    with pytest.raises(ValueError, match="picture line: its cell draws nothing"):
        gallery.pictures(notebook)

    with monkeypatch.context() as patch:
        patch.setattr(gallery, "NotebookClient", None)  # nothing is run
        assert gallery.pictures(gallery.executed(script))["line"] == picture
        script.write_text(SCRIPT + "# changed\n")
        with pytest.raises(TypeError):
            gallery.executed(script)
        patch.setenv("DOCS_GALLERY", "unrun")
        assert gallery.pictures(gallery.executed(script)) == {"line": gallery.BLANK}
