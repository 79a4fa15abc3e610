from __future__ import annotations

import inspect

import pytest

from trunk_experiments.export_c.translate import Program
from trunk_experiments.export_c.types import UntranslatableError, type_of

from .untranslatable import OUTSIDE


@pytest.mark.parametrize("function", OUTSIDE, ids=lambda f: f.__name__)
def test_outside_of_the_subset_with_line_and_remedy(function):
    text, remedy, examples = OUTSIDE[function]
    with pytest.raises(UntranslatableError) as caught:
        Program().function(function, [type_of(example) for example in examples])
    error = caught.value
    lines, first = inspect.getsourcelines(function)
    assert error.function == f"{function.__module__}.{function.__qualname__}"
    assert error.text.startswith(text)
    source = "".join(lines[error.line - first].split()).replace('"', "'")
    assert "".join(text.split()).strip("()").partition("**3")[0].partition(":=")[0] in source
    assert remedy in error.remedy
    assert str(error).count("\n") == 0
    assert f"line {error.line}" in str(error)
