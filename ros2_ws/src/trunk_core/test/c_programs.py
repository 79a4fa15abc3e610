"""Translated functions in a compiled program that reads arguments and writes results."""

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from hashlib import blake2b
from math import isnan
from pathlib import Path
from struct import pack, unpack
from tempfile import NamedTemporaryFile, mkdtemp
from typing import Any

import pytest

from trunk_core.c.translate import Program
from trunk_core.c.types import (
    BOOLEAN,
    REAL,
    RecordType,
    Scalar,
    TableType,
    Type,
    at_run_time,
    type_of,
)

COMPILER = os.environ.get("CC") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler: apt-get install gcc")
_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "trunk-tests"
_KEPT_S = 30 * 86_400.0
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")


def made_once(of: object, make: Callable[[], bytes]) -> bytes:
    """Return what ``make`` gives, or gave before: of the same, as the text of ``of`` says."""
    kept = _CACHE / blake2b(repr(of).encode(), digest_size=16).hexdigest()
    if not kept.exists():
        made = make()
        _CACHE.mkdir(parents=True, exist_ok=True)
        for old in _CACHE.iterdir():
            with suppress(OSError):  # another process's
                if time.time() - old.stat().st_mtime > _KEPT_S:
                    old.unlink()
        with NamedTemporaryFile(dir=_CACHE, delete=False) as part:
            part.write(made)
        Path(part.name).replace(kept)
    return kept.read_bytes()


def compiled_once(command: Sequence[str | Path], output: Path) -> str:
    """Run a compiler's command with ``-o output``, or write what the same gave before; return what it says.

    The same: the same compiler and flags, and sources and headers beside them with the same contents.
    """
    files = [path for path in map(Path, command) if path.is_file()]
    texts = sorted({header for file in files for header in file.parent.glob("*.h")})
    words = [Path(word).name if Path(word) in files else str(word) for word in command]
    said = _version(str(command[0]))
    same = said, words, [file.read_bytes() for file in (*files, *texts)]

    def compiled() -> bytes:
        words = [*map(str, command), "-o", str(output)]
        subprocess.run(words, capture_output=True, text=True, check=True)
        return output.read_bytes()

    try:
        binary = made_once(same, compiled)
    except subprocess.CalledProcessError as error:
        return error.stderr or str(error)
    output.unlink(missing_ok=True)  # a library may be loaded
    output.write_bytes(binary)
    output.chmod(0o755)
    return ""


@cache
def _version(compiler: str) -> str:
    return subprocess.run(
        [compiler, "--version"], capture_output=True, text=True, check=True
    ).stdout


class Compiled:
    """A function as a program: each call's arguments in, its results out. ``fixed``: places of constants."""

    def __init__(
        self,
        function: Any,
        examples: Sequence[Any],
        fixed: Sequence[int] = (),
        flags: Sequence[str] = ("-O2",),
        changing: tuple[type, ...] = (),
        program: Program | None = None,
    ) -> None:
        self.program = program or Program()
        types = [type_of(example, changing=changing) for example in examples]
        self.translated = f = self.program.function(function, types)
        places = [i for i, t in enumerate(types) if at_run_time(t)]
        self._read = [i for i in places if i not in fixed]
        self._types = types
        head, body, arguments = [], [], []
        for i in places:
            kind = self.program.c_type(types[i])
            if i in fixed:
                head.append(
                    f"static const {kind} a{i} = {self.program.initial(examples[i], types[i])};"
                )
            else:
                body.append(f"{kind} a{i};")
                body += [
                    f"a{i}{path} = {_reader(t)};" for path, t in leaves(self.program, types[i])
                ]
            arguments.append(f"&a{i}" if isinstance(types[i], RecordType) else f"a{i}")
        body.append(f"{self.program.c_type(f.result)} result = {f.name}({', '.join(arguments)});")
        body += [f"{_writer(kind)}(result{path});" for path, kind in leaves(self.program, f.result)]
        roots = "\n".join([*head, *body])
        main = "\n".join(
            [
                "#include <stdio.h>",
                "static double rd(void) { double v = 0;",
                "if (fread(&v, 8, 1, stdin) != 1) { v = 0; } return v; }",
                "static int64_t ri(void) { int64_t v = 0;",
                "if (fread(&v, 8, 1, stdin) != 1) { v = 0; } return v; }",
                "static void wd(double v) { fwrite(&v, 8, 1, stdout); }",
                "static void wi(int64_t v) { fwrite(&v, 8, 1, stdout); }",
                *head,
                "int main(void) {",
                "for (int64_t n = ri(); n > 0; n--) {",
                *body,
                "}",
                "(void)rd; (void)wd; (void)wi;",
                "return 0;",
                "}",
            ]
        )
        self.text = self.program.library(roots) + main + "\n"
        self.folder = Path(mkdtemp(prefix="trunk-c-"))
        self._build(flags)

    def _build(self, flags: Sequence[str]) -> None:
        source, self.binary = self.folder / "program.c", self.folder / "program"
        source.write_text(self.text)
        compiler, flags = (
            (flags[0], flags[1:]) if not flags[0].startswith("-") else (COMPILER, flags)
        )
        wrong = compiled_once([str(compiler), *STRICT, *flags, source], self.binary)
        assert not wrong, wrong + self.text

    def run(self, rows: Sequence[Sequence[Any]], prefix: Sequence[str] = ()) -> list[list[Any]]:
        """Return the results of calls with these arguments, as flat lists of numbers."""
        data = [pack("<q", len(rows))]
        for row in rows:
            for i, value in zip(self._read, row, strict=True):
                data += [_packed(number) for number in _flat(value, self._types[i])]
        done = subprocess.run(
            [*prefix, str(self.binary)], input=b"".join(data), capture_output=True, check=True
        )
        kinds = [kind for _, kind in leaves(self.program, self.translated.result)]
        code = "".join("d" if kind == REAL else "q" for kind in kinds)
        size = 8 * len(code)
        chunks = [done.stdout[i : i + size] for i in range(0, len(done.stdout), size)]
        return [list(unpack(f"<{code}", chunk)) for chunk in chunks]

    def different(
        self, rows: Sequence[Sequence[Any]], results: Sequence[Any], **options: Any
    ) -> list[int]:
        """Return the calls whose results differ from these by a bit; every NaN is equal to every other."""
        computed = self.run(rows, **options)
        assert len(computed) == len(results)
        return [
            k
            for k, (mine, result) in enumerate(zip(computed, results, strict=True))
            if not same(mine, list(_flat(result, self.translated.result)))
        ]


def same(a: Sequence[Any], b: Sequence[Any]) -> bool:
    """Return True if two lists of numbers have the same bits; every NaN is equal to every other."""
    return len(a) == len(b) and all(
        pack("<d", x) == pack("<d", y) or (isnan(x) and isnan(y))
        if isinstance(x, float)
        else not isinstance(y, float) and x == y
        for x, y in zip(a, b, strict=True)
    )


def leaves(program: Program, t: Type, path: str = "") -> Iterator[tuple[str, Scalar]]:
    """Yield the numbers in values of a type: their paths in C, and their types."""
    for place, inner in program.places(t, path):
        if isinstance(inner, Scalar):
            yield place, inner
        elif not isinstance(inner, TableType):
            raise TypeError(inner)


def _flat(value: Any, t: Type) -> Iterator[Any]:
    if isinstance(t, RecordType):
        for item, inner in zip(value, t.types, strict=True):
            if at_run_time(inner):
                yield from _flat(item, inner)
    elif isinstance(t, Scalar) and at_run_time(t):
        yield value if t == REAL else int(value)


def _packed(number: Any) -> bytes:
    return pack("<d", number) if isinstance(number, float) else pack("<q", number)


def _reader(t: Scalar) -> str:
    return "rd()" if t == REAL else "ri() != 0" if t == BOOLEAN else "ri()"


def _writer(t: Scalar) -> str:
    return "wd" if t == REAL else "wi"
