"""Pure functions compiled by numba unchanged: nothing is written twice. numba is loaded when it is needed.

numba lets compiled code call a plain function once it is registered (`register_jitable`):
CPython still runs the function itself, compiled code its translation. `compiled` registers a function
and every function of this project that it calls, found through its global names and, for a function
built by a factory, its closure; then it compiles it. A law is passed to such a factory as an argument,
and may come from any package.

Compiled code gives CPython's bits: no fast-math, no fused multiply-add, sines of our own (`elementary`).
Only a division by zero differs: inf or NaN where CPython raises; the pure functions never divide by
anything that can be zero.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, wraps
from importlib.util import find_spec
from io import RawIOBase
from itertools import accumulate
from operator import attrgetter
from pathlib import Path
from threading import Timer
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from . import PACKAGES
from .errors import SettingError, unusable_setting

# Without numba's reference counting (_nrt): for arrays in named tuples passed between functions it took
# half of a run's time. So compiled code only uses arrays that it is given, which the caller keeps alive;
# numba refuses a function that creates one.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "_nrt": False}
_registered: set[FunctionType] = set()
_KEPT_DAYS = 90.0
WITHOUT_NUMBA = "numba is not installed, or switched off by NUMBA_DISABLE_JIT"
_COMPILE_S = 30.0  # at most, on a machine that is not busy
_POLL_S = 0.05
_SOON_S, _LATE_S = 2.0, 10.0  # until something is said, on a terminal and elsewhere

Function = TypeVar("Function", bound=Callable[..., Any])
Record = TypeVar("Record")

_INTEGERS = {"pulse_starts", "table_times", "times", "turns_ns"}  # fields of ns


def with_arrays(record: Record) -> Record:
    """Return a named tuple with its tuples as arrays, so that its type does not include their lengths.

    Nested named tuples are treated likewise; anything else is returned unchanged.
    """
    if not hasattr(record, "_fields"):
        return record
    fields: Any = record
    made: Record = fields._make(
        _array(value, np.int64 if name in _INTEGERS else np.float64)
        if type(value) is tuple
        else with_arrays(value)
        for name, value in zip(fields._fields, fields, strict=True)
    )
    return made


def _array(values: tuple[Any, ...], kind: type[np.int64 | np.float64]) -> NDArray[Any]:
    try:
        return np.array(values, dtype=kind)
    except TypeError:  # numbers of many runs among them
        return np.array(values, dtype=object)


def call_graph(function: Callable[..., Any]) -> list[FunctionType]:
    """Return a function and all that it calls, directly or not, of its own package and of this project.

    They are found through global names and, for a function built by a factory, its closure.
    """
    functions: list[FunctionType] = []
    waiting: list[Any] = [function]
    while waiting:
        callee = waiting.pop()
        if callee not in functions:
            functions.append(callee)
            waiting += _called(callee)
    return functions


def names_used(code: CodeType) -> tuple[str, ...]:
    """Return the global and attribute names in a function's code."""
    inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return (*code.co_names, *(name for constant in inner for name in names_used(constant)))


def _called(function: FunctionType) -> Iterator[FunctionType]:
    for cell in function.__closure__ or ():
        if isinstance(cell.cell_contents, FunctionType):
            yield cell.cell_contents
    packages = {*PACKAGES, _package(function)}
    for name in names_used(function.__code__):
        value = function.__globals__.get(name)
        if isinstance(value, FunctionType) and _package(value) in packages:
            yield value


def _package(function: FunctionType) -> str:
    return function.__module__.split(".")[0]


@cache
def twin(function: Function) -> Function:
    """Return a function's compiled twin; without numba, which is optional, the function."""
    try:
        return compiled(function)
    except ImportError:
        return function


def compiled(function: Function) -> Function:
    """Return a function's compiled twin; it is compiled on the first call, or loaded from disk.

    The machine code is kept in `cache_folder`, under a fingerprint of what all its sources say:
    numba's own cache checks the age of one source file, and its place. Code not used for 90 days is
    deleted when other sources are compiled. If no folder is writable, the disk is full or what was kept
    is damaged, nothing is kept. Raises ImportError without numba or with NUMBA_DISABLE_JIT, and SettingError
    if numba cannot use another of its settings.
    """
    numba = _numba()
    from numba.core.caching import IndexDataCacheFile
    from numba.extending import register_jitable

    _prefer_wide_vectors(numba.config)
    for callee in call_graph(function):
        if callee is not function and callee not in _registered:
            # inline: passing rule tables by value costs as much as using them
            register_jitable(forceinline=True, **_OPTIONS)(callee)
            _registered.add(callee)
    config: Any = numba.config
    folder = config.CACHE_DIR
    try:
        kept = cache_folder() / fingerprint(function)
        is_new = not kept.exists()
        config.CACHE_DIR = str(kept)
        twin: Function = numba.njit(function, cache=True, **_OPTIONS)
        name = f"{function.__module__}.{function.__qualname__}".replace("<", "").replace(">", "")
        cache: Any = twin._cache  # type: ignore[attr-defined]
        cache._cache_file = IndexDataCacheFile(str(kept), name, "")
        cache._index_key = lambda given, codegen: (
            given,
            codegen.magic_tuple(),
            _identity(function),
        )
        os.utime(kept)
        _compile_alone(twin, kept / "lock")
        if is_new:
            _delete_unused(kept.parent)
    except (RuntimeError, OSError):
        twin = numba.njit(function, **_OPTIONS)
    finally:
        config.CACHE_DIR = folder
    return twin


def _numba() -> Any:
    """Load numba. Raises as `compiled` does."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "Environment variable 'NUMBA_")
            import numba
    except Exception as error:
        if line := unusable_setting(error):
            raise SettingError(line) from None
        raise
    features = os.environ.get("NUMBA_CPU_FEATURES") or "+"
    if any(feature[:1] not in ("+", "-") for feature in features.split(",")):  # LLVM would abort
        raise SettingError(
            f"NUMBA_CPU_FEATURES={features} is not allowed: +NAME,-NAME; or unset it"
        )
    config: Any = numba.config
    if config.DISABLE_JIT:
        raise ImportError("NUMBA_DISABLE_JIT is set")
    return numba


def refusal(function: Function, *example: object) -> str:
    """Return in one line why numba refuses a call of a function's twin; empty if it does not: it is made.

    Raises as `compiled` does.
    """
    compiled_twin = twin(function)
    if compiled_twin is function:
        raise ImportError(WITHOUT_NUMBA)
    from numba.core.errors import NumbaError

    try:
        compiled_twin(*example)
    except NumbaError as error:
        return _reason_of(error)
    return ""


def compiled_or_plain(function: Function, report: Callable[[str], None]) -> Function:
    """Return the compiled twin; where numba refuses a function, its calls run in CPython, with the same bits.

    ``report`` is called once, with numba's reason in one line.
    """
    quick, plain = twin(function), False
    if quick is function:
        report(WITHOUT_NUMBA)
        return function
    from numba.core.errors import NumbaError

    @wraps(function)
    def run(*arguments: Any) -> Any:
        nonlocal plain
        if not plain:
            try:
                return quick(*arguments)
            except NumbaError as error:
                plain = True
                report(_reason_of(error))
        return function(*arguments)

    return cast(Function, run)


def _reason_of(error: Exception) -> str:
    """Return numba's reason in one line: what it does not know, and where."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    reasons = [
        line for line in lines if not line.startswith(("Failed in", "During:", "-", ">>>", "^"))
    ]
    where = [line for line in lines if line.startswith("File ")]
    return " ".join([*reasons[:1], *where[-1:]]) or type(error).__name__


def fingerprint(*functions: Callable[..., Any]) -> str:
    """Return a hash of the meaning of functions' files, of all that these import, and numba's version."""
    from importlib.metadata import version

    callees = {callee for function in functions for callee in call_graph(function)}
    packages = frozenset(PACKAGES) | {callee.__module__.split(".")[0] for callee in callees}
    files: set[str] = set()
    waiting = {__file__, *(callee.__code__.co_filename for callee in callees)}
    while waiting:
        files |= waiting
        waiting = set().union(*(_imported(file, packages) for file in waiting)) - files
    versions = " ".join(version(name) for name in ("numba", "llvmlite") if find_spec(name)).encode()
    return hashlib.sha256(b"".join((versions, *sorted(map(_meaning, files))))).hexdigest()[:16]


@cache
def _meaning(path: str) -> bytes:
    """Return what a file says to Python: no comments, docstrings, assertions and numbers of lines."""
    try:
        return repr(_words_of(compile(_contents(path), "", "exec", optimize=2))).encode()
    except SyntaxError:  # in a file that nobody has loaded
        return _contents(path)


_SAID = attrgetter(
    *("co_name", "co_names", "co_varnames", "co_freevars", "co_cellvars", "co_code", "co_flags"),
    *("co_argcount", "co_posonlyargcount", "co_kwonlyargcount"),
)


def _words_of(value: object) -> object:
    """Return code, also within constants, as values whose text is the same in each process."""
    if isinstance(value, CodeType):
        return _SAID(value), [_words_of(constant) for constant in value.co_consts]
    if isinstance(value, frozenset):
        return sorted(map(repr, value))
    return [_words_of(one) for one in value] if isinstance(value, tuple) else value


def _identity(function: Callable[..., Any]) -> str:
    """Return a hash of a function as loaded: its file may have changed, a factory make many of a name."""
    from numba.core.serialize import dumps

    words: list[object] = []
    for callee in call_graph(function):
        code = callee.__code__
        documented = bool(callee.__doc__) and code.co_consts[:1] == (callee.__doc__,)
        cells = [cell.cell_contents for cell in callee.__closure__ or ()]
        values = [*(callee.__defaults__ or ()), *(callee.__kwdefaults__ or {}).items(), *cells]
        words += [_SAID(code), _words_of(code.co_consts[documented:])]
        words += [dumps(value) for value in values if not isinstance(value, FunctionType)]
    return hashlib.sha256(repr(words).encode()).hexdigest()


def cache_folder() -> Path:
    """Return the folder of compiled code: ``$XDG_CACHE_HOME/trunk``, else ``~/.cache/trunk``."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "trunk"


def _prefer_wide_vectors(config: Any) -> None:
    """Let LLVM take vectors of eight doubles wherever the processor has them.

    For Intel's it prefers four, since those once ran at a lower clock rate; loops over lanes gain from eight.
    The bits are the same. This acts on all code that numba compiles in the process after it.
    """
    from numba.core.codegen import get_host_cpu_features

    features = config.CPU_FEATURES or get_host_cpu_features()  # the user's own, if any
    if "+avx512f" in features.split(",") and "prefer-256-bit" not in features:
        config.CPU_FEATURES = f"{features},-prefer-256-bit"


def _compile_alone(twin: Any, path: Path) -> None:
    """Let one process at a time compile a function: the next ones load what it has kept.

    numba reads its index, adds an entry and writes it back without a lock: of two processes at once, one
    could leave an entry that names the other's machine code. Where the file system has no locks, or another
    process has held the lock for longer than a compilation takes, nothing is kept.
    """
    from numba.core.errors import NumbaError

    compile_ = twin.compile

    def alone(*given: object) -> object:
        with ExitStack() as held:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                lock = held.enter_context(path.open("ab+", buffering=0))
                _acquire(lock, twin.__name__)
                # Closing it is not enough: a process forked meanwhile has the same open file.
                held.callback(fcntl.flock, lock, fcntl.LOCK_UN)
                lock.truncate(0)
                lock.write(str(os.getpid()).encode())
            except OSError:
                twin._cache.disable()
            with _told(f"compiling {twin.__name__}, once for each version of its sources"):
                try:
                    return compile_(*given)
                except NumbaError:
                    raise
                except Exception:  # numba may raise anything on damaged files
                    twin._cache.disable()
                    return compile_(*given)

    twin.compile = alone


def _acquire(lock: RawIOBase, name: str) -> None:
    """Lock a file, in which its holder's number is. Raises OSError without locks, or if it takes too long."""
    lock.seek(0)
    holder = (lock.read() or b"unknown").decode()
    with _told(f"waiting for process {holder}, which is compiling {name}"):
        give_up = time.monotonic() + _COMPILE_S
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() >= give_up:
                    raise
                time.sleep(_POLL_S)


@contextmanager
def _told(activity: str) -> Iterator[None]:
    """Say what is going on if it takes long: soon on a terminal, later in a log."""
    timer = Timer(_SOON_S if sys.stderr.isatty() else _LATE_S, _say, [activity])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _say(activity: str) -> None:
    print(f"trunk: {activity}", file=sys.stderr, flush=True)


def _delete_unused(folder: Path) -> None:
    """Delete code that no run has used for `_KEPT_DAYS`; a process that has loaded it keeps it."""
    for old in folder.iterdir():
        with suppress(OSError):
            if (
                re.fullmatch("[0-9a-f]{16}", old.name)
                and old.stat().st_mtime < time.time() - _KEPT_DAYS * 86400.0
            ):
                shutil.rmtree(old)


# A parser would take longer than loading machine code. Words that are no module's name do no harm.
_IMPORT = re.compile(r"(?m)^\s*(?:from\s+(\.*)([\w.]*)\s+)?import\s+(\([^)]*\)|(?:.*\\\n)*.*)")


@cache
def _imported(file: str, packages: frozenset[str]) -> set[str]:
    """Return the files of these packages that a file imports, anywhere in it."""
    stems: set[str] = set()
    for dots, base, names in _IMPORT.findall(_contents(file).decode()):
        for name in re.findall(r"[\w.]+", names):
            module = (f"{base}.{name}" if base else name).split(".")
            spec = None if dots or module[0] not in packages else find_spec(module[0])
            origin = file if dots else spec and spec.origin
            if origin:
                folder = origin.rsplit("/", len(dots) or 2)[0]
                stems |= set(accumulate((folder, *module), "{}/{}".format))
    paths = (path for stem in stems for path in (f"{stem}.py", f"{stem}/__init__.py"))
    return set(filter(os.path.isfile, paths))


@cache
def _contents(path: str) -> bytes:
    return Path(path).read_bytes()
