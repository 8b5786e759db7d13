"""The check of statement counts counts as it says, and complains where a limit is exceeded."""

from statements import LONG, counts, document, exceeded

MODULE = '''
"""A module's docstring is no statement."""
LIMIT = 3


class Model:
    """Neither is a class's."""

    def value(self):
        """Nor a method's."""
        if self:
            return 1
        return 2
'''


def write_packages(folder, text):
    for package in ("robotmodels", "estimators", "oed", "reports"):
        (folder / package).mkdir(exist_ok=True)
    (folder / "oed" / "model.py").write_text(text, encoding="utf-8")
    return counts(folder)


def test_statements_are_counted_without_docstrings(tmp_path):
    functions, total, files = write_packages(tmp_path, MODULE)
    assert functions == {"oed/model.py:Model.value": 3}
    assert (total, files) == (6, 1)


def test_a_function_that_grows_is_named(tmp_path):
    long = MODULE.replace("        return 2\n", "        self = 1\n" * LONG + "        return 2\n")
    limits = document(*write_packages(tmp_path, long))
    assert limits["functions"] == {"oed/model.py:Model.value": LONG + 3}
    assert exceeded(limits, *write_packages(tmp_path, long)) == []
    longer = long.replace("LIMIT = 3\n", "").replace("        return 2\n", "        self = 1\n" * 2)
    (line,) = exceeded(limits, *write_packages(tmp_path, longer))
    assert line.startswith(f"oed/model.py:Model.value: {LONG + 4} statements, {LONG + 3} are")


def test_packages_that_grow_are_named(tmp_path):
    limits = document(*write_packages(tmp_path, MODULE))
    (line,) = exceeded(limits, *write_packages(tmp_path, MODULE + "\nMORE = 4\n"))
    assert line.startswith("the packages have 7 statements, 6 are allowed")
