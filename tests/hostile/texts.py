"""Parameter files, studies and values of --set that are more than they seem."""

_HEAD = "/**:\n  ros__parameters:\n"


def _aliases() -> str:
    lines = ["    a0: &a0 [" + ", ".join(["1.0"] * 10) + "]"]
    lines += [f"    a{k}: &a{k} [" + ", ".join([f"*a{k - 1}"] * 10) + "]" for k in range(1, 10)]
    return _HEAD + "\n".join([*lines, ""])


TEXTS: dict[str, str] = {
    "a bomb of aliases": _aliases(),
    "an alias of itself": "&a [*a]",
    "merged mappings": "a: &a {b: 1}\nc:\n  <<: *a\n",
    "merged lists": "<<: [{a: 1}, {b: 2}]\n",
    "a merge of nothing": "/**:\n  ros__parameters:\n    <<: 5\n",
    "a deep list": "[" * 100_000,
    "a deep list, closed": "[" * 10_000 + "]" * 10_000,
    "a deep mapping": "{a: " * 10_000,
    "a deep block": "".join("  " * k + "a:\n" for k in range(2000)),
    "deep dashes": "- " * 50_000 + "1",
    "deep questions": "? " * 50_000 + "1",
    "a long list": _HEAD + "    pulse.times: [" + "1.0, " * 300_000 + "2.0]\n",
    "many parameters": _HEAD + "".join(f"    p{k}: {k}\n" for k in range(100_000)),
    "many nodes": "".join(f"n{k}: {{ros__parameters: {{a: 1}}}}\n" for k in range(40_000)),
    "a long integer": _HEAD + f"    update_rate: 0x{'f' * 5000}\n",
    "a long decimal": _HEAD + f"    update_rate: {'9' * 5000}\n",
    "a long base 60": _HEAD + "    update_rate: 1" + ":59" * 100_000 + "\n",
    "a long fraction": _HEAD + "    update_rate: 0." + "3" * 1_000_000 + "\n",
    "a large exponent": _HEAD + "    update_rate: 1e999999999\n",
    "a long name": _HEAD + f"    {'n' * 1_000_000}: 1\n",
    "a long key": f"? {'k' * 500_000}\n: 1\n",
    "a long text": _HEAD + f"    scenario: {'t' * 5_000_000}\n",
    "long whitespace": _HEAD + " " * 5_000_000 + "\n",
    "many comments": "# x\n" * 1_000_000,
    "many documents": "--- 1\n" * 50_000,
    "many tags": "".join(f"%TAG !t{k}! tag:x:\n" for k in range(50_000)) + "--- 1\n",
    "a tag of Python": "!!python/object/apply:os.system [true]\n",
    "a set": "!!set {a, b}\n",
    "an ordered map": "!!omap [a: 1, b: 2]\n",
    "pairs": "/**: !!pairs [ros__parameters: {a: 1}]\n",
    "binary": _HEAD + "    update_rate: !!binary " + "QUJD" * 1000 + "\n",
    "a date": _HEAD + "    update_rate: 2026-11-21\n",
    "a null": _HEAD + "    update_rate: ~\n",
    "a key of null": "~:\n  ros__parameters: {a: 1}\n",
    "keys that are numbers": "1:\n  ros__parameters: {2: 3}\n",
    "control characters": _HEAD + "    scenario: \x1b[31m\x07\n",
    "a byte order mark": "\ufeff" + _HEAD + "    update_rate: 100.0\n",
    "patterns": "/**/**/**/**/**/**/**/**/**/**/**/**/x:\n  ros__parameters: {update_rate: 1.0}\n",
    "stars": "*" * 2000 + ":\n  ros__parameters: {update_rate: 1.0}\n",
    "a pattern for each": "".join(
        f"'{'/**' * 30}/{k}':\n  ros__parameters: {{update_rate: 1.0}}\n" for k in range(200)
    ),
    "a study of 10^30 runs": "scenario: fig6\ncontrollers: [pid]\nvary:\n"
    + "".join(
        f"  v{k}: {{parameter: controller.kp, from: 1, to: 2, steps: 1000000}}\n" for k in range(5)
    ),
    "a study of a large step count": "scenario: fig6\ncontrollers: [pid]\nvary:\n"
    "  v: {parameter: controller.kp, from: 1, to: 2, steps: 1e300}\n",
}
