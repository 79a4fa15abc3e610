"""Statements of a function as nested blocks, and their text: each variable is declared where it is needed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

_WORD = re.compile(r"(?<![\w.>])[A-Za-z_]\w*")  # no field of a record


def words_in(text: str) -> list[str]:
    """Return the identifiers in C code, without names of fields, in their order."""
    return _WORD.findall(text)


@dataclass
class Line:
    """A statement. ``target``: the variable that it sets as a whole, without reading it.

    ``plain``: it does nothing else, and may go if nobody reads the variable.
    """

    text: str
    target: str = ""
    plain: bool = False

    def words(self) -> set[str]:
        """Return the identifiers in it."""
        return set(words_in(self.text))


@dataclass
class CodeBlock:
    """Statements between ``head`` and a closing brace, or a function's body; ``loop``: they may repeat."""

    head: str = ""
    body: list[Line | CodeBlock] = field(default_factory=list)
    loop: bool = False

    def blocks(self) -> Iterator[CodeBlock]:
        """Yield it and all blocks in it."""
        yield self
        for node in self.body:
            if isinstance(node, CodeBlock):
                yield from node.blocks()

    def lines(self) -> Iterator[Line]:
        """Yield all statements in it, in their order."""
        for node in self.body:
            yield from [node] if isinstance(node, Line) else node.lines()

    def words_of_heads(self) -> set[str]:
        """Return the identifiers in the heads of all blocks."""
        return {word for block in self.blocks() for word in words_in(block.head)}

    def words(self) -> set[str]:
        """Return the identifiers in its heads and in its statements."""
        return self.words_of_heads().union(*(line.words() for line in self.lines()))

    def without(self, superfluous: Callable[[Line], bool]) -> None:
        """Drop statements."""
        for block in self.blocks():
            block.body = [n for n in block.body if isinstance(n, CodeBlock) or not superfluous(n)]


def without_unread(root: CodeBlock, variables: Mapping[str, str]) -> None:
    """Drop assignments to variables that nobody reads, and then those that only served them."""
    read = root.words_of_heads().union(*(line.words() - {line.target} for line in root.lines()))
    read |= {line.target for line in root.lines() if not line.plain}
    unread = {line.target for line in root.lines() if line.plain} & {*variables} - read
    if unread:
        root.without(lambda line: line.plain and line.target in unread)
        without_unread(root, variables)


def build_in_output(root: CodeBlock, output: str, variables: Mapping[str, str]) -> None:
    """Let the record that every return copies to an output be that output: one copy less on the stack."""
    writes = [line for line in root.lines() if output in line.words()]
    match = re.fullmatch(rf"\*{output} = (\w+);", writes[0].text) if writes else None
    if match is None or any(line.text != writes[0].text for line in writes):
        return
    name = match[1]
    if name not in variables or variables[name] in ("double", "bool", "int64_t"):
        return

    def in_output(code: str) -> str:
        code = re.sub(rf"(?<![\w.>])&{name}\b(?!\.)", output, code)
        code = re.sub(rf"(?<![\w.>]){name}\.", f"{output}->", code)
        code = re.sub(rf"^{name} = ", f"*{output} = ", code)
        return re.sub(rf"(?<![\w.>]){name}\b", f"*{output}", code)

    root.without(lambda line: line.text == match[0])
    for block in root.blocks():
        block.head = in_output(block.head)
    for line in root.lines():
        line.text = in_output(line.text)
        line.target = "" if line.target == name else line.target


def may_write_in_place(root: CodeBlock, given: str, result: str, callees: set[str]) -> bool:
    """Return True if nothing of an argument is read after an output is begun: they may be the same record.

    An output is written behind all else, just before a return, or is a copy of the argument from the start;
    the record, or a field, may be copied onto itself. ``callees`` may themselves do so.
    """
    whole = f"*{result} = *{given};"
    begins = [node for node in root.body if {given, result} & node.words()][:1]
    if begins and isinstance(begins[0], Line) and begins[0].text == whole:
        uses = sum(given in line.words() for line in root.lines())
        return uses == 1 and given not in root.words_of_heads()
    written = False
    for line in root.lines():
        if line.text == whole or _passes_on(line.text, given, result, callees):
            continue
        left, _, right = line.text.partition(" = ")
        written = written or result in line.words()
        if given in line.words() and written:
            field = left.partition("->")[2]
            itself = left == f"{result}->{field}" and right == f"{given}->{field};"
            if not (field and itself):
                return False
        written = written and line.text != "return;"
    return True


def _passes_on(text: str, given: str, result: str, callees: set[str]) -> bool:
    """Return True for a call, the last statement, with the argument and the output at the same places."""
    match = re.fullmatch(rf"(\w+)\({given}, (.*?)\b{result}\b(.*)\);", text)
    if match is None or match[1] not in callees:
        return False
    return not re.search(rf"&{given}\b|(?<![\w.>]){given}(?!->)\b", match[2] + match[3])


def declare(block: CodeBlock, variables: Mapping[str, str]) -> None:
    """Declare variables, ``{name: C type}``, each in the smallest block that may contain it."""
    for name, kind in variables.items():
        if name in block.words():
            _declare(block, name, kind)


def _declare(block: CodeBlock, name: str, kind: str) -> None:
    inside = [i for i, node in enumerate(block.body) if name in node.words()]
    if len(inside) == 1:
        node = block.body[inside[0]]
        headless = isinstance(node, CodeBlock) and name not in words_in(node.head)
        if isinstance(node, CodeBlock) and headless and (not node.loop or _set_first(node, name)):
            _declare(node, name, kind)
            return
    first = block.body[inside[0]]
    if isinstance(first, Line) and first.target == name and first.text.startswith(f"{name} = "):
        block.body[inside[0]] = Line(f"{kind} {first.text}")
        return
    place = inside[0]
    while isinstance(node := block.body[place], CodeBlock) and node.head.startswith("else"):
        place -= 1
    block.body.insert(place, Line(f"{kind} {name};"))


def _set_first(block: CodeBlock, name: str) -> bool:
    """Return True if the first statement with a variable sets it: no value comes from the round before."""
    for node in block.body:
        if name in node.words():
            return isinstance(node, Line) and node.target == name
    return False


def text_of(block: CodeBlock, indent: int = 1) -> list[str]:
    """Return the lines of a block's statements."""
    lines: list[str] = []
    pad = "    " * indent
    for node in block.body:
        if isinstance(node, Line):
            lines.append(f"{pad}{node.text}")
            continue
        if node.head.startswith("else") and lines and lines[-1] == f"{pad}}}":
            lines[-1] = f"{pad}}} {node.head}"
        else:
            lines.append(f"{pad}{node.head}")
        lines += text_of(node, indent + 1)
        lines.append(f"{pad}}}")
    return lines
