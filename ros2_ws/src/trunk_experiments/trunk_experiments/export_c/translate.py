"""The translator's entry: a program of functions, translated on demand with all that they call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any

from .function import Translator
from .program import Definitions, RestartError, Translated, qualified
from .types import Type, UntranslatableError


class Program(Definitions):
    """Functions of Python as C, with all that they call. ``prefix``: of the names of records.

    The contract is in docs/design.md: for arguments with which CPython does not raise, what is translated
    gives CPython's bits; anything else is refused.
    """

    def function(self, python: Callable[..., Any], types: Sequence[Type]) -> Translated:
        """Return a function translated for arguments of these types.

        Raises UntranslatableError.
        """
        if not isinstance(python, FunctionType):
            raise UntranslatableError(repr(python), 0, "", "it is not a plain function", "use def")
        key = (python, tuple(types))
        if key in self.functions:
            return self.functions[key]
        if key in self.busy:
            line = python.__code__.co_firstlineno
            raise UntranslatableError(
                qualified(python), line, python.__name__, "it calls itself", "write a loop"
            )
        self.busy.append(key)
        try:
            wider: set[str] = set()
            name = ""
            while True:
                translator = Translator(self, python, types, wider)
                try:
                    translator.run()
                    break
                except RestartError as widened:
                    wider.add(str(widened))
            name = self.name(f"{python.__module__.rsplit('.', 1)[-1]}_{python.__name__}")
            translated = translator.finished(name)
        finally:
            self.busy.pop()
        self.functions[key] = translated
        self.ordered.append(translated)
        return translated
