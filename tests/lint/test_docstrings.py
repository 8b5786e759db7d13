"""The check of docstrings is silent on good ones and finds each kind of fault."""

import textwrap

import pytest
from docstrings import faults

MODULE = '''
class Model:
    """A model.

    Attributes
    ----------
    mass, damping : ndarray, (d, d)
        Its matrices.
    selector : ndarray
        Its selector.
    """

    def __init__(self, mass, damping):
        self.mass = mass
        self.damping = damping

    @property
    def selector(self):
        """Its selector."""


class Damped(Model):
    """A damped model.

    Attributes
    ----------
    mass : ndarray
        Inherited.
    """


def response(model: Model, omega: float = 1.0) -> float:
    """Return a response.

    Parameters
    ----------
    model : Model
        The model.
    omega : float, rad/s, optional
        Angular frequency.

    Returns
    -------
    float
        The response.

    Raises
    ------
    ValueError
        If the frequency is zero.
    """
'''


def faults_of(text, folder):
    (folder / "a_package").mkdir()
    (folder / "a_package" / "__init__.py").write_text(text, encoding="utf-8")
    return faults(folder, ("a_package",))


def test_numpydoc_is_accepted(tmp_path):
    assert faults_of(MODULE, tmp_path) == []


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        ("    omega : float", "    omgea : float", "'omgea' does not appear"),
        ("    selector : ndarray", "    selektor : ndarray", "selektor is no attribute"),
        ("mass, damping :", "mass, dumping :", "dumping is no attribute"),
        ("float, rad/s, optional\n        Angular", "of the\n        line", "text where its type"),
        (
            "omega : float, rad/s, optional\n        Angular frequency.",
            "omega : [rad/s]",
            "no text",
        ),
        ("Return a response.\n", "A response.\n\n    omega : its line.\n", "outside a section"),
        ("Parameters\n    ----------", "Paramters\n    ---------", "is no section"),
        ("        The model.\n", "        The model.\n\n    Linear in all.\n\n", "a_package"),
    ],
)
def test_a_fault_is_found(good, bad, words, tmp_path):
    assert good in MODULE
    lines = faults_of(textwrap.dedent(MODULE.replace(good, bad)), tmp_path)
    assert any(words in line for line in lines), lines
