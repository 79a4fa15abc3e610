"""What is printed may contain anything, but controls no terminal."""

import io
import json
import os
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trunk_core.text import PrintableStream, bounded, printable, shell_words


@pytest.mark.parametrize(
    "text", ["", "plain", "two\nlines\tand a tab", "θ ≤ 0.5 °, Rümpfe, 人, 🤖"]
)
def test_text_stays_as_it_is(text):
    assert printable(text) == text


@pytest.mark.parametrize("number", [0, 7, 8, 13, 0x1B, 0x7F, 0x9B, 0x202E, 0x2066, 0xDC80])
def test_a_character_that_controls_a_terminal_is_written_out(number):
    assert printable(f"a{chr(number)}b") == f"a\\u{number:04x}b"


@given(st.lists(st.sampled_from(["is", "not", "'" + "n" * 3000 + ".mcap':", "/a" * 100, "x" * 61])))
def test_a_message_is_bounded_whatever_names_are_in_it(words):
    text = " ".join(words)
    shown = bounded(text)
    assert len(shown) <= 480
    assert (shown == text) == (len(text) <= 480)
    assert shown[:30] == text[:30]
    assert shown[-29:] == text[-29:]


@given(st.text())
def test_json_stays_the_same_json(text):
    shown = json.dumps({"name": text}, ensure_ascii=False, indent=2)
    assert json.loads(printable(shown)) == {"name": text}
    assert printable(printable(shown)) == printable(shown)


@given(st.text(st.characters(categories=["Cc", "Cf", "Cs"], exclude_characters="\n\t\u00ad")))
def test_no_control_character_passes(text):
    assert not any(0x7F <= ord(c) < 0xA0 or ord(c) < 0x20 for c in printable(text))


@pytest.mark.parametrize(
    "name",
    [
        b"a.mcap",
        b"a b'c$d",
        b"L\xe4ufe/0.mcap",
        b"\x1b\xe4'\\\\",
        "θ 人".encode(),
        "\u202e".encode(),
    ],
)
def test_a_printed_command_can_be_pasted(name):
    words = shell_words("printf", "%s", os.fsdecode(name))
    assert printable(words) == words
    pasted = subprocess.run(["bash", "-c", words], capture_output=True, check=True)
    assert pasted.stdout == name


def test_an_ascii_terminal_gets_question_marks():
    raw = io.BytesIO()
    stream = PrintableStream(io.TextIOWrapper(raw, encoding="ascii"))
    stream.write("θ = 3°\x1b[31m\n")
    stream.flush()
    assert raw.getvalue() == b"? = 3?\\u001b[31m\n"
